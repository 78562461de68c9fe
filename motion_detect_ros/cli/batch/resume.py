"""Whether a folder holds what a job would do: finished, to be done anew, or something else that is not overwritten."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from enum import Enum, auto
from pathlib import Path

import motion_detect_ros
from motion_detect_ros.cli.batch.inputs import size_of
from motion_detect_ros.cli.batch.jobs import OK, PARTIAL, Job, Outcome
from motion_detect_ros.cli.batch.one_input import outcome_of
from motion_detect_ros.core.errors import MotionDetectError, SourceError
from motion_detect_ros.core.settings import settings
from motion_detect_ros.report.make import report_after_replay
from motion_detect_ros.results.files import BAG_NAME, CSV_NAME, REPORT_NAME, SUMMARY_NAME
from motion_detect_ros.results.formats import output_names, outputs_of
from motion_detect_ros.results.live_summary import LiveSummary, read_any_summary, read_live_summary
from motion_detect_ros.results.ownership import is_owned
from motion_detect_ros.results.summary import WINDOW_FIELDS, Summary, read_summary
from motion_detect_ros.sources.bags import BagFrames
from motion_detect_ros.sources.part_file import part_of


class Found(Enum):
    """What is in a job's folder."""

    NOTHING = auto()
    INCOMPLETE = auto()
    OUTDATED = auto()
    FINISHED = auto()


_WHY_ANEW = {Found.INCOMPLETE: 'incomplete', Found.OUTDATED: 'the input has changed'}


def sort_out(jobs: Sequence[Job], force: bool, live: bool = False) -> tuple[dict[Job, Outcome], list[str]]:
    """The outcomes of jobs that an earlier run finished, and a line for each that it began and that is done anew;
    of what is finished a report that is wanted and missing is made.

    force: take all folders for empty. live: they are to be played through the nodes.
    Raises: SourceError where a folder holds something else.
    """
    finished: dict[Job, Outcome] = {}
    lines = []
    for job in () if force else jobs:
        found = look(job, live)
        if found is Found.FINISHED:
            outcome = (outcome_of_live(job.folder, read_live_summary(job.folder)) if live
                       else outcome_of(job, read_summary(job.folder)))
            finished[job] = _as_earlier(outcome)
        elif found in _WHY_ANEW and not is_owned(job.folder):
            lines.append(f'{job.folder}: {_WHY_ANEW[found]}, done anew')
    return {job: _with_report(job, outcome) for job, outcome in finished.items()}, lines


def outcome_of_live(folder: Path, summary: LiveSummary) -> Outcome:
    """What the summary of a live replay says, in one line."""
    whole = summary.complete and not summary.damaged and not summary.bad_frames
    return Outcome(OK if whole else PARTIAL, f'{folder}: {summary.line}')


def look(job: Job, live: bool = False) -> Found:
    """Raises: SourceError where there are results of another input, window, settings or version, or of unknown ones."""
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


def _with_report(job: Job, outcome: Outcome) -> Outcome:
    """Make the report that is wanted now and was not when the job was done."""
    if not job.report or (job.folder / REPORT_NAME).is_file():
        return outcome
    trouble = report_after_replay(job.folder)
    return replace(outcome, line=f'{outcome.line}; {trouble or f"{REPORT_NAME} made now"}')


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


def _as_earlier(outcome: Outcome) -> Outcome:
    return Outcome(outcome.exit_code, f'{outcome.line} (finished earlier)', earlier=True)
