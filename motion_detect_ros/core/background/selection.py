"""Selection of the background model, one smooth surface or static points at any depth, with hysteresis.

By Torr's geometric robust information criterion (1998, equation 9): error of fit plus a penalty for the free
coordinates of every point, two on a surface, three in space.
"""

from __future__ import annotations

import math

import numpy as np

from motion_detect_ros.core.background.noise_floor import NoiseFloor
from motion_detect_ros.core.background.planar import Background, fit_background
from motion_detect_ros.core.background.static_points import fit_static_scene
from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.geometry.epipolar import PoseEstimate
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.self_tuning import SelfTuningConfig
from motion_detect_ros.core.types import BoolArray, CameraModel, FloatArray

#: Dimensions of a correspondence, and of those the free ones on a surface and in space.
DATA_DIMENSION, SURFACE_DIMENSION, SPACE_DIMENSION = 4, 2, 3
#: Penalty of a free coordinate, per point: halfway from Torr's ln 4 (1998) to Kanatani's 2 (geometric AIC, 1998). With
#: ln 4 one large object before a camera that only turns passes for a near part of a static scene (docs/accuracy.md).
PER_DIMENSION = 0.5 * (math.log(4.0) + 2.0)
#: Truncation of the squared error, per point (Torr 1998).
OUTLIER = 2.0
#: Noise assumed of the flow when the models are compared: pixels, and share of the flow.
NOISE_PX, NOISE_SHARE = 0.3, 0.02
#: No relief where of the cells that the surface does not explain more than this share moves against its lines, those
#: apart that space does not explain either: what moves to and fro is traffic. Relief of streets leaves 0.07 (median),
#: lanes in both directions 0.31 and more.
AGAINST_SHARE = 0.25
#: Time constant of the smoothed score, seconds, and how far it must cross zero before the model changes.
SCORE_MEMORY_S, HYSTERESIS = 0.11, 0.2
#: Settings stay as they are given.
OFF = SelfTuningConfig()


class BackgroundSelector:
    """Fits the background of each frame; keeps the camera's motion and the model in use."""

    def __init__(self, config: BackgroundConfig, tuning: SelfTuningConfig = OFF) -> None:
        self._floor = NoiseFloor(config, tuning)
        self.reset()

    def use_config(self, config: BackgroundConfig) -> None:
        """Settings from the next frame on."""
        self._floor.use_config(config)

    @property
    def noise_floor_px(self) -> float:
        """The floor in use, pixels."""
        return self._floor.config.noise_floor_px

    def reset(self) -> None:
        """Clear the camera's motion; planar until the criterion changes it."""
        self._floor.reset()
        self._smooth = True
        self._motion: PoseEstimate | None = None
        self._score: float | None = None
        self.three_dimensional = False

    def fit(self, flow: FloatArray, residual: FloatArray, camera: CameraModel, dt_s: float) -> Background:
        """Background of one frame.

        flow: (gh, gw, 2) total displacement, full-resolution pixels of the camera; residual: the same without
        the ego-motion, NaN = invalid; dt_s: since the frame before.
        """
        background = self._fit(flow, residual, camera, self._floor.config, dt_s)
        if background.smooth != self._smooth:  # what the one does not explain is no noise of the other
            self._smooth = background.smooth
            self._floor.reset()
        self._floor.follow(background.spread_px, dt_s)
        return background

    def _fit(
        self, flow: FloatArray, residual: FloatArray, camera: CameraModel, config: BackgroundConfig, dt_s: float,
    ) -> Background:
        length = np.nan_to_num(magnitude(flow))
        planar = fit_background(residual, config, length)
        if config.model == 'planar':
            return planar
        sigma = NOISE_PX + NOISE_SHARE * length
        off_surface = _squared(residual, planar, sigma)
        cost, perfect = _cost(off_surface, SURFACE_DIMENSION), SPACE_DIMENSION * PER_DIMENSION
        if config.model == 'auto' and cost <= perfect and not self.three_dimensional:
            self._decide(cost - perfect, dt_s)  # even a perfect fit in space has the higher criterion
            return planar
        scene = fit_static_scene(flow, residual, length, camera, config, self._motion)
        if scene is None:
            return planar
        self._motion = scene.motion
        if config.model == 'auto':
            off_space = _squared(residual, scene.background, sigma)
            gain = cost - _cost(off_space, SPACE_DIMENSION)
            self._decide(-abs(gain) if _to_and_fro(off_surface, off_space, scene.against) else gain, dt_s)
        return scene.background if self.three_dimensional or config.model == 'epipolar' else planar

    def _decide(self, score: float, dt_s: float) -> None:
        """score: criterion of the planar less that of the three-dimensional model."""
        remembered = kept(dt_s, SCORE_MEMORY_S)
        self._score = score if self._score is None else remembered * self._score + (1.0 - remembered) * score
        self.three_dimensional = self._score > (-HYSTERESIS if self.three_dimensional else HYSTERESIS)


def _to_and_fro(off_surface: FloatArray, off_space: FloatArray, against: BoolArray) -> bool:
    """Whether too much moves against the lines for the rest to be relief: (gh, gw) squared errors, ``StaticScene``."""
    far = off_surface > _bound(SURFACE_DIMENSION)
    left = off_space > _bound(SPACE_DIMENSION)
    left &= far
    explained, back = np.count_nonzero(far) - np.count_nonzero(left), np.count_nonzero(left & against)
    return bool(back > AGAINST_SHARE * (back + explained))


def _squared(residual: FloatArray, background: Background, sigma: FloatArray) -> FloatArray:
    """(gh, gw) squared error of each cell in units of its noise; NaN where the flow is unknown."""
    error = residual - background.flow
    error *= error
    squared: FloatArray = (error[..., 0] + error[..., 1]) / (sigma * sigma)
    return squared


def _cost(squared: FloatArray, dimension: int) -> float:
    """Mean cost of a cell under a model; the number of the models' own parameters is negligible."""
    bound = _bound(dimension)
    known = squared.size - np.count_nonzero(np.isnan(squared))
    total = float(np.fmin(squared, bound).sum(dtype=np.float64)) - bound * (squared.size - known)
    return (total / known if known else 0.0) + dimension * PER_DIMENSION


def _bound(dimension: int) -> float:
    return OUTLIER * (DATA_DIMENSION - dimension)
