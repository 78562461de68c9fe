"""Families of background motion: translation, similarity, affine, homography, quadratic.

All share eight parameters theta = (a0 .. a5, p, q), all in pixels. With X = (x - centre) / reach, reach = half the
image's diagonal, a = (a0, a3), A = [[a1, a2], [a4, a5]], P = (p, q):

    homography  x' = centre + a + (reach X + A X) / (1 + P.X / reach)
    quadratic   x' = x + a + A X - X (P.X)      the flow of a plane (Bergen et al. 1992, equation 8: a7 = -p, a8 = -q)

The others are the same with P = 0 and A restricted. ``a`` is the displacement of the centre and A / reach its
derivative there, whatever P is: the affine part of a warp is its first-order approximation at the centre.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.types import DoubleArray, FloatArray, MotionModel

#: Displacements tried as the translation that most points agree with.
TRANSLATION_TRIALS = 256

Start = Callable[[FloatArray, FloatArray, float], DoubleArray | None]


@dataclass(frozen=True)
class ModelFamily:
    """``basis``: (8, k), theta = basis @ free parameters; ``start``: (points, moved, threshold_px) -> (3, 3) by RANSAC.

    ``polynomial``: the displacement is linear in theta; else there is a perspective division.
    """

    kind: MotionModel
    basis: DoubleArray
    start: Start
    polynomial: bool = True


def model_family(name: str) -> ModelFamily:
    """The family of the setting ``ego_motion.model``. Raises: ConfigError for an unknown name."""
    if name not in FAMILIES:
        raise ConfigError(f'ego_motion.model: expected one of {", ".join(FAMILIES)}, got {name!r}')
    return FAMILIES[name]


def theta_matrix(theta: DoubleArray, centre: DoubleArray) -> DoubleArray:
    """(8,) theta -> (3, 3) previous pixel -> current pixel, scaled to 1 in the last element.

    Exact but for the quadratic: there it is the homography with the same value and derivative at the centre. With
    r = P.X / reach it displaces by (reach X + A X) r^2 / (1 + r) - A X r more: of second order in theta.
    """
    reach = _reach(centre)
    a, slopes, perspective = theta[[0, 3]] / reach, theta[[[1, 2], [4, 5]]] / reach, theta[6:] / reach
    normal = np.eye(3)
    normal[:2, :2] += slopes + np.outer(a, perspective)
    normal[:2, 2] = a
    normal[2, :2] = perspective
    matrix = _from_normal(centre) @ normal @ _to_normal(centre)
    scaled: DoubleArray = matrix / matrix[2, 2]
    return scaled


def matrix_theta(matrix: DoubleArray, centre: DoubleArray) -> DoubleArray:
    """(3, 3) previous pixel -> current pixel to (8,) theta of the homography, pixels: the inverse of ``theta_matrix``.

    centre: (2,) of the image, pixels.
    """
    normal = _to_normal(centre) @ matrix @ _from_normal(centre)
    normal = normal / normal[2, 2]
    a, perspective = normal[:2, 2], normal[2, :2]
    slopes = normal[:2, :2] - np.eye(2) - np.outer(a, perspective)
    return _reach(centre) * np.array([a[0], *slopes[0], a[1], *slopes[1], *perspective])


def normalised(points: FloatArray, centre: DoubleArray) -> DoubleArray:
    """(N, 2) float32 pixels -> (N, 2) X, without unit. centre: (2,) of the image, pixels."""
    scaled: DoubleArray = (points.astype(np.float64) - centre) / _reach(centre)
    return scaled


def displacement(family: ModelFamily, theta: DoubleArray, x: DoubleArray, centre: DoubleArray) -> DoubleArray:
    """(N, 2) pixels that points move by. theta: (8,) pixels; x: (N, 2) X as of ``normalised``; centre: (2,) pixels.

    Source: Bergen et al. 1992, equations 7 (affine) and 8 (quadratic).
    """
    a, reach = theta[[0, 3]], _reach(centre)
    turned = x @ theta[[[1, 2], [4, 5]]].T
    along = (x @ theta[6:])[:, None]
    if family.polynomial:
        moved: DoubleArray = a + turned - x * along
        return moved
    moved = a + (reach * x + turned) / (1.0 + along / reach) - reach * x
    return moved


def jacobian(family: ModelFamily, theta: DoubleArray, x: DoubleArray, centre: DoubleArray) -> DoubleArray:
    """(N, 2, 8) derivative of ``displacement`` by theta, without unit; arguments as there."""
    reach, count = _reach(centre), len(x)
    depth, ray = np.ones(count), x
    if not family.polynomial:
        depth = 1.0 + x @ theta[6:] / reach
        ray = x + x @ theta[[[1, 2], [4, 5]]].T / reach
    out = np.zeros((8, 2, count))  # in the order in which the normal equations read it
    out[0, 0] = out[3, 1] = 1.0
    out[1:3, 0] = out[4:6, 1] = x.T / depth
    out[6:] = -ray.T * x.T[:, None] / depth ** 2
    return out.transpose(2, 1, 0)


def _reach(centre: DoubleArray) -> float:
    return float(np.hypot(centre[0], centre[1]))


def _to_normal(centre: DoubleArray) -> DoubleArray:
    scale = 1.0 / _reach(centre)
    return np.array([[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]])


def _from_normal(centre: DoubleArray) -> DoubleArray:
    """The inverse of ``_to_normal``."""
    reach = _reach(centre)
    return np.array([[reach, 0.0, centre[0]], [0.0, reach, centre[1]], [0.0, 0.0, 1.0]])


def _start_translation(points: FloatArray, moved: FloatArray, threshold_px: float) -> DoubleArray | None:
    """The median of the displacements within the threshold of the one that has the most of them."""
    shift = (moved - points).astype(np.float64)
    tried = shift[::max(1, len(shift) // TRANSLATION_TRIALS)]
    near = np.linalg.norm(tried[:, None] - shift[None], axis=2) < threshold_px
    matrix = np.eye(3)
    matrix[:2, 2] = np.median(shift[near[int(near.sum(axis=1).argmax())]], axis=0)
    return matrix


def _start_similarity(points: FloatArray, moved: FloatArray, threshold_px: float) -> DoubleArray | None:
    found, _ = cv2.estimateAffinePartial2D(points, moved, method=cv2.RANSAC, ransacReprojThreshold=threshold_px)
    return None if found is None else np.vstack([found, [0.0, 0.0, 1.0]])


def _start_affine(points: FloatArray, moved: FloatArray, threshold_px: float) -> DoubleArray | None:
    found, _ = cv2.estimateAffine2D(points, moved, method=cv2.RANSAC, ransacReprojThreshold=threshold_px)
    return None if found is None else np.vstack([found, [0.0, 0.0, 1.0]])


def _start_homography(points: FloatArray, moved: FloatArray, threshold_px: float) -> DoubleArray | None:
    found, _ = cv2.findHomography(points, moved, cv2.RANSAC, threshold_px)
    return None if found is None else np.asarray(found, np.float64)


def _columns(*groups: dict[int, float]) -> DoubleArray:
    basis = np.zeros((8, len(groups)))
    for column, group in enumerate(groups):
        basis[list(group), column] = list(group.values())
    return basis


FAMILIES: dict[str, ModelFamily] = {
    'translation': ModelFamily(MotionModel.TRANSLATION, _columns({0: 1}, {3: 1}), _start_translation),
    'similarity': ModelFamily(
        MotionModel.SIMILARITY, _columns({0: 1}, {3: 1}, {1: 1, 5: 1}, {2: 1, 4: -1}), _start_similarity),
    'affine': ModelFamily(MotionModel.AFFINE, np.eye(8)[:, :6], _start_affine),
    'homography': ModelFamily(MotionModel.HOMOGRAPHY, np.eye(8), _start_homography, polynomial=False),
    'quadratic': ModelFamily(MotionModel.QUADRATIC, np.eye(8), _start_homography),
}
