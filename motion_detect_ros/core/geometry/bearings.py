"""Where an object is seen from: unit rays in the optical frame."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.types import CameraModel, RecordArray


def bearings(records: RecordArray, camera: CameraModel | None) -> RecordArray:
    """Fills ``bearing_x, _y, _z`` with the unit ray in the optical frame (z forward); NaN without a camera model.

    records: dtype ``DETECTION_DTYPE``, changed in place and returned.
    """
    if camera is None or not len(records):
        return records
    x = (records['u'] - camera.cx) / camera.fx
    y = (records['v'] - camera.cy) / camera.fy
    length = np.sqrt(x * x + y * y + 1.0)
    records['bearing_x'], records['bearing_y'], records['bearing_z'] = x / length, y / length, 1.0 / length
    return records
