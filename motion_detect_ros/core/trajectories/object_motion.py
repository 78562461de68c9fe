"""Motion of each point against the background, over baselines up to a second, and how significant it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.trajectories.baseline import Baseline, Displacements
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.trajectories.relief import EpipolarParts
from motion_detect_ros.core.types import BoolArray, CameraModel, DoubleArray

#: Times over which motion is measured, seconds, longest first; over the last one only the velocity.
BASELINES_S = (1.0, 0.48, 0.32, 0.2, 0.12)
#: The kind of background is decided once for the baselines up to this length, once for the longer ones, seconds.
SHORT_BASELINE_S = 0.4
#: Fewest points of a baseline.
MIN_POINTS = 60
#: A point moves from so many noise units and pixels on; and each part of its way must have this share of what steady
#: motion makes of it.
MOVING_SIGMAS, MOVING_PX, STEADY_SHARE = 4.0, 1.2, 0.3
#: Its velocity is that of the shortest baseline with a displacement over this, pixels.
VELOCITY_PX = 4.0
#: A scene is in relief where residuals along the epipolar lines are so much longer than across, over the longest
#: baseline up to this length, seconds.
RELIEF, RELIEF_BASELINE_S = 1.75, 0.24
#: Stamps jitter: times that differ by less are alike, seconds.
JITTER_S = 0.01


@dataclass(frozen=True)
class PointMotion:
    """Of N points. ``velocity``: (N, 2) against the background, pixels/s, ``sigmas``: (N,) significance of the motion,
    0 where it is none; ``background``: (N, 2) velocity of the background beyond the ego-motion, pixels/s;
    ``evidence``: (N,) the largest significance over any baseline, steady or not, 0 where no way was long enough;
    ``least_speed``: (N,) from which motion would be significant, pixels/s, infinite for points too young for any;
    ``displacements``: (N, 2) each, pixels against the background over each baseline, longest first, NaN for points
    younger than that; ``seconds``: of each of them.
    """

    velocity: DoubleArray
    sigmas: DoubleArray
    background: DoubleArray
    evidence: DoubleArray
    least_speed: DoubleArray
    displacements: tuple[DoubleArray, ...] = ()
    seconds: tuple[float, ...] = ()

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


def object_motion(points: Points, frames: RecentFrames, camera: CameraModel) -> PointMotion:
    """Which points move against the background, and how fast. camera: of the working resolution."""
    baselines = _baselines(points, frames)
    found = Displacements.of(len(baselines), len(points))
    for index, (baseline, parts) in enumerate(zip(baselines, _relief(baselines), strict=True)):
        baseline.measure(camera, parts, found, index)
    motion = replace(PointMotion.at_rest(len(points)), displacements=tuple(found.motion),
                     seconds=tuple(each.seconds for each in baselines))
    seconds = np.array(motion.seconds, np.float64)
    _judge(found.motion, found.background, found.noise, found.sigmas, seconds, _halves(seconds), MOVING_SIGMAS,
           motion.velocity, motion.sigmas, motion.background, motion.evidence, motion.least_speed)
    return motion


def _baselines(points: Points, frames: RecentFrames) -> list[Baseline]:
    """Longest first; without those that the frames or too few points reach back to."""
    baselines = [Baseline(points, frames, ago) for ago in _frames_ago(frames)
                 if np.count_nonzero(points.age >= ago) >= MIN_POINTS]
    for are_short in (True, False):
        alike = [each for each in baselines if (each.seconds <= SHORT_BASELINE_S) == are_short]
        if alike and alike[-1].plane_is_better():
            for each in alike:
                each.use_plane()
    return baselines


def _frames_ago(frames: RecentFrames) -> list[int]:
    """Numbers of frames that come close to the baselines, longest first."""
    reach = frames.seconds(len(frames) - 1)
    period = reach / max(1, len(frames) - 1)
    return sorted({frames.nearest(seconds) for seconds in BASELINES_S if seconds <= reach + period / 2.0} - {0},
                  reverse=True)


def _relief(baselines: list[Baseline]) -> list[EpipolarParts | None]:
    """Parts of the errors of every baseline, None where those of a short one have no common epipole."""
    short = next((each for each in baselines if each.seconds <= RELIEF_BASELINE_S), None)
    parts = None if short is None else short.epipolar_parts()
    if parts is None or parts.relief <= RELIEF:
        return [None] * len(baselines)
    return [parts if each is short else each.epipolar_parts() for each in baselines]


def _halves(seconds: DoubleArray) -> npt.NDArray[np.intp]:
    """(B,) index of the baseline closest to half of each, of the shorter ones, the longest of several as close; -1 for
    the last one, which has none.

    seconds: (B,) descending.
    """
    halves = np.full(len(seconds), -1, np.intp)
    for index in range(len(seconds) - 1):
        off = np.abs(seconds[index + 1:] - seconds[index] / 2.0)
        halves[index] = index + 1 + np.argmax(off < off.min() + JITTER_S)
    return halves


@kernel()
def _judge(  # type: ignore[no-untyped-def]
    motion, background, noise, sigmas, seconds, halves, moving_sigmas, velocity_out, sigmas_out, background_out,
    evidence_out, least_speed_out,
):
    """Fills the arrays of a ``PointMotion`` at rest, of N points, from their ``Displacements`` over B baselines.

    seconds, halves: (B,), longest baseline first; moving_sigmas: ``MOVING_SIGMAS``.
    """
    for n in range(len(sigmas_out)):
        used = -1
        for b in range(len(seconds)):
            x, y = motion[b, n, 0], motion[b, n, 1]
            if math.isnan(x):
                continue
            length = math.sqrt(x * x + y * y)
            least_speed_out[n] = min(least_speed_out[n], max(MOVING_PX, moving_sigmas * noise[b, n]) / seconds[b])
            if length <= MOVING_PX:
                continue
            evidence_out[n] = max(evidence_out[n], sigmas[b, n])
            if used < 0 <= halves[b] and sigmas[b, n] > moving_sigmas:
                half = halves[b]
                recent = (motion[half, n, 0] * x + motion[half, n, 1] * y) / length
                due = length * (seconds[half] / seconds[b])
                if recent > STEADY_SHARE * due and length - recent > STEADY_SHARE * (length - due):
                    used, sigmas_out[n] = b, sigmas[b, n]
                    for axis in range(2):
                        velocity_out[n, axis] = motion[b, n, axis] / seconds[b]
                        background_out[n, axis] = background[b, n, axis] / seconds[b]
        for b in range(len(seconds) - 1, used - 1 if used >= 0 else len(seconds), -1):  # the shortest that is enough
            x, y = motion[b, n, 0], motion[b, n, 1]
            if math.sqrt(x * x + y * y) > VELOCITY_PX and sigmas[b, n] > moving_sigmas:
                velocity_out[n, 0], velocity_out[n, 1] = x / seconds[b], y / seconds[b]
                break
