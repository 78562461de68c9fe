"""Forward and backward flow between two images, and the check of one by the other (Sundaram et al. 2010)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.flow_methods.flow_function import FlowFunction
from motion_detect_ros.core.geometry.resizing import averaged
from motion_detect_ros.core.geometry.warp import grid_points
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import ByteArray, FloatArray

#: Share of the squared lengths of both flows that their disagreement may reach (Sundaram et al. 2010, equation 5).
CONSISTENT_SHARE = 0.01


@dataclass(frozen=True)
class BackwardWorker:
    """Computes the backward flow while the caller computes the forward flow.

    ``flow``: a second instance of the method, as most keep buffers between calls; ``pool``: one worker thread.
    """

    flow: FlowFunction
    pool: ThreadPoolExecutor


def forward_backward_flow(
    flow: FlowFunction, current: ByteArray, reference: ByteArray, rows: int, columns: int, limit_px: float,
    worker: BackwardWorker | None = None,
) -> FloatArray:
    """(rows, columns, 2) displacement from ``current`` to ``reference``, NaN where forward and backward disagree.

    The check runs on flow averaged over the cells of the grid. limit_px: largest distance between
    a point and where forward and backward flow lead it, plus a share of their lengths. worker: computes the backward
    flow at the same time, None = ``flow`` does, afterwards. The result is the same with and without it.
    """
    def one_way(method: FlowFunction, one: ByteArray, other: ByteArray) -> FloatArray:
        return averaged(method(one, other), rows, columns)

    if worker is None:
        forward, backward = one_way(flow, current, reference), one_way(flow, reference, current)
    else:
        submitted = worker.pool.submit(one_way, worker.flow, reference, current)
        forward, backward = one_way(flow, current, reference), submitted.result()
    cell_px = np.array([current.shape[1] / columns, current.shape[0] / rows], np.float32)
    target = forward / cell_px + grid_points(rows, columns, columns, rows)
    returned = cv2.remap(backward, target, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    checked = np.full(forward.shape, np.nan, np.float32)
    _keep_consistent(forward, returned, np.float32(limit_px ** 2), checked)
    return checked


@kernel()
def _keep_consistent(forward, returned, limit_squared, checked):  # type: ignore[no-untyped-def]
    """``checked``: NaN, then ``forward`` (rows, columns, 2) where ``returned``, backward flow at its end, agrees."""
    for r in range(forward.shape[0]):
        for c in range(forward.shape[1]):
            dx, dy, back_x, back_y = forward[r, c, 0], forward[r, c, 1], returned[r, c, 0], returned[r, c, 1]
            error = (dx + back_x) * (dx + back_x) + (dy + back_y) * (dy + back_y)
            length = (dx * dx + dy * dy) + (back_x * back_x + back_y * back_y)
            if error <= limit_squared + np.float32(CONSISTENT_SHARE) * length:
                checked[r, c, 0], checked[r, c, 1] = dx, dy
