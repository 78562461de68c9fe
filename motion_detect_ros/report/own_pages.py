"""Which files a report may replace: pages of earlier reports, nothing else."""

from __future__ import annotations

from pathlib import Path

from motion_detect_ros.core.errors import SourceError

#: How the titles of the pages end, and within how many bytes of a page.
_TITLES, _HEAD_BYTES = ('\N{EN DASH} moving objects</title>', '\N{EN DASH} replays</title>'), 8192


def check_replaceable(path: Path) -> None:
    """Raises: SourceError where there is a folder, or a file that is no page of an earlier report; OSError where nobody
    can look.
    """
    if path.is_dir():
        raise SourceError(f'{path}: expected a file to write, got a folder')
    if not path.exists():
        return
    with path.open('rb') as stream:
        head = stream.read(_HEAD_BYTES).decode('utf-8', errors='replace')
    if head and not any(title in head for title in _TITLES):
        raise SourceError(f'{path}: exists and is no earlier report; choose another --output')
