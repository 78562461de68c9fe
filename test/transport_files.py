"""Files of Fast DDS in shared memory, by the process that they belong to."""

from __future__ import annotations

import re
from pathlib import Path


def segments_of(process: int) -> set[Path]:
    """Where it writes its messages."""
    return _locked_by(process, '[0-9a-f]{16}')


def ports_of(process: int) -> set[Path]:
    """Where it reads that there are messages for it."""
    return _locked_by(process, r'port\d+')


def _locked_by(process: int, pattern: str) -> set[Path]:
    """It holds the locks of these open."""
    links = [descriptor.readlink() for descriptor in Path(f'/proc/{process}/fd').iterdir() if descriptor.is_symlink()]
    return {link.with_name(link.name.removesuffix('_el')) for link in links
            if re.fullmatch(f'fastrtps_{pattern}_el', link.name)}
