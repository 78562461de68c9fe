"""The rows of the CSV files of a result folder."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.types import DoubleArray, EgoMotion, RecordArray, Result
from motion_detect_ros.results.metrics import boxes_of

CSV_HEADER = 'frame,stamp_ns,id,x,y,w,h,score,vel_u,vel_v,ttc'
FRAMES_HEADER = 'frame,stamp_ns,ego_status,m00,m01,m02,m10,m11,m12,detections'
TIMES_HEADER = 'frame,decode,preprocessing,ego_motion,optical_flow,clustering,total'


def csv_rows(frame: int, stamp_ns: int, records: RecordArray) -> list[str]:
    """The detections of a frame (``DETECTION_DTYPE``), a line each; x, y is the top left corner, pixels, 5 decimals."""
    figures = np.column_stack([boxes_of(records), *(records[name] for name in ('score', 'vel_u', 'vel_v', 'ttc'))])
    return [f'{frame},{stamp_ns},{identity},{numbers}'
            for identity, numbers in zip(records['id'].tolist(), with_commas(figures), strict=True)]


def with_commas(figures: DoubleArray) -> list[str]:
    """Each row of (n, m) numbers, 5 decimals."""
    numbers = ','.join(['%.5f'] * figures.shape[1])
    return [numbers % tuple(row) for row in figures.tolist()]


def frames_row(frame: int, result: Result) -> str:
    """One processed frame as a line: the ego-motion's affine part, 9 decimals, empty where there is no estimate."""
    ego = result.ego
    numbers = (f'{number:.9f}' for number in affine_part(ego, result.flow.width, result.flow.height).flat)
    matrix = ','.join(numbers) if ego.ok else ',' * 5
    return f'{frame},{result.stamp_ns},{ego.status.name.lower()},{matrix},{len(result.detections)}'


def times_row(frame: int, decode_ms: float, result: Result) -> str:
    """One processed frame's times as a line, ms, 3 decimals; the total is that of the stages, without decoding."""
    times = result.times_ms
    numbers = (decode_ms, times.preprocessing, times.ego_motion, times.optical_flow, times.clustering, times.total)
    return f'{frame},' + ','.join(f'{number:.3f}' for number in numbers)


def affine_part(ego: EgoMotion, width: int, height: int) -> DoubleArray:
    """(2, 3) affine of full-resolution pixels, from the last frame with a motion to this one; of a homography its
    linearisation at the centre of the width x height image.
    """
    matrix = ego.matrix
    if not matrix[2, :2].any():
        return matrix[:2] / matrix[2, 2]
    centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    weight = float(matrix[2] @ np.r_[centre, 1.0])
    there = matrix[:2] @ np.r_[centre, 1.0] / weight
    slope = (matrix[:2, :2] - np.outer(there, matrix[2, :2])) / weight
    return np.column_stack([slope, there - slope @ centre])
