"""The whole detector: one frame in, moving objects out. Read this module first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.background import static_points
from motion_detect_ros.core.clustering_stage import ClusteringStage, Followed
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.geometry.frame_history import FrameHistory, ReferenceFrame
from motion_detect_ros.core.optical_flow.stage import OpticalFlowStage
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.reconfiguration import structural_changes
from motion_detect_ros.core.self_tuning import Tuned
from motion_detect_ros.core.types import (
    NANOSECONDS,
    CameraModel,
    DoubleArray,
    EgoMotion,
    FlowField,
    PreparedFrame,
    Result,
    StageTimes,
)

#: Width of the warm-up images, between these; they are shrunk like any other.
MIN_WARM_UP_PX, MAX_WARM_UP_PX = 480, 1920
#: Number of warm-up images: the object is detected from the second on, reported from the third on, and found by its
#: points from the ninth on; in the one after the next they are carried on.
WARM_UP_FRAMES = 11


@dataclass(frozen=True)
class Measured:
    """What ``MotionPipeline.measure`` hands to ``detect``. ``followed``: by ``follow``, None = not
    yet.
    """

    frame: PreparedFrame
    ego: EgoMotion
    reference: ReferenceFrame | None
    flow: FlowField
    times_ms: StageTimes
    camera: CameraModel | None
    followed: Followed | None = None


class MotionPipeline:
    """Preprocessing, ego-motion, optical flow and ART2 clustering, in that order, on one frame at a time.

    The ROS nodes run the same stage objects, so online and offline results are equal.
    """

    def __init__(
        self, config: PipelineConfig | None = None, camera: CameraModel | None = None, first_id: int = 1,
        clock: Callable[[], float] = perf_counter,
    ) -> None:
        """first_id: id of the first track; clock: of the times of stages, seconds."""
        self.config, self._clock = config or PipelineConfig(), clock
        self._clustering = ClusteringStage(self.config, camera, first_id=first_id)
        self._make_first_half(camera)

    def _make_first_half(self, camera: CameraModel | None) -> None:
        self._preprocessor = Preprocessor(self.config.preprocessing)
        self._ego_motion = EgoMotionStage(self.config, camera)
        self._history = FrameHistory(self.config.optical_flow.baseline_s)
        self._optical_flow = OpticalFlowStage(self.config)

    @property
    def neurons(self) -> int:
        """Committed ART2 neurons, the background's included."""
        return self._clustering.neurons

    @property
    def tuned(self) -> Tuned:
        """The settings in use that ``self_tuning`` may have changed."""
        return self._clustering.tuned

    @property
    def complaints(self) -> tuple[str, ...]:
        """As of the ``Preprocessor``."""
        return self._preprocessor.complaints

    def process(self, image: npt.NDArray[np.uint8], stamp_ns: int) -> Result:
        """Detect the independently moving objects in ``image``.

        image: (H, W) or (H, W, 3) uint8, grey or BGR; stamp_ns: time of exposure, nanoseconds.
        Raises: FrameError for an image that cannot be processed; the state is unchanged then.
        """
        result = self.detect(self.measure(image, stamp_ns, later=True))
        self._ego_motion.look_ahead()
        return result

    def measure(self, image: npt.NDArray[np.uint8], stamp_ns: int, later: bool = False) -> Measured:
        """The first half of ``process``, preprocessing to flow; another thread may do the second of the frame before.

        later: the flow is computed by the second half, maybe behind its answer, unless the next flow depends on it
        (``full_every``), and nothing is done for the next frame. Raises: FrameError as ``process``.
        """
        start = self._clock()
        frame = self._preprocessor.process(image, stamp_ns)
        prepared = self._clock()
        ego = self._ego_motion.process(frame)
        if not later:
            self._ego_motion.look_ahead()
        ego_done = self._clock()
        reference = self._history.step(frame, ego)
        flow = self._optical_flow.process(frame, ego, reference, later)
        flow.clock = self._clock
        times = StageTimes(1e3 * (prepared - start), 1e3 * (ego_done - prepared), 1e3 * (self._clock() - ego_done))
        return Measured(frame, ego, reference, flow, times, self._ego_motion.camera)

    def settle(self, measured: Measured) -> Measured:
        """The flow, where it was left for later: a part of ``detect`` that another thread may do ahead of it."""
        start = self._clock()
        measured.flow.settle()
        flow_ms = measured.times_ms.optical_flow + 1e3 * (self._clock() - start)
        return replace(measured, times_ms=replace(measured.times_ms, optical_flow=flow_ms))

    def follow(self, measured: Measured) -> Measured:
        """Where points go, where any are used: another part that another thread may do ahead, frames in their order."""
        start = self._clock()
        followed = self._clustering.follow(measured.frame, measured.ego, measured.camera)
        times = replace(measured.times_ms, clustering=1e3 * (self._clock() - start))
        return replace(measured, followed=followed, times_ms=times)

    def detect(self, measured: Measured) -> Result:
        """The second half: clustering and tracks. Frames in their order."""
        start = self._clock()
        ego, flow, times, pending = measured.ego, measured.flow, measured.times_ms, measured.flow.pending
        self._clustering.camera = measured.camera
        detections = self._clustering.process(measured.frame, ego, measured.reference, flow, measured.followed)
        flow_ms = flow.took_ms if pending and not self._clustering.flow_is_behind else 0.0
        times = replace(times, optical_flow=times.optical_flow + flow_ms,
                        clustering=times.clustering + 1e3 * (self._clock() - start) - flow_ms)
        return Result(measured.frame.stamp_ns, ego, flow, detections, times)

    def wait(self) -> None:
        """Until what is done behind the answer to the last frame is done; the next frame waits for it by itself."""
        self._ego_motion.wait()
        self._clustering.wait()

    def add_gyro(self, stamp_ns: int, rate: DoubleArray) -> None:
        """An angular rate, (3,) rad/s in the IMU's frame, in order of time: see ``EgoMotionStage.add_gyro``."""
        self._ego_motion.add_gyro(stamp_ns, rate)

    def clock_jumped(self) -> None:
        """The next image is of another run of the clock, whatever its stamp: all history is cleared before it."""
        self._ego_motion.clock_jumped()

    def limit_width(self, share: float) -> None:
        """Less work from the next frame on: at most this share, 0 .. 1, of ``preprocessing.max_width_px``.

        Tracks, ids and the camera's motion go on; points tracked over a second start anew.
        """
        self._preprocessor.limit_width(share)

    def use_camera(self, camera: CameraModel | None) -> None:
        """Calibration of what is measured from now on, None = unknown."""
        self._ego_motion.camera = camera

    def use_config(self, config: PipelineConfig) -> None:
        """Other settings from the next frame on; all history is cleared where they differ in structural ones.

        Raises: BackendError for what is not in this installation; what ``config`` was holds on.
        """
        self.wait()
        structural = bool(structural_changes(self.config, config))
        if structural:
            MotionPipeline(config)  # raises before anything is changed
        self.config = config
        if structural:
            self._make_first_half(self._ego_motion.camera)
            self._clustering.restart(config)
        else:
            for stage in (self._ego_motion, self._optical_flow, self._clustering):
                stage.use_config(config)

    def reset(self) -> None:
        """Clear every earlier frame, cluster and track; ids go on counting, none is used twice."""
        self.wait()
        self._preprocessor.reset()
        self._ego_motion.reset()
        self._history.reset()
        self._optical_flow.reset()
        self._clustering.reset()


def warm_up(config: PipelineConfig, detection: bool = True) -> None:
    """Compile (or load from the cache) every kernel and allocate buffers, so that the first frame is not delayed.

    detection: also those behind the flow, most of all.
    """
    seen = replace(config.preprocessing, ignore_top_px=0, ignore_regions='')  # made for images of another size
    tracks = replace(config.tracks, confirm_s=0.0, confirm_log_odds=-100.0)
    pipeline = MotionPipeline(replace(config, preprocessing=seen, tracks=tracks))
    width = min(max(MIN_WARM_UP_PX, config.preprocessing.max_width_px), MAX_WARM_UP_PX)
    random = np.random.default_rng(0)
    ground = random.integers(0, 255, (width * 9 // 16, width), np.uint8)
    thing, small = (random.integers(0, 255, (10, width_px // 4), np.uint8).repeat(4, 0).repeat(4, 1)  # easily tracked
                    for width_px in (132, 40))
    thing[:, 30:100] = 128  # a plain body with points at its ends
    for index in range(WARM_UP_FRAMES):
        image = ground.copy()
        left = 40 + 6 * index
        image[60:100, left:left + 132] = thing
        image[140:180, left:left + 40] = small  # goes further than its length: shadows are looked for
        measured = pipeline.measure(image, (index + 1) * NANOSECONDS // 25)
        if detection:
            pipeline.detect(measured)
    pipeline.wait()
    if detection and config.background.model != 'planar':
        static_points.warm_up()
