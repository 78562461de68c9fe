"""What became of many inputs: a few lines at the end, and a file."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from motion_detect_ros.cli.batch.jobs import OK, PARTIAL, Job, Outcome
from motion_detect_ros.results.files import write_whole

LIST_NAME = 'replay.json'
STATES = 'done', 'finished earlier', 'partial', 'failed'


def exit_code(outcomes: Mapping[Job, Outcome]) -> int:
    """That of all, 3 where they differ."""
    codes = {outcome.exit_code for outcome in outcomes.values()}
    return codes.pop() if len(codes) == 1 else PARTIAL


def conclusion(outcomes: Mapping[Job, Outcome]) -> list[str]:
    """How many ended how, and a line with the reason for each that is not whole."""
    counts = Counter(outcome.state for outcome in outcomes.values())
    lines = [f'{len(outcomes)} inputs: ' + ', '.join(f'{counts[state]} {state}' for state in STATES if counts[state])]
    return lines + [f'{outcome.state}: {job.path}: {_reason(job, outcome)}'
                    for job, outcome in outcomes.items() if outcome.exit_code != OK]


def write_list(folder: Path, outcomes: Mapping[Job, Outcome]) -> None:
    """``replay.json``: input, folder, state and line of every input, in their order."""
    entries = [{'input': job.path, 'folder': str(job.folder), 'state': outcome.state, 'line': outcome.line}
               for job, outcome in outcomes.items()]
    if folder.is_dir():
        write_whole(folder / LIST_NAME, json.dumps({'inputs': entries}, indent=2) + '\n')


def _reason(job: Job, outcome: Outcome) -> str:
    """The line of the outcome without what the list says already."""
    line = outcome.line.removeprefix('error: ')
    return line.removeprefix(f'{job.path}: ').removeprefix(f'{job.folder}: ')
