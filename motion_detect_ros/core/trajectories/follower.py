"""From frames to the points of small and slow objects: where they go, and which of them move by themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.deferred import Deferred
from motion_detect_ros.core.periods import Every
from motion_detect_ros.core.trajectories.object_motion import PointMotion, object_motion
from motion_detect_ros.core.trajectories.points import Points, PointTracker
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows
from motion_detect_ros.core.trajectories.spare_points import spare_points
from motion_detect_ros.core.types import BoolArray, CameraModel, EgoMotion, PreparedFrame

#: The motion of points is measured so often, seconds; in between objects go where their points go. In the third frame
#: first, so that flow measured as often, in the second frame first, comes in other frames.
MEASURED_EVERY_S, FIRST_FRAMES = 0.1, 3


@dataclass(frozen=True)
class MovedPoints:
    """``points``: of a frame, new ones included; ``motion``: of each."""

    points: Points
    motion: PointMotion


@dataclass(frozen=True)
class FollowedPoints:
    """Points of one frame, without new ones.

    ``frames``: that one and those before it; ``mask``: (h, w), False = not the scene, None = nowhere; ``scale``:
    working pixels per full-resolution pixel; ``dt_s``: since the frame before; ``run``: another one where no point has
    lived on from the frame before; ``moved``: what is measured of their motion behind the frame, which it waits for,
    None where that has failed; ``shows_motion``: whether it is.
    """

    points: Points
    frames: RecentFrames
    mask: BoolArray | None
    shadows: SoftShadows
    scale: float
    dt_s: float
    run: int
    shows_motion: bool
    moved: Callable[[], MovedPoints | None] = field(repr=False)


class PointFollower:
    """Holds the points and the frames of the last second.

    Behind each frame new points start, and their motion is measured; the next frame waits for that, and not for the
    objects that they show.
    """

    def __init__(self, config: PipelineConfig) -> None:
        self._frames = RecentFrames()
        self._every = Every(MEASURED_EVERY_S)
        self._tracker = PointTracker(config.trajectories.max_points)
        self._behind = Deferred[MovedPoints | None]('points')
        self._run = 0
        self._start_anew()

    def reset(self) -> None:
        """Clear frames and points."""
        self._behind.drop()
        self._frames.reset()
        self._start_anew()

    def wait(self) -> None:
        """Until what is done behind the last frame is done; ``follow`` does so itself."""
        self._behind.wait()

    def _start_anew(self) -> None:
        self._tracker.reset()
        self._every.reset()
        self._run += 1

    def follow(self, frame: PreparedFrame, ego: EgoMotion, camera: CameraModel) -> FollowedPoints:
        """Points in ``frame``, each frame once, in their order.

        ego: motion into it; camera: of its working resolution. Raises: what was raised behind the last frame.
        """
        self._behind.take()
        if not self._frames.add(frame, ego):
            self._start_anew()
        frames = self._frames.copy()
        points = self._tracker.track(self._frames, frame.mask)
        due = self._every.due(ego.dt_s) and len(frames) >= FIRST_FRAMES
        if due:
            self._every.done()
        if due or self._tracker.new_due:
            self._behind.start(partial(self._go_on, frames, frame.mask, camera if due else None))
        return FollowedPoints(points, frames, frame.mask, SoftShadows(frames), frame.scale, ego.dt_s, self._run, due,
                              self._behind.outcome)

    def _go_on(self, frames: RecentFrames, mask: BoolArray | None, camera: CameraModel | None) -> MovedPoints | None:
        """Starts new points; their motion with a camera. frames: their current one is that of the points."""
        points = self._tracker.start(frames, mask)
        if camera is None:
            return None
        motion = object_motion(points, frames, camera)
        self._tracker.told(motion.moving, spare_points(points, motion, frames))
        return MovedPoints(points, motion)
