"""What an earlier run left in a job's folder: its result, a part of it, or something else that is not overwritten."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from enum import Enum, auto
from pathlib import Path

import motion_detect_ros
from motion_detect_ros.cli.batch.inputs import size_of
from motion_detect_ros.cli.batch.jobs import Job
from motion_detect_ros.core.errors import MotionDetectError, SourceError
from motion_detect_ros.core.settings import settings
from motion_detect_ros.results.files import BAG_NAME, CSV_NAME, SUMMARY_NAME
from motion_detect_ros.results.formats import output_names, outputs_of
from motion_detect_ros.results.live_summary import LiveSummary, read_any_summary
from motion_detect_ros.results.summary import WINDOW_FIELDS, Summary
from motion_detect_ros.sources.bags import BagFrames
from motion_detect_ros.sources.part_file import part_of


class Found(Enum):
    """What is in a job's folder."""

    NOTHING = auto()
    INCOMPLETE = auto()
    OUTDATED = auto()
    FINISHED = auto()


def look(job: Job, live: bool = False) -> Found:
    """What is there of the job; nothing where it is to be done by force. live: to be played through the nodes.

    Raises: SourceError where there are results of another input, window, settings or version, or of unknown ones.
    """
    if job.force:
        return Found.NOTHING
    names = output_names(job.formats)
    files = [file for name in names for file in (job.folder / name, part_of(job.folder / name)) if file.exists()]
    if not files:
        return Found.NOTHING
    try:
        summary = read_any_summary(job.folder)
    except SourceError:
        known = [file for file in files if file.name == SUMMARY_NAME] or files
        raise SourceError(f'{known[0]}: exists; --force overwrites it') from None
    difference = next(_differences(summary, job, live), None)
    if difference and summary.complete and not summary.frames:
        return Found.NOTHING  # a mistaken window: there is nothing to lose
    if difference:
        raise SourceError(f'{job.folder}: holds a result of something else ({difference}); --force overwrites it')
    now = size_of(job.path)
    if now is not None and summary.input_bytes not in (None, now):
        return Found.OUTDATED
    if isinstance(summary, LiveSummary):
        whole = all((job.folder / name).is_file() for name in (CSV_NAME, BAG_NAME))
    else:
        whole = all((job.folder / name).is_file() for name in names) and (summary.overlay or not job.overlay)
        if summary.complete and not whole:
            _refuse_losses(summary, job)
    return Found.FINISHED if summary.complete and whole else Found.INCOMPLETE


def _refuse_losses(summary: Summary, job: Job) -> None:
    """Raises: SourceError where doing a finished job anew would leave out what it has."""
    other = sorted({*outputs_of(summary)} - {*output_names(job.formats)})
    if there := [name for name in other if (job.folder / name).exists()]:
        raise SourceError(f'{job.folder}: holds {", ".join(there)}, which --formats does not name; --force removes it')
    if summary.overlay and not job.overlay:
        raise SourceError(f'{job.folder}: holds the pictures of --overlay, which is not given; --force removes them')


def _differences(summary: Summary | LiveSummary, job: Job, live: bool) -> Iterator[str]:
    """What of the job the summary does not say, each in a few words."""
    if isinstance(summary, LiveSummary) != live:
        yield 'of replay in process' if live else 'of replay --live'
    if Path(summary.input).resolve() != Path(job.path).resolve():
        yield f'input {summary.input}, now {job.path}'
    if summary.version != motion_detect_ros.__version__:
        yield f'version {summary.version}, now {motion_detect_ros.__version__}'
    for name in ('fps', 'topic', 'rectified', *WINDOW_FIELDS):
        was, wanted = getattr(summary, name, None), getattr(job, name)
        if was != wanted and _meant(name, was, job.path) != _meant(name, wanted, job.path):
            yield f'{name} {_shown(was)}, now {_shown(wanted)}'
    now = {name: value for name, value, _ in settings(job.config)}
    for name in sorted({*now, *summary.settings}):
        if summary.settings.get(name) != now.get(name):
            yield f'{name} {_shown(summary.settings.get(name))}, now {_shown(now.get(name))}'


def _meant(name: str, value: object, path: str) -> object:
    """What an option comes to: the default where it is not given, of a topic that of the bag which it chooses."""
    if name == 'topic':
        with suppress(MotionDetectError, OSError):
            return BagFrames(path, None if value is None else str(value)).topic.name
    return {'start_s': 0.0, 'every': 1}.get(name) if value is None else value


def _shown(value: object) -> str:
    return 'not given' if value is None else str(value)
