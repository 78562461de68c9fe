"""A camera that stands still, recognised without features (``ego_motion.static_px``).

Patches on a fixed grid: one Lucas-Kanade step from no motion, on the gradient of the mean of both frames so that their
noise does not bias it, with an offset of the grey values (Lucas and Kanade 1981). An affine motion is fitted to their
displacements. The camera stands still where no corner of the picture can have moved by ``static_px`` since the last
frame, nor since ``LOOK_BACK`` frames ago, the fits' uncertainty included: a drift that rounding or a video codec hides
from frame to frame adds up. Displacements that are too long for one step scatter and make the fit uncertain.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_measured import EgoMethod, Measured, believable, centre_of
from motion_detect_ros.core.motion_models import FAMILIES, displacement, jacobian, model_family, normalised
from motion_detect_ros.core.robust_fit import MotionFit, refine_motion
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, EgoStatus, FloatArray, PreparedFrame

#: Rows and columns of patches, and their side, working-resolution pixels, before two are lost all around.
GRID, SIDE_PX = (12, 16), 31
#: Mean squared gradient of a patch in its weaker direction, (grey levels per pixel)^2, under which it is not asked.
MIN_ENERGY = 1.0
#: Patches needed, and the share of them that must agree.
MIN_PATCHES, MIN_AGREE = 24, 0.5
#: Frames that must have passed without motion.
LOOK_BACK = 8
#: Standard deviations that the limit lies above what is measured.
SIGMAS = 3.0


@dataclass(frozen=True)
class Sampled:
    """``patches``: (N, n, n) smoothed; ``centres``: (N, 2) working-resolution pixels; ``scene``: (N,) unmasked."""

    frame: PreparedFrame
    patches: FloatArray
    centres: FloatArray
    scene: BoolArray


class StillFirst:
    """Looks whether the camera stands still, and asks ``method`` where it does not."""

    def __init__(self, config: EgoMotionConfig, method: EgoMethod) -> None:
        self._limit_px = config.static_px
        self._kind = model_family(config.model).kind
        self._method = method
        self._past: deque[Sampled] = deque(maxlen=LOOK_BACK)

    def measure(self, previous: PreparedFrame, frame: PreparedFrame, prior: DoubleArray | None = None) -> Measured:
        """As ``EgoMethod``; of a camera that stands still the identity."""
        if not self._past or self._past[-1].frame is not previous:
            self._past.clear()
            self._past.append(sampled(previous))
        earliest, last, complete = self._past[0], self._past[-1], len(self._past) == LOOK_BACK
        self._past.append(sampled(frame))
        still = self._still(last, self._past[-1]) if complete else None
        if still is None or self._still(earliest, self._past[-1]) is None:
            return self._method.measure(previous, frame, prior)
        return Measured(still, EgoStatus.OK, len(still.inliers))

    def _still(self, earlier: Sampled, later: Sampled) -> MotionFit | None:
        """No motion, with the measured one as part of its uncertainty; None where there may be some."""
        frame, centre = later.frame, centre_of(later.frame)
        points, shift = patch_displacements(earlier, later)
        if len(points) < MIN_PATCHES:
            return None
        points, shift = points / np.float32(frame.scale), shift / np.float32(frame.scale)
        fit = refine_motion(FAMILIES['affine'], points, points + shift, np.zeros(8), centre)
        if fit is None or not believable(fit, centre) or fit.inliers.mean() < MIN_AGREE:
            return None
        if _farthest(fit, centre) >= self._limit_px:
            return None
        covariance = fit.covariance + np.outer(fit.theta, fit.theta)
        return MotionFit(np.zeros(8), covariance, fit.inliers, fit.residual_px, self._kind)


def sampled(frame: PreparedFrame) -> Sampled:
    """The patches of ``frame``, of N = 12 x 16; the frame is larger than one of them (``SIDE_PX``)."""
    y, x = (np.linspace(0, side - SIDE_PX, count).astype(np.int64)
            for side, count in zip(frame.gray.shape, GRID, strict=True))
    scene = np.ones(len(y) * len(x), np.bool_)
    if frame.mask is not None:
        scene = _patches(frame.mask.view(np.uint8), y, x).min(axis=(1, 2)) > 0
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float32) + np.float32((SIDE_PX - 1) / 2)
    return Sampled(frame, _blurred(_patches(frame.gray, y, x).astype(np.float32)), centres, scene)


def patch_displacements(earlier: Sampled, later: Sampled) -> tuple[FloatArray, FloatArray]:
    """(N, 2) centres of the earlier frame's textured patches and (N, 2) how they moved, float32 working pixels.

    Source: one step of Lucas and Kanade 1981, with an offset of the grey values.
    """
    twice = earlier.patches + later.patches
    pixels = (len(twice), (SIDE_PX - 4) ** 2)
    gx = ((twice[:, 1:-1, 2:] - twice[:, 1:-1, :-2]) * np.float32(0.25)).reshape(pixels)
    gy = ((twice[:, 2:, 1:-1] - twice[:, :-2, 1:-1]) * np.float32(0.25)).reshape(pixels)
    change = (later.patches - earlier.patches)[:, 1:-1, 1:-1].reshape(pixels)
    xx, xy, yy = _covariance(gx, gx), _covariance(gx, gy), _covariance(gy, gy)
    tx, ty = _covariance(gx, change), _covariance(gy, change)
    use = earlier.scene & (0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy) > MIN_ENERGY)
    determinant = (xx * yy - xy * xy)[use]
    shift = np.column_stack([(xy * ty - yy * tx)[use], (xy * tx - xx * ty)[use]]) / determinant[:, None]
    return earlier.centres[use], shift.astype(np.float32)


def _covariance(one: FloatArray, other: FloatArray) -> DoubleArray:
    """(N,) of each row."""
    product = np.einsum('ij,ij->i', one, other) / one.shape[1]
    return np.asarray(product - one.mean(axis=1) * other.mean(axis=1), np.float64)


def _patches(image: ByteArray, y: np.ndarray, x: np.ndarray) -> ByteArray:
    """(N, SIDE_PX, SIDE_PX)."""
    windows = sliding_window_view(image, (SIDE_PX, SIDE_PX))
    return np.asarray(windows[np.ix_(y, x)].reshape(-1, SIDE_PX, SIDE_PX), np.uint8)


def _blurred(patches: FloatArray) -> FloatArray:
    """Binomial filter of three; one pixel is lost all around."""
    stacked = cv2.GaussianBlur(patches.reshape(-1, SIDE_PX), (3, 3), 0)
    return np.asarray(stacked.reshape(patches.shape)[:, 1:-1, 1:-1], np.float32)


def _farthest(fit: MotionFit, centre: DoubleArray) -> float:
    """How far a corner can have moved at most, pixels."""
    width, height = 2.0 * centre
    corners = normalised(np.array([[0, 0], [width, 0], [0, height], [width, height]], np.float32), centre)
    family = FAMILIES['affine']
    slopes = jacobian(family, fit.theta, corners, centre)
    sigma = np.sqrt([np.linalg.eigvalsh(slope @ fit.covariance @ slope.T)[-1] for slope in slopes])
    moved = np.linalg.norm(displacement(family, fit.theta, corners, centre), axis=1)
    return float((moved + SIGMAS * sigma).max())
