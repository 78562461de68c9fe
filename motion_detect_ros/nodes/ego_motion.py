"""``ego_motion``: image_raw -> ego_motion."""

from __future__ import annotations

from typing import Any

from motion_detect_ros.bridge.gyro import Sink
from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.stage_node import StageNode, unused_for
from motion_detect_ros.bridge.topics import EGO_MOTION, TopicPublisher
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import ByteArray, CameraModel, DoubleArray


class EgoMotionNode(StageNode):
    """Publishes how the camera's own motion moved the background, with covariance and status."""

    detects = False
    used = ('preprocessing.', 'ego_motion.', 'imu.', 'background.focal_share', 'load.')

    def __init__(self) -> None:
        super().__init__('ego_motion')

    def make_stage(self) -> None:
        """Stage and publisher."""
        self._start_anew()
        self._publisher = TopicPublisher(self, EGO_MOTION)

    def _start_anew(self) -> None:
        self._preprocessor = Preprocessor(self.config.preprocessing)
        self._stage = EgoMotionStage(self.config)

    def use_config(self, restart: bool) -> None:
        """Other settings from the next image on."""
        if restart:
            self._start_anew()
        else:
            self._stage.use_config(self.config)

    def work(self, header: Any, image: ByteArray) -> str:
        """One image: estimate and publish."""
        frame = self._preprocessor.process(image, stamp_ns(header))
        ego = self._stage.process(frame)
        self._publisher.publish(ego, header)
        self._stage.look_ahead()
        self.latest = (('status', ego.status.name), ('inliers', str(ego.inliers)), ('tracks', str(ego.tracks)))
        return unused_for(ego)

    def use_camera(self, camera: CameraModel | None) -> None:
        """Hand the calibration on."""
        self._stage.camera = camera

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
