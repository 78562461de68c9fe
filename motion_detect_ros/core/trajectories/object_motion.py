"""Motion of each point against the background, over baselines up to a second, and how significant it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from motion_detect_ros.core.geometry.cells import first_of_cells
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA, rayleigh_sigma
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.geometry.warp import apply, inverse
from motion_detect_ros.core.trajectories.local_noise import PointGrid
from motion_detect_ros.core.trajectories.parallax import EpipolarParts, epipolar_parts, plane_shift, without_parallax
from motion_detect_ros.core.trajectories.plane_background import plane_is_better, plane_motion
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, CameraModel, DoubleArray

#: Times over which motion is measured, seconds, longest first; over the last one only the velocity.
BASELINES_S = (1.0, 0.48, 0.32, 0.2, 0.12)
#: The kind of background is decided once for the baselines up to this length, once for the longer ones, seconds.
SHORT_BASELINE_S = 0.4
#: Fewest points of a baseline. Background and noise are taken from one point in each cell of this size, share of the
#: image width (24 of 960 pixels): points are dense on what moves.
MIN_POINTS, SAMPLE_CELL_SHARE = 60, 0.025
#: Noise of a displacement: floor, pixels (of the point tracker), share of the background's motion beyond the
#: ego-motion, share of the camera-caused flow.
NOISE_FLOOR_PX, BACKGROUND_SHARE, CAMERA_SHARE = 0.12, 0.03, 0.01
#: Errors of points have wider tails than their median says; least deviation, pixels.
WIDE_TAILS, LEAST_SIGMA_PX = MAD_TO_SIGMA, 1e-3
#: A point moves from so many noise units and pixels on; and each part of its way must have this share of what steady
#: motion makes of it.
MOVING_SIGMAS, MOVING_PX, STEADY_SHARE = 4.0, 1.2, 0.3
#: Its velocity is that of the shortest baseline with a displacement over this, pixels.
VELOCITY_PX = 4.0
#: A scene is in relief where residuals along the epipolar lines are so much longer than across, over the longest
#: baseline up to this length, seconds; noise along them then.
RELIEF, RELIEF_BASELINE_S, RELIEF_NOISE = 1.75, 0.24, 2.5


@dataclass(frozen=True)
class PointMotion:
    """Of N points. ``velocity``: (N, 2) against the background, pixels/s, ``sigmas``: (N,) significance of the motion,
    0 where it is none; ``background``: (N, 2) velocity of the background beyond the ego-motion, pixels/s;
    ``evidence``: (N,) the largest significance over any baseline, steady or not, 0 where no way was long enough;
    ``least_speed``: (N,) from which motion would be significant, pixels/s, infinite for points too young for any;
    ``displacements``: (N, 2) each, pixels against the background over each baseline, longest first, NaN for points
    younger than that.
    """

    velocity: DoubleArray
    sigmas: DoubleArray
    background: DoubleArray
    evidence: DoubleArray
    least_speed: DoubleArray
    displacements: tuple[DoubleArray, ...] = ()

    @classmethod
    def at_rest(cls, count: int) -> PointMotion:
        """Of ``count`` points that do not move."""
        return cls(np.zeros((count, 2)), np.zeros(count), np.zeros((count, 2)), np.zeros(count),
                   np.full(count, np.inf))

    @property
    def moving(self) -> BoolArray:
        """(N,) mask."""
        moves: BoolArray = self.sigmas > 0.0
        return moves


@dataclass(frozen=True)
class _Baseline:
    """Motion over ``frames``, ``seconds``: ``motion`` (N, 2), ``length`` and ``noise`` (N,), ``background`` (N, 2),
    pixels, and ``sigmas`` (N,); NaN for points younger than that.
    """

    frames: int
    seconds: float
    motion: DoubleArray
    length: DoubleArray
    noise: DoubleArray
    background: DoubleArray
    sigmas: DoubleArray


class _Measured:
    """Raw residuals of the points of one baseline, and their background."""

    def __init__(self, points: Points, frames: RecentFrames, ago: int) -> None:
        self.frames, self.seconds = ago, frames.seconds(ago)
        self.old: BoolArray = points.age >= ago
        self.matrix = frames[ago].matrix
        self.now, self.earlier = points.now[self.old], points.path[self.old, ago]
        self.height, self.width = frames[0].gray.shape
        self.carried = apply(self.matrix, self.earlier).astype(np.float64)
        self.residual: DoubleArray = self.now - self.carried
        self.sample = first_of_cells(self.now, SAMPLE_CELL_SHARE * self.width, self.width, self.height)

    def plane_is_better(self) -> bool:
        return plane_is_better(self.now[self.sample], self.residual[self.sample], self.width, self.height)

    def background(self, plane: bool) -> DoubleArray:
        if not plane:
            return np.zeros_like(self.residual)
        return plane_motion(self.now[self.sample], self.residual[self.sample], self.now, self.width, self.height)

    def epipolar_parts(self, error: DoubleArray) -> EpipolarParts:
        return epipolar_parts(self.now, error, self.sample, self.width, self.height)


def object_motion(points: Points, frames: RecentFrames, camera: CameraModel) -> PointMotion:
    """Which points move against the background, and how fast. camera: of the working resolution."""
    baselines = _baselines(points, frames, camera)
    motion = replace(PointMotion.at_rest(len(points)), displacements=tuple(each.motion for each in baselines))
    for baseline in baselines:
        with np.errstate(invalid='ignore'):
            evidence = np.where(baseline.length > MOVING_PX, baseline.sigmas, 0.0)
            least_px = np.maximum(MOVING_PX, MOVING_SIGMAS * baseline.noise)
        np.fmax(motion.evidence, evidence, out=motion.evidence)
        np.fmin(motion.least_speed, least_px / baseline.seconds, out=motion.least_speed)
    used_s = np.zeros(len(points))
    for index, baseline in enumerate(baselines):
        shorter = _half_of(baseline, baselines[index + 1:])
        if shorter is not None:
            new = _moving(baseline, shorter) & ~motion.moving
            motion.velocity[new] = baseline.motion[new] / baseline.seconds
            motion.background[new] = baseline.background[new] / baseline.seconds
            motion.sigmas[new], used_s[new] = baseline.sigmas[new], baseline.seconds
    _refine_velocity(motion, baselines, used_s)
    return motion


def _moving(baseline: _Baseline, shorter: _Baseline) -> BoolArray:
    """Points that moved significantly, and in both parts of the time."""
    with np.errstate(invalid='ignore'):
        recent = (shorter.motion * baseline.motion).sum(axis=1) / np.maximum(baseline.length, 1e-6)
        due = baseline.length * (shorter.frames / baseline.frames)
        moving: BoolArray = (
            (baseline.sigmas > MOVING_SIGMAS) & (baseline.length > MOVING_PX) & (recent > STEADY_SHARE * due)
            & (baseline.length - recent > STEADY_SHARE * (baseline.length - due)))
    return moving


def _half_of(baseline: _Baseline, shorter: list[_Baseline]) -> _Baseline | None:
    """The baseline closest to half of this one."""
    return min(shorter, key=lambda other: abs(other.frames - baseline.frames / 2.0), default=None)


def _refine_velocity(motion: PointMotion, baselines: list[_Baseline], used_s: DoubleArray) -> None:
    """The velocity of now: over the shortest baseline that is long enough for it."""
    waiting = motion.moving
    for baseline in reversed(baselines):
        with np.errstate(invalid='ignore'):
            enough = (waiting & (baseline.length > VELOCITY_PX) & (baseline.sigmas > MOVING_SIGMAS)
                      & (baseline.seconds <= used_s))
        motion.velocity[enough] = baseline.motion[enough] / baseline.seconds
        waiting &= ~enough


def _baselines(points: Points, frames: RecentFrames, camera: CameraModel) -> list[_Baseline]:
    """Longest first; without those that the frames or too few points reach back to."""
    measured = [_Measured(points, frames, ago) for ago in _frames_ago(frames)]
    measured = [each for each in measured if len(each.now) >= MIN_POINTS]
    planes: dict[bool, bool] = {}
    for each in reversed(measured):
        is_short = each.seconds <= SHORT_BASELINE_S
        if is_short not in planes:
            planes[is_short] = each.plane_is_better()
    backgrounds = [each.background(planes[each.seconds <= SHORT_BASELINE_S]) for each in measured]
    errors = [each.residual - background for each, background in zip(measured, backgrounds, strict=True)]
    parts = _relief(measured, errors)
    return [_baseline(*each, camera, len(points)) for each in zip(measured, backgrounds, errors, parts, strict=True)]


def _frames_ago(frames: RecentFrames) -> list[int]:
    """Numbers of frames that come close to the baselines, longest first."""
    reach = frames.seconds(len(frames) - 1)
    period = reach / max(1, len(frames) - 1)
    return sorted({frames.nearest(seconds) for seconds in BASELINES_S if seconds <= reach + period / 2.0} - {0},
                  reverse=True)


def _relief(measured: list[_Measured], errors: list[DoubleArray]) -> list[EpipolarParts | None]:
    """Parts of the residuals of every baseline, None where those of a short one have no common epipole."""
    pairs = list(zip(measured, errors, strict=True))
    short = next((pair for pair in pairs if pair[0].seconds <= RELIEF_BASELINE_S), None)
    if short is None or short[0].epipolar_parts(short[1]).relief <= RELIEF:
        return [None] * len(measured)
    return [each.epipolar_parts(error) for each, error in pairs]


def _baseline(
    measured: _Measured, background: DoubleArray, error: DoubleArray, parts: EpipolarParts | None, camera: CameraModel,
    count: int,
) -> _Baseline:
    shift = plane_shift(measured.earlier, measured.carried + background, measured.now, camera)
    shared = BACKGROUND_SHARE * magnitude(background) + CAMERA_SHARE * _camera_flow(measured)
    rest, of_parallax = (error, np.zeros(len(error))) if shift is None else without_parallax(error, shift)
    unexplained = magnitude(rest)
    grid = PointGrid(measured.now, measured.width, measured.height)
    sigma_px = max(LEAST_SIGMA_PX, WIDE_TAILS * rayleigh_sigma(unexplained[measured.sample]))
    noise = _noise(grid.local_sigma(unexplained, sigma_px)) + shared + of_parallax
    sigmas: DoubleArray = unexplained / noise
    if parts is not None:
        sigmas = np.minimum(sigmas, _relief_sigmas(parts, grid, shared))
    return _Baseline(measured.frames, measured.seconds, _spread(error, measured.old, count),
                     _spread(magnitude(error), measured.old, count), _spread(noise, measured.old, count),
                     _spread(background, measured.old, count), _spread(sigmas, measured.old, count))


def _camera_flow(measured: _Measured) -> DoubleArray:
    """(N,) pixels."""
    flow = measured.now - apply(inverse(measured.matrix), measured.now)
    return magnitude(flow).astype(np.float64)


def _noise(sigma: DoubleArray) -> DoubleArray:
    noise: DoubleArray = np.sqrt(sigma ** 2 + NOISE_FLOOR_PX ** 2)
    return noise


def _relief_sigmas(parts: EpipolarParts, grid: PointGrid, shared: DoubleArray) -> DoubleArray:
    """(N,) significance with the larger noise along the epipolar lines; shared: (N,) pixels of noise in both."""
    across = _noise(grid.local_sigma(np.abs(parts.across), parts.across_sigma)) + shared
    along = _noise(RELIEF_NOISE * grid.local_sigma(np.abs(parts.along), parts.along_sigma)) + shared
    sigmas: DoubleArray = np.hypot(parts.along / np.maximum(along, across), parts.across / across)
    return sigmas


def _spread(values: DoubleArray, chosen: BoolArray, count: int) -> DoubleArray:
    """Values of the chosen of ``count`` points, NaN for the others."""
    out = np.full((count, *values.shape[1:]), np.nan)
    out[chosen] = values
    return out
