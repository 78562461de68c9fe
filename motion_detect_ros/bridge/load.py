"""The topic ``load``: what a stage took for an image, for the node that decides how much work is done."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from motion_detect_ros.bridge.qos import record_qos
from motion_detect_ros.bridge.records import checked_step, records_from_msg, records_to_msg
from motion_detect_ros.bridge.topics import Topic
from motion_detect_ros.core.errors import MessageError

LOAD_DTYPE = np.dtype([('compute_ms', '<f4'), ('load_step', 'u1'), ('stage', 'u1')])


class Stage(IntEnum):
    """Which stage tells its time."""

    OPTICAL_FLOW = 1
    ART2_CLUSTERING = 2


@dataclass(frozen=True)
class StageTime:
    """``compute_ms``: what ``stage`` took for one image, milliseconds, at the step number ``load_step``."""

    stage: Stage
    compute_ms: float
    load_step: int


def load_to_msg(told: StageTime, header: Header) -> PointCloud2:
    """The ``load`` topic: one record. header: of the image."""
    record = np.zeros(1, LOAD_DTYPE)
    record['compute_ms'], record['load_step'], record['stage'] = told.compute_ms, told.load_step, int(told.stage)
    return records_to_msg(record, header)


def load_from_msg(msg: PointCloud2) -> StageTime:
    """The time of a message. Raises: MessageError where it is none of ours."""
    records = records_from_msg(msg, LOAD_DTYPE)
    if len(records) != 1:
        raise MessageError(f'load: expected one record, got {len(records)}')
    compute_ms = float(records['compute_ms'][0])
    if not (math.isfinite(compute_ms) and compute_ms >= 0.0):
        raise MessageError(f'load: expected compute_ms of at least 0, got {compute_ms:g}')
    stage = int(records['stage'][0])
    if stage not in list(Stage):
        raise MessageError(f'load: expected stage {min(Stage)} to {max(Stage)}, got {stage}')
    return StageTime(Stage(stage), compute_ms, checked_step('load', int(records['load_step'][0])))


LOAD = Topic('load', PointCloud2, load_to_msg, load_from_msg, record_qos)
