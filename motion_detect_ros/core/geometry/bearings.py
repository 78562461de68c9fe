"""Bearings of objects: unit rays in the optical frame."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.geometry.distortion import undistorted
from motion_detect_ros.core.types import CameraModel, RecordArray

#: Centre of the first pixel where its left or upper edge is 0.
PIXEL_CENTRE = 0.5


def bearings(records: RecordArray, camera: CameraModel | None) -> RecordArray:
    """Fills ``bearing_x, _y, _z`` with the unit ray in the optical frame (z forward); NaN without a camera model, and
    where its lens has no ray.

    records: dtype ``DETECTION_DTYPE``, changed in place and returned.
    """
    if camera is None or not len(records):
        return records
    # The box is in edges of pixels, the first of which is 0; the camera matrix has centres of pixels at whole numbers.
    x, y = undistorted(np.c_[records['u'], records['v']] - np.float64(PIXEL_CENTRE), camera).T
    length = np.sqrt(x * x + y * y + 1.0)
    records['bearing_x'], records['bearing_y'], records['bearing_z'] = x / length, y / length, 1.0 / length
    return records
