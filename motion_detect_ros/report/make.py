"""Makes reports: of one result folder, and the table over many."""

from __future__ import annotations

import sys
import traceback
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from motion_detect_ros.core.errors import BackendError, MotionDetectError, SourceError
from motion_detect_ros.report.embedding import check_libraries, packed_plotly
from motion_detect_ros.report.own_pages import check_replaceable
from motion_detect_ros.results.files import REPORT_NAME, write_whole


def make_report(
    folder: Path, truth: Path | None = None, output: Path | None = None, source: str | None = None,
) -> Path:
    """Write report.html of the replay in ``folder``, whole or not at all; returns where it is.

    truth: ground truth to compare with, as ``evaluate`` reads it. output: another file. source: where the input is now,
    when it was moved. Raises: BackendError where a library is missing, SourceError for an unreadable folder or truth
    and where another file than an earlier report would be replaced, OSError where the file cannot be written.
    """
    check_libraries()
    path = output or folder / REPORT_NAME
    check_replaceable(path)
    from motion_detect_ros.report.judged import judge
    from motion_detect_ros.report.objects import listed, tracked_objects
    from motion_detect_ros.report.page import Parts, cutouts, page
    from motion_detect_ros.report.pictures import plan_film, take_pictures
    from motion_detect_ros.report.replayed import read_replayed
    if not folder.is_dir():
        raise SourceError(f'{folder}: expected the folder of a replay')
    replayed = read_replayed(folder)
    judged = judge(replayed, truth, source) if truth else None
    everything = tracked_objects(replayed)
    objects, plan = listed(everything), plan_film(replayed)
    with ThreadPoolExecutor(1) as beside:  # packing takes a second core while the film is made
        beside.submit(packed_plotly)
        pictures = take_pictures(replayed, plan, cutouts(objects, replayed, judged), source)
    replayed = replace(replayed, summary=replace(
        replayed.summary, image_size=pictures.image_size or replayed.summary.image_size))
    write_whole(path, page(Parts(replayed, everything, objects, plan, pictures, judged)))
    return path


def can_report() -> bool:
    """Whether reports can be made here; where not, says on stderr what is missing."""
    try:
        check_libraries()
    except BackendError as error:
        print(f'no {REPORT_NAME}: {error}', file=sys.stderr)
        return False
    return True


def report_after_replay(folder: Path) -> str:
    """Make the report of a replay that has just ended; '' or, where there can be none, a few words that say why."""
    try:
        make_report(folder)
    except (MotionDetectError, OSError) as error:
        return f'no {REPORT_NAME}: {error}'
    except Exception as error:  # of a defect in here the results of the replay shall not suffer
        traceback.print_exc(file=sys.stderr)
        return f'no {REPORT_NAME}: {type(error).__name__}: {error}'
    return ''
