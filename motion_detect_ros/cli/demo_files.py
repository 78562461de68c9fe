"""What the demo wrote, by which it knows its own files and replaces nobody else's."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.files import write_whole
from motion_detect_ros.sources.part_file import part_of

#: Name, size (bytes) and time of each file that it wrote.
RECORD_NAME = 'demo.json'
#: Its film, with what was found in it.
VIDEO = 'demo.mp4'


def begin(folder: Path, names: Sequence[str]) -> None:
    """Make the folder one of the demo. Raises: SourceError where it holds files of these names that are not its own."""
    record = folder / RECORD_NAME
    own = _read(record)
    for file in map(folder.joinpath, names):
        parts = part_of(file), file.with_name(f'{file.stem}.part{file.suffix}')
        for each in (file, *parts) if own is None else (file,):
            if each.exists() and (own is None or own.get(file.name) != _state(file)):
                raise _refused(each)
    if own is None and record.exists():
        raise _refused(record)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SourceError(f'{folder}: cannot be made a folder for the outputs: {error.strerror}') from None
    note(folder, names)


def note(folder: Path, names: Sequence[str]) -> None:
    """Record which of its files there are now."""
    files = {name: _state(folder / name) for name in names if (folder / name).exists()}
    write_whole(folder / RECORD_NAME, json.dumps(files, indent=2) + '\n')


def _read(record: Path) -> dict[str, list[int]] | None:
    """What was recorded; None for nothing, or nothing of the demo."""
    try:
        content = json.loads(record.read_text(encoding='utf-8'))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _state(file: Path) -> list[int]:
    status = file.stat()
    return [status.st_size, status.st_mtime_ns]


def _refused(file: Path) -> SourceError:
    return SourceError(f'{file}: exists and is not of an earlier demo; choose another --output')
