"""Ids of tracks that no earlier process of the same machine has given."""

from __future__ import annotations

import time

from rclpy.node import Node

from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.core.types import MAX_ID

#: Ids count from this time on, s since 1970 (1 January 2026), and grow by so many a second: a process that confirms
#: fewer objects a second stays behind the first id of the next. That fills uint32 in 2039; then they start again at 1.
EPOCH_S, IDS_PER_S = 1_767_225_600, 10


def first_id(now_s: float) -> int:
    """The first id of a process that starts now, s since 1970; 1 where the clock is not set."""
    return 1 + max(0, round((now_s - EPOCH_S) * IDS_PER_S)) % MAX_ID


def declare_first_id(node: Node) -> int:
    """The first id of this process, from the parameter ``first_id``."""
    given = int(declare_simple(
        node, 'first_id', 0, 'id of the first track; 0: by the clock, so that ids grow over restarts', 0, MAX_ID))
    return given or first_id(time.time())
