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
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, EgoStatus, FloatArray, PreparedFrame

#: Shorter side of the coarsest level at least, pixels, and blur of the finest.
MIN_SIDE_PX, BLUR_PX = 24, 0.8
#: Pixels with a gradient that are needed on the finest level.
MIN_PIXELS = 300
#: Steps for each family on the coarsest level, on the others, and on the finest.
COARSEST_ROUNDS, ROUNDS, FINEST_ROUNDS = 15, 10, 6
#: Correlation of the grey values under the warp, from which it explains the image.
MIN_CORRELATION = 0.5
#: From level to level of the pyramid: every other pixel, starting with the first.
HALF = np.diag([0.5, 0.5, 1.0])


class DirectMethod:
    """Registers the frames over a pyramid; on its top the families in turn, from translation up to the wanted one."""

    def __init__(self, config: EgoMotionConfig) -> None:
        self._family = model_family(config.model)
        order = list(FAMILIES.values())
        self._families = order[:order.index(self._family) + 1]

    def measure(
        self, previous: PreparedFrame, frame: PreparedFrame, prior: DoubleArray | None = None,
    ) -> EgoMotionMeasurement:
        """As ``EgoMethod``; ``prior`` is the start on the coarsest level."""
        levels = list(zip(pyramid(previous.gray), pyramid(frame.gray), masks(previous), strict=True))
        templates = [make_template(earlier, mask) for earlier, _, mask in levels]
        pixels = len(templates[0].points)
        if pixels < MIN_PIXELS:
            return EgoMotionMeasurement(None, EgoStatus.LOW_TEXTURE, pixels)
        matrix = np.eye(3) if prior is None else at_scale(prior, frame.scale)
        top = np.linalg.matrix_power(HALF, len(levels) - 1)
        found = self._coarse_to_fine(templates, [later for _, later, _ in levels], top @ matrix @ np.linalg.inv(top))
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


def pyramid(gray: ByteArray) -> list[FloatArray]:
    """(h, w) float32 images, finest first, each half the size of the one before (Burt and Adelson 1983)."""
    levels = [cv2.GaussianBlur(gray, (0, 0), BLUR_PX).astype(np.float32)]
    while min(levels[-1].shape) >= 2 * MIN_SIDE_PX:
        levels.append(cv2.pyrDown(levels[-1]))
    return levels


def masks(frame: PreparedFrame) -> list[BoolArray | None]:
    """The frame's mask on every level of ``pyramid``, (h, w) bool each, finest first; None where it has none."""
    levels: list[BoolArray | None] = [frame.mask]
    side = min(frame.gray.shape)
    while side >= 2 * MIN_SIDE_PX:
        finer = levels[-1]
        levels.append(None if finer is None else np.ascontiguousarray(finer[::2, ::2]))
        side = (side + 1) // 2
    return levels


def _at_full_size(found: Registration, frame: PreparedFrame, family: ModelFamily) -> MotionFit:
    """Theta is in pixels, so it grows with the image."""
    matrix = at_scale(found.matrix, 1.0 / frame.scale)
    return MotionFit(matrix_theta(matrix, centre_of(frame)), found.covariance / frame.scale ** 2, found.inliers,
                     found.residual_px / frame.scale, family.kind)
