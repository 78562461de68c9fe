"""Lenses: pixels of the image as the sensor gives it <-> the image plane of an ideal pinhole camera.

Sources: Brown 1966 (``plumb_bob``, ``rational_polynomial``), Kannala and Brandt 2006 (``equidistant``, wide lenses), as
implemented by OpenCV.
"""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.types import BoolArray, CameraModel, DoubleArray, FloatArray

#: A pixel and what its ray makes of it may be so far apart, pixels.
MAX_OFF_PX = 1.0
#: When the iteration that inverts the distortion ends: number of steps, change.
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)


def undistorted(points: FloatArray | DoubleArray, camera: CameraModel) -> DoubleArray:
    """(N, 2) pixels -> coordinates on the image plane at distance one, without the distortion of the lens.

    NaN beyond the angle from which on a calibrated polynomial turns back, and at 90 degrees and more from the axis,
    where there is no point on the image plane.
    """
    pixels = np.ascontiguousarray(points, np.float64).reshape(-1, 1, 2)
    if not camera.distortion or not len(pixels):
        plain: DoubleArray = (pixels[:, 0] - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        return plain
    lens = np.array(camera.distortion)
    if camera.fisheye:
        found = cv2.fisheye.undistortPoints(pixels, camera.matrix, lens)
    elif hasattr(cv2, 'undistortPointsIter'):  # up to OpenCV 4
        found = cv2.undistortPointsIter(pixels, camera.matrix, lens, None, None, _CRITERIA)
    else:
        found = cv2.undistortPoints(pixels, camera.matrix, lens, criteria=_CRITERIA)
    plane = np.asarray(found, np.float64).reshape(-1, 2)
    plane[~_known(plane, pixels[:, 0], camera)] = np.nan
    return plane


def _known(found: DoubleArray, pixels: DoubleArray, camera: CameraModel) -> BoolArray:
    """(N,) whether the lens shows ``found``, (N, 2) on the image plane, at these pixels, (N, 2)."""
    finite = np.isfinite(found[:, 0]) & np.isfinite(found[:, 1])
    off = np.abs(distorted(np.where(finite[:, None], found, 0.0), camera) - pixels)
    known: BoolArray = finite & (off.max(axis=1) <= MAX_OFF_PX)
    return known


def distorted(points: DoubleArray, camera: CameraModel) -> DoubleArray:
    """(N, 2) coordinates on the image plane at distance one -> pixels: the inverse of ``undistorted``.

    Points outside of the picture may be anywhere, as no lens is calibrated for them.
    """
    if not camera.distortion or not np.isfinite(points).all():
        plain: DoubleArray = points * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        return plain
    scene = np.c_[points, np.ones(len(points))].reshape(-1, 1, 3)
    project = cv2.fisheye.projectPoints if camera.fisheye else cv2.projectPoints
    pixels, _ = project(scene, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    return np.asarray(pixels, np.float64).reshape(-1, 2)
