"""Accuracy over time: runs kept in a JSON file, and how a new run differs from an old one."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from motion_detect_ros.benchmarks.accuracy_clips import ClipRun
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.metrics import COUNTINGS


@dataclass(frozen=True)
class Figures:
    """One clip under one counting; precision, recall and false boxes a frame at IoU 0.3."""

    f1_30: float
    f1_50: float
    precision: float
    recall: float
    false_per_frame: float

    @classmethod
    def of(cls, run: ClipRun, counting: str) -> Figures:
        """counting: a key of ``COUNTINGS``."""
        loose, strict = run.scores(counting)
        return cls(loose.f1, strict.f1, loose.precision, loose.recall, loose.false_per_frame)

    @classmethod
    def mean(cls, figures: Sequence[Figures]) -> Figures:
        """Every clip with the same weight."""
        return cls(*map(float, np.mean([tuple(asdict(one).values()) for one in figures], axis=0)))


@dataclass(frozen=True)
class ClipFigures:
    """``countings``: figures by counting; ``frame_ms``: median compute time a frame."""

    countings: Mapping[str, Figures]
    frame_ms: float


@dataclass(frozen=True)
class Record:
    """One run over clips. ``settings``: changes on top of the presets; ``commit``: of the code, '' if unknown."""

    name: str
    date: str
    commit: str
    settings: Mapping[str, Any]
    clips: Mapping[str, ClipFigures]

    def figures(self, counting: str) -> dict[str, Figures]:
        """By clip."""
        return {name: clip.countings[counting] for name, clip in self.clips.items()}


def make_record(name: str, runs: Sequence[ClipRun], settings: Mapping[str, Any]) -> Record:
    """Figures of what was just run, dated now."""
    clips = {run.clip.name: ClipFigures({key: Figures.of(run, key) for key in COUNTINGS}, run.frame_ms)
             for run in runs}
    return Record(name, datetime.now(UTC).date().isoformat(), code_version(), dict(settings), clips)


def code_version() -> str:
    """Short commit of the package's own repository, with a plus where files differ from it; '' without git."""
    try:
        described = subprocess.run(
            ['git', 'describe', '--always', '--dirty=+', '--exclude=*'], check=True, capture_output=True, text=True,
            cwd=Path(__file__).parent, timeout=30)
    except (OSError, subprocess.SubprocessError):
        return ''
    return described.stdout.strip()


def read_records(path: Path) -> list[Record]:
    """All runs of a file, oldest first; none where there is no file. Raises: SourceError."""
    if not path.is_file():
        return []
    try:
        document = json.loads(path.read_text(encoding='utf-8'))
        return [_record(entry) for entry in document['runs']]
    except (ValueError, KeyError, TypeError) as error:
        raise SourceError(f'{path}: expected a record of accuracy runs, got {type(error).__name__} {error}') from None


def append_record(path: Path, record: Record) -> None:
    """Add a run at the end of the file, which is made where it is missing. Raises: SourceError."""
    runs = [*read_records(path), record]
    content = {'runs': [_rounded(asdict(run)) for run in runs]}
    try:
        path.write_text(json.dumps(content, indent=1) + '\n', encoding='utf-8')
    except OSError as error:
        raise SourceError(f'{path}: the run cannot be recorded: {error.strerror}') from None


def record_named(records: Sequence[Record], name: str | None) -> Record | None:
    """The latest run, or the latest of that name; None where there is none yet. Raises: SourceError."""
    if name is None:
        return records[-1] if records else None
    for record in reversed(records):
        if record.name == name:
            return record
    known = ', '.join(dict.fromkeys(record.name for record in records)) or 'none'
    raise SourceError(f'--against: expected the name of a recorded run ({known}), got {name!r}')


def _record(entry: dict[str, Any]) -> Record:
    clips = {name: ClipFigures({key: Figures(**figures) for key, figures in clip['countings'].items()},
                               float(clip['frame_ms']))
             for name, clip in entry['clips'].items()}
    return Record(entry['name'], entry['date'], entry['commit'], entry['settings'], clips)


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(item) for name, item in value.items()}
    return round(value, 4) if isinstance(value, float) else value
