"""Which jobs an earlier run finished, and which of those that it began are done anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from motion_detect_ros.cli.batch.earlier import Found, look
from motion_detect_ros.cli.batch.jobs import OK, PARTIAL, Job, Outcome
from motion_detect_ros.cli.batch.one_input import outcome_of
from motion_detect_ros.report.make import report_after_replay
from motion_detect_ros.results.files import REPORT_NAME
from motion_detect_ros.results.live_summary import LiveSummary, read_live_summary
from motion_detect_ros.results.ownership import is_owned
from motion_detect_ros.results.summary import read_summary

_WHY_ANEW = {Found.INCOMPLETE: 'incomplete', Found.OUTDATED: 'the input has changed'}


def sort_out(jobs: Sequence[Job], live: bool = False) -> tuple[dict[Job, Outcome], list[str]]:
    """The outcomes of jobs that an earlier run finished, and a line for each that it began and that is done anew;
    of what is finished a report that is wanted and missing is made.

    The folders of those to be done by force are taken for empty. live: they are to be played through the nodes.
    Raises: SourceError where a folder holds something else.
    """
    finished: dict[Job, Outcome] = {}
    lines = []
    for job in jobs:
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


def _with_report(job: Job, outcome: Outcome) -> Outcome:
    """Make the report that is wanted now and was not when the job was done."""
    if not job.report or (job.folder / REPORT_NAME).is_file():
        return outcome
    trouble = report_after_replay(job.folder)
    return replace(outcome, line=f'{outcome.line}; {trouble or f"{REPORT_NAME} made now"}')


def _as_earlier(outcome: Outcome) -> Outcome:
    return Outcome(outcome.exit_code, f'{outcome.line} (finished earlier)', earlier=True)
