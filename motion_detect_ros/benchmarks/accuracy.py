"""All real clips through the detector, scored against their truth: the table of docs/accuracy.md.

    python -m motion_detect_ros.benchmarks.accuracy [CLIP ...] [--data DIR] [--preset NAME] [--set NAME=VALUE ...]
        [--jobs N] [--all-objects] [--record NAME] [--against NAME] [--pictures DIR] [--write docs/accuracy.md]
    python -m motion_detect_ros.benchmarks.accuracy --floors test/floors.json [--renew]

``--data`` (default: the variable MOTION_DETECT_DATA, else ../shared/data) holds ``clips.json``: for each clip the
folder of frames, the truth file, the frame rate and the preset of its family, which ``--preset`` overrides. Changes
in brackets are against the last run recorded in ``--records`` (docs/accuracy.json). With ``--floors`` only the part of
the clips that the file names is run; exit code 1 where an F1 is under its floor.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from motion_detect_ros.benchmarks.accuracy_clips import (
    DATA_DEFAULT,
    DATA_VARIABLE,
    Clip,
    Job,
    read_clips,
    run_jobs,
)
from motion_detect_ros.benchmarks.accuracy_floors import floor_clips, read_floors, renewed, write_floors
from motion_detect_ros.benchmarks.accuracy_pictures import write_sheets
from motion_detect_ros.benchmarks.accuracy_record import (
    Record,
    append_record,
    make_record,
    read_records,
    record_named,
)
from motion_detect_ros.benchmarks.accuracy_table import table
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import replace_section
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.presets import load_preset

RECORDS = Path(__file__).resolve().parents[2] / 'docs' / 'accuracy.json'
#: Sections of a document that ``--write`` fills, by counting.
SECTIONS = {'moving': 'clips', 'all': 'clips, all objects'}


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 1 where a floor is missed, 2 where clips or settings are wrong."""
    options = make_parser().parse_args(arguments)
    changes = read_changes(options.set)
    return _guard(options, changes) if options.floors else _measure(options, changes)


def make_parser() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(prog='accuracy', description='All real clips, scored.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all)')
    add_run_arguments(parser)
    parser.add_argument('--preset', metavar='NAME', help='name or YAML file, for all clips (default: each its own)')
    add_settings(parser)
    parser.add_argument('--all-objects', action='store_true', help='want every labelled object, moving or not')
    parser.add_argument('--records', type=Path, default=RECORDS, metavar='FILE', help='JSON file of recorded runs')
    parser.add_argument('--record', metavar='NAME', help='append this run to the recorded ones')
    parser.add_argument('--against', metavar='NAME', help='recorded run to compare with (default: the last)')
    parser.add_argument('--pictures', type=Path, metavar='DIR', help='draw the worst frames of each clip')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table, without changes, into this document')
    parser.add_argument('--floors', type=Path, metavar='FILE', help='only check the F1 floors of this file')
    parser.add_argument('--renew', action='store_true', help='with --floors: write what was measured, less 0.03')
    return parser


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Where the clips are and how many processes run them."""
    parser.add_argument('--data', type=Path, default=Path(os.environ.get(DATA_VARIABLE, DATA_DEFAULT)),
                        metavar='DIR', help=f'folder with clips.json (default: {DATA_VARIABLE}, else {DATA_DEFAULT})')
    parser.add_argument('--jobs', type=int, default=2, metavar='N', help='processes (default: 2)')


def add_settings(parser: argparse.ArgumentParser) -> None:
    """``--set``, for ``read_changes``."""
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', help='settings on top of the presets')


def read_changes(texts: Sequence[str]) -> dict[str, Any]:
    """Settings from ``NAME=VALUE`` texts, values as in YAML. Raises: SourceError for a text without ``=``."""
    changes = {}
    for text in texts:
        name, equals, value = text.partition('=')
        if not equals:
            raise SourceError(f'--set: expected NAME=VALUE, got {text!r}')
        changes[name] = yaml.safe_load(value)
    return changes


def with_preset(clips: Sequence[Clip], preset: str | None) -> list[Clip]:
    """The clips, all with this preset unless it is None. Raises: ConfigError for an unknown one."""
    if preset is None:
        return list(clips)
    load_preset(preset)
    return [replace(clip, preset=preset) for clip in clips]


def _measure(options: argparse.Namespace, changes: Mapping[str, Any]) -> int:
    records = read_records(options.records)
    before = record_named(records, options.against)
    jobs = [Job(clip, changes) for clip in with_preset(read_clips(options.data, options.clips), options.preset)]
    runs = list(run_jobs(jobs, options.jobs))
    settings = {'preset': options.preset, **changes} if options.preset else changes
    record = make_record(options.record or 'this run', runs, settings)
    counting = 'all' if options.all_objects else 'moving'
    print('\n'.join(table(record, before, counting)))
    if before:
        print(f'\nIn brackets: change against {_describe(before)}.')
    if options.record:
        append_record(options.records, record)
    if options.write:
        section = SECTIONS[counting] + (f', preset {options.preset}' if options.preset else '')
        replace_section(options.write, section, table(record, counting=counting))
    if options.pictures:
        for path in write_sheets(runs, options.pictures, counting):
            print(path)
    return 0


def _guard(options: argparse.Namespace, changes: Mapping[str, Any]) -> int:
    floors = read_floors(options.floors)
    clips = with_preset(floor_clips(options.data, floors), options.preset)
    runs = list(run_jobs([Job(clip, changes) for clip in clips], options.jobs))
    if options.renew:
        write_floors(options.floors, renewed(floors, runs))
        return 0
    record = make_record('guard', runs, changes)
    print('\n'.join(table(record)))
    found = record.figures('moving')
    failures = [line for floor in floors for line in floor.failures(found[floor.clip])]
    for line in failures:
        print(f'error: {line}', file=sys.stderr)
    return 1 if failures else 0


def _describe(record: Record) -> str:
    changed = ', '.join(f'{name}={value}' for name, value in record.settings.items())
    return f'"{record.name}" of {record.date} ({record.commit or "commit unknown"}{"; " + changed if changed else ""})'


if __name__ == '__main__':
    sys.exit(main())
