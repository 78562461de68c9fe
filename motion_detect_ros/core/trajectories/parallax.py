"""What static points at other depths than the background plane may do: plane and parallax."""

from __future__ import annotations

import math

import cv2
import numpy as np

from motion_detect_ros.core.geometry.warp import inverse
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import CameraModel, DoubleArray, FloatArray

#: Points that the plane's homography is taken from.
HOMOGRAPHY_POINTS = 200
#: Share of the points in front of the camera, for a decomposition to be possible; and the normal that a ground has,
#: camera's axes: down and ahead.
IN_FRONT_SHARE, GROUND_NORMAL = 0.9, np.array([0.0, 0.6, 0.8])
#: Parallax of a static point, share of the plane's own shift: a little below the ground to twice as close as it; and
#: its noise, share of the parallax.
LEAST_PARALLAX, MOST_PARALLAX, PARALLAX_NOISE_SHARE = -0.05, 0.5, 0.1


def fitted_homography(earlier: FloatArray, moved: DoubleArray) -> DoubleArray | None:
    """(3, 3) that takes points ``earlier`` to ``moved``, (N, 2) pixels; None where they do not determine it."""
    chosen = slice(None, None, max(1, len(earlier) // HOMOGRAPHY_POINTS))
    homography, _ = cv2.findHomography(earlier[chosen].astype(np.float64), moved[chosen], 0)
    return None if homography is None else np.asarray(homography, np.float64)


def back_by_travel(homography: DoubleArray | None, earlier: FloatArray, camera: CameraModel) -> DoubleArray:
    """(3, 3) pixel of the background plane -> where it would be now had the camera turned, but not travelled.

    homography: (3, 3) of the plane; earlier: (N, 2) points that it takes to now, pixels; camera: of this resolution. A
    static point above the plane has moved by a share more than that. The identity where there is no such plane.
    Source: Malis and Vargas 2007 (decomposition); Irani and Anandan 1996 (plane and parallax).
    """
    if homography is None or not np.isfinite(homography).all() or abs(np.linalg.det(homography)) < 1e-9:
        return np.eye(3)
    matrix, to_ray = camera.matrix, inverse(camera.matrix)
    few = earlier[::max(1, len(earlier) // HOMOGRAPHY_POINTS)]
    rotation = _rotation(homography, matrix, few @ to_ray[:, :2].T + to_ray[:, 2])
    if rotation is None:
        return np.eye(3)
    back: DoubleArray = matrix @ rotation @ to_ray @ inverse(homography)
    return back


def _rotation(homography: DoubleArray, matrix: DoubleArray, rays: DoubleArray) -> DoubleArray | None:
    """The rotation of the solution whose plane is most like a ground, all points in front of the camera."""
    _, rotations, _, normals = cv2.decomposeHomographyMat(homography, matrix)
    in_front = np.count_nonzero(rays @ np.hstack(normals) > 0.0, axis=0) >= IN_FRONT_SHARE * len(rays)
    likely = [(float(normal[:, 0] @ GROUND_NORMAL), index) for index, normal in enumerate(normals) if in_front[index]]
    return np.asarray(rotations[max(likely)[1]], np.float64) if likely else None


@kernel(error_model='numpy')
def without_parallax(places, error, back, unexplained, noise):  # type: ignore[no-untyped-def]
    """``unexplained``: (N,) length of what parallax does not explain of ``error``, and ``noise``: (N,) its own; pixels.

    places, error: (N, 2) pixels; back: (3, 3) of ``back_by_travel``.
    """
    for n in range(len(places)):
        x, y = float(places[n, 0]), float(places[n, 1])
        depth = back[2, 0] * x + back[2, 1] * y + back[2, 2]
        shift_x = x - (back[0, 0] * x + back[0, 1] * y + back[0, 2]) / depth
        shift_y = y - (back[1, 0] * x + back[1, 1] * y + back[1, 2]) / depth
        squared = shift_x * shift_x + shift_y * shift_y
        share = (error[n, 0] * shift_x + error[n, 1] * shift_y) / (squared + 1e-6)
        share = min(max(share, LEAST_PARALLAX), MOST_PARALLAX)
        x, y = error[n, 0] - share * shift_x, error[n, 1] - share * shift_y
        unexplained[n] = math.sqrt(x * x + y * y)
        noise[n] = PARALLAX_NOISE_SHARE * abs(share) * math.sqrt(squared)
