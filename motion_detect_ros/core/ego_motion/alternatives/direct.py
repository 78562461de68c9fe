"""Ego-motion from the grey values themselves (``ego_motion.method: direct``)."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion.alternatives.registration import (
    Registration,
    Template,
    align,
    assess,
    make_template,
)
from motion_detect_ros.core.ego_motion.measurement import EgoMotionMeasurement, centre_of, is_plausible
from motion_detect_ros.core.ego_motion.robust_fit import MotionFit
from motion_detect_ros.core.geometry.motion_models import FAMILIES, ModelFamily, matrix_theta, model_family
from motion_detect_ros.core.geometry.warp import at_scale
from motion_detect_ros.core.preprocessing.alternatives.pyramids import gaussian_pyramid, laplacian_pyramid, reconstruct
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, EgoStatus, FloatArray, PreparedFrame

#: Shorter side of the coarsest level at least, pixels, and blur of the finest.
MIN_SIDE_PX, BLUR_PX = 24, 0.8
#: Maximum number of levels above the image, and levels of details: a pixel of the last one is eight pixels wide.
MAX_LEVELS, DETAIL_LEVELS = 10, 3
#: Pixels with a gradient that are needed on the finest level.
MIN_PIXELS = 300
#: Steps for each family on the coarsest level, on the others, and on the finest.
COARSEST_ROUNDS, ROUNDS, FINEST_ROUNDS = 15, 10, 6
#: Least correlation of the grey values under the warp.
MIN_CORRELATION = 0.5
#: From level to level of the pyramid: every other pixel, starting with the first.
HALF = np.diag([0.5, 0.5, 1.0])


class DirectMethod:
    """Registers the frames over a pyramid; at its top the families in turn, from translation to the configured one."""

    def __init__(self, config: EgoMotionConfig) -> None:
        self._family = model_family(config.model)
        self._pyramid = PYRAMIDS[config.pyramid]
        order = list(FAMILIES.values())
        self._families = order[:order.index(self._family) + 1]

    def measure(
        self, previous: PreparedFrame, frame: PreparedFrame, prior: DoubleArray | None = None,
    ) -> EgoMotionMeasurement:
        """As ``EgoMethod``; ``prior`` is the start on the coarsest level."""
        earlier, later = self._pyramid(previous.gray), self._pyramid(frame.gray)
        templates = [make_template(*each) for each in zip(earlier, masks(previous, len(earlier)), strict=True)]
        pixels = len(templates[0].points)
        if pixels < MIN_PIXELS:
            return EgoMotionMeasurement(None, EgoStatus.LOW_TEXTURE, pixels)
        matrix = np.eye(3) if prior is None else at_scale(prior, frame.scale)
        top = np.linalg.matrix_power(HALF, len(later) - 1)
        found = self._coarse_to_fine(templates, later, top @ matrix @ np.linalg.inv(top))
        if found is None or not found.correlation >= MIN_CORRELATION:
            return EgoMotionMeasurement(None, EgoStatus.DEGENERATE, pixels)
        fit = _at_full_size(found, frame, self._family)
        if not is_plausible(fit, centre_of(frame)):
            return EgoMotionMeasurement(None, EgoStatus.DEGENERATE, pixels)
        return EgoMotionMeasurement(fit, EgoStatus.OK, pixels)

    def _coarse_to_fine(
        self, templates: list[Template], images: list[FloatArray], matrix: DoubleArray,
    ) -> Registration | None:
        for level in reversed(range(len(images))):
            coarsest = level == len(images) - 1
            rounds = COARSEST_ROUNDS if coarsest else ROUNDS if level else FINEST_ROUNDS
            for family in self._families if coarsest else [self._family]:
                found = align(templates[level], images[level], family, matrix, rounds)
                matrix = matrix if found is None else found
            if level:
                matrix = np.linalg.inv(HALF) @ matrix @ HALF
        return assess(templates[0], images[0], self._family, matrix)


def gaussian_levels(gray: ByteArray) -> list[FloatArray]:
    """(h, w) float32 grey values, finest first, each half the size of the one before."""
    return gaussian_pyramid(cv2.GaussianBlur(gray, (0, 0), BLUR_PX), MAX_LEVELS, MIN_SIDE_PX)


def laplacian_levels(gray: ByteArray) -> list[FloatArray]:
    """The same of the details of a Laplacian pyramid, without its last level.

    Illumination that varies slowly over the image is in that level only.
    """
    *details, rest = laplacian_pyramid(cv2.GaussianBlur(gray, (0, 0), BLUR_PX), DETAIL_LEVELS, MIN_SIDE_PX)
    return gaussian_pyramid(reconstruct([*details, np.zeros_like(rest)]), MAX_LEVELS, MIN_SIDE_PX)


#: What ``ego_motion.pyramid`` may name.
PYRAMIDS = {'gaussian': gaussian_levels, 'laplacian': laplacian_levels}


def masks(frame: PreparedFrame, levels: int) -> list[BoolArray | None]:
    """The frame's mask on so many levels of a pyramid, (h, w) bool each, finest first; None where it has none."""
    found: list[BoolArray | None] = [frame.mask]
    while len(found) < levels:
        finer = found[-1]
        found.append(None if finer is None else np.ascontiguousarray(finer[::2, ::2]))
    return found


def _at_full_size(found: Registration, frame: PreparedFrame, family: ModelFamily) -> MotionFit:
    """Theta is in pixels, so it grows with the image."""
    matrix = at_scale(found.matrix, 1.0 / frame.scale)
    return MotionFit(matrix_theta(matrix, centre_of(frame)), found.covariance / frame.scale ** 2, found.inliers,
                     found.residual_px / frame.scale, family.kind)
