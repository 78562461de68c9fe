"""What rosbags reads in a bag with nothing but the definitions in the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader


def contents(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    """Messages by topic as (log time, message)."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([bag]) as reader:
        for connection, stamp_ns, data in reader.messages():
            found.setdefault(connection.topic, []).append((stamp_ns, reader.deserialize(data, connection.msgtype)))
    return found
