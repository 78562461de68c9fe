"""``optical_flow``: image_raw + ego_motion -> flow."""

from __future__ import annotations

from typing import Any

from motion_detect_ros.bridge.diagnostics import unused_for
from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.load import Stage
from motion_detect_ros.bridge.load_watch import StageLoad, SteppedNode
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.topics import EGO_MOTION, FLOW, TopicPublisher
from motion_detect_ros.core.geometry.frame_history import FrameHistory
from motion_detect_ros.core.optical_flow.stage import OpticalFlowStage
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import ByteArray, EgoMotion


class OpticalFlowNode(SteppedNode):
    """Publishes the dense flow of each image, on the stabilised pair."""

    inputs = (EGO_MOTION,)
    uses_camera = False
    detects = False
    used = ('preprocessing.', 'optical_flow.', 'load.')

    def __init__(self) -> None:
        super().__init__('optical_flow')
        self._load = StageLoad(self, Stage.OPTICAL_FLOW)

    def make_stage(self) -> None:
        """Stage and publisher."""
        self._start_anew()
        self._load.advertise()
        self._publisher = TopicPublisher(self, FLOW)

    def _start_anew(self) -> None:
        self._preprocessor = Preprocessor(self.config.preprocessing)
        self._history = FrameHistory(self.config.optical_flow.baseline_s)
        self._stage = OpticalFlowStage(self.config)

    def use_config(self, restart: bool) -> None:
        """Other settings from the next image on."""
        if restart:
            self._start_anew()
        else:
            self._stage.use_config(self.config)

    def work(self, header: Any, image: ByteArray, ego: EgoMotion) -> str:
        """One image: flow and publish."""
        with self._load.image(header, ego.load_step):
            frame = self._preprocessor.process(image, stamp_ns(header))
            self.warn_of(self._preprocessor.complaints)
            reference = self._history.step(frame, ego)
            self._publisher.publish(self._stage.process(frame, ego, reference), header)
        return unused_for(ego, reference is not None)

    def limit_width(self, share: float) -> None:
        """Of the images from the next one on."""
        self._preprocessor.limit_width(share)

    def forget(self) -> None:
        """Earlier frames."""
        for part in (self._preprocessor, self._history, self._stage):
            part.reset()


main = main_of(OpticalFlowNode)

if __name__ == '__main__':
    main()
