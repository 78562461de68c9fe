"""Files of Fast DDS in shared memory, by the process that they belong to."""

from __future__ import annotations

import re
import struct
import time
from contextlib import suppress
from pathlib import Path

from motion_detect_ros.bridge.shared_memory import FOLDER

#: Of a port: milliseconds after which a reader that does not answer is taken for dead, and a third of them; so many
#: bytes before stands when somebody last looked whether the readers answer, milliseconds since 1970.
_DEAD_MS, _CHECKED, _CHECKED_BEFORE = struct.pack('=2I', 1000, 333), struct.Struct('=q'), 28


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


def set_back_checks() -> None:
    """Ports that somebody looked at in the future, as a clock of his own told him, are as if it were now.

    Until that time comes nobody looks again, and such a file stays for whoever gets the port next.
    """
    for path in FOLDER.iterdir():
        if re.fullmatch(r'fastrtps_port\d+', path.name):
            _set_back(path)


def _set_back(port: Path) -> None:
    now_ms = time.time_ns() // 1_000_000
    with suppress(OSError), port.open('r+b') as file:  # gone by now, or another user's
        place = file.read(4096).find(_DEAD_MS) - _CHECKED_BEFORE
        if place >= 0:
            file.seek(place)
            checked_ms, = _CHECKED.unpack(file.read(_CHECKED.size))
            if checked_ms > now_ms:
                file.seek(place)
                file.write(_CHECKED.pack(now_ms))
