"""``ego_motion``: image_raw -> ego_motion."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from motion_detect_ros.bridge.diagnostics import unused_for
from motion_detect_ros.bridge.gyro import Sink
from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.load_watch import LoadWatch, SteppedNode
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.topics import EGO_MOTION, TopicPublisher
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import ByteArray, CameraModel, DoubleArray


class EgoMotionNode(SteppedNode):
    """Publishes how the camera's own motion moved the background, with covariance and status."""

    detects = False
    used = ('preprocessing.', 'ego_motion.', 'imu.', 'background.focal_share', 'load.')

    def __init__(self) -> None:
        super().__init__('ego_motion')
        self._load = LoadWatch(self)

    def make_stage(self) -> None:
        """Stage and publisher."""
        self._start_anew()
        self._load.use_config(restart=True)
        self._publisher = TopicPublisher(self, EGO_MOTION)

    def begin(self) -> None:
        """Subscribe, to the times of the other stages too."""
        self._load.subscribe()
        super().begin()

    def _start_anew(self) -> None:
        self._preprocessor = Preprocessor(self.config.preprocessing)
        self._stage = EgoMotionStage(self.config)

    def use_config(self, restart: bool) -> None:
        """Other settings from the next image on."""
        if restart:
            self._start_anew()
        else:
            self._stage.use_config(self.config)
        self._load.use_config(restart)

    def work(self, header: Any, image: ByteArray) -> str:
        """One image: estimate and publish, with the step that the stages behind follow."""
        start = time.perf_counter()
        frame = self._preprocessor.process(image, stamp_ns(header))
        self.warn_of(self._preprocessor.complaints)
        ego = replace(self._stage.process(frame), load_step=self.load_step)
        self._publisher.publish(ego, header)
        self._stage.look_ahead()
        self._load.add(1e3 * (time.perf_counter() - start))
        self.latest = (('status', ego.status.name), ('inliers', str(ego.inliers)), ('tracks', str(ego.tracks)))
        return unused_for(ego)

    def limit_width(self, share: float) -> None:
        """Of the images from the next one on."""
        self._preprocessor.limit_width(share)

    def use_camera(self, camera: CameraModel | None) -> None:
        """Hand the calibration on."""
        self._stage.camera = camera

    def clock_jumped(self) -> None:
        """The stage says so in the status, by which the others start anew."""
        self._stage.clock_jumped()

    def gyro_sink(self) -> Sink:
        """The stage of the moment: other settings may bring a new one."""
        return self._add_gyro

    def forget(self) -> None:
        """The previous frame."""
        self._preprocessor.reset()
        self._stage.reset()

    def _add_gyro(self, stamp_ns: int, rate: DoubleArray) -> None:
        self._stage.add_gyro(stamp_ns, rate)


main = main_of(EgoMotionNode)

if __name__ == '__main__':
    main()
