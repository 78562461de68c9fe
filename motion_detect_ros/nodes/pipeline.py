"""``pipeline``: image_raw -> ego_motion, flow, detections, all stages in one process."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cached_property
from typing import Any

from motion_detect_ros.bridge.diagnostics import Condition, tuned_pairs
from motion_detect_ros.bridge.gyro import Sink
from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.runner import main_of
from motion_detect_ros.bridge.stage_node import StageNode, unused_for
from motion_detect_ros.bridge.topics import EGO_MOTION, FLOW, DetectionPublisher, TopicPublisher
from motion_detect_ros.bridge.track_ids import declare_first_id
from motion_detect_ros.core.load_control import LoadControl
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.types import ByteArray, CameraModel

#: How often the load is held against the rate of the images, seconds (``load.adapt``).
LOAD_PERIOD_S = 1.0


class PipelineNode(StageNode):
    """Publishes what the three stage nodes would; flow only while someone subscribes."""

    def __init__(self) -> None:
        super().__init__('pipeline')
        self._first_id = declare_first_id(self)
        self._control, self._compute_ms = LoadControl(), list[float]()
        self._received, self._looked_s = 0, time.monotonic()
        self.every(LOAD_PERIOD_S, self._follow_load)

    @cached_property
    def _pipeline(self) -> MotionPipeline:
        """One for the life of the process, so that no id is used twice."""
        return MotionPipeline(self.config, first_id=self._first_id)

    def make_stage(self) -> None:
        """Pipeline without history, publishers."""
        self.use_config(restart=True)
        self._pipeline.reset()
        self._ego_publisher = TopicPublisher(self, EGO_MOTION)
        self._flow_publisher = TopicPublisher(self, FLOW)
        self._publisher = DetectionPublisher(self)

    def work(self, header: Any, image: ByteArray) -> str:
        """One image: process and publish, detections first."""
        result = self._pipeline.process(image, stamp_ns(header))
        self._publisher.publish(result.detections, header)
        self._ego_publisher.publish(result.ego, header)
        if self._flow_publisher.subscribers:
            self._flow_publisher.publish(result.flow, header)
        self._compute_ms.append(result.times_ms.total)
        times = tuple((f'{name}_ms', f'{value:.2f}') for name, value in vars(result.times_ms).items())
        self.latest = (
            ('status', result.ego.status.name), ('inliers', str(result.ego.inliers)),
            ('tracks', str(result.ego.tracks)), ('objects', str(len(result.detections))),
            ('clusters', str(self._pipeline.neurons)), *tuned_pairs(self._pipeline.tuned), *times,
            ('total_ms', f'{result.times_ms.total:.2f}'), ('load_cost', f'{self._control.step.cost:g}'))
        return unused_for(result.ego)

    def use_config(self, restart: bool) -> None:
        """Other settings from the next image on; the pipeline knows by itself which need a restart."""
        self._pipeline.use_config(self.config)
        if restart or not self.config.load.adapt:
            self._control = LoadControl()
            self._since_last_look()  # what there was to do before tells nothing
        self._take_step()

    def condition(self) -> Condition:
        """As for all stages; and what is left out for want of time."""
        found = super().condition()
        return replace(found, concern=', '.join(filter(None, (found.concern, self._control.step.reduced))))

    def _follow_load(self) -> None:
        """More or less work where images take longer than their period, or have time to spare."""
        times, elapsed_s, images = self._since_last_look()
        if not (self.active and self.config.load.adapt and times and images):
            return
        load = self.config.load
        period_s = elapsed_s / images * load.decimation_of / load.decimation_keep
        if self._control.decide(1e-3 * sum(times) / len(times), period_s):
            self.locked(self._take_step)
            self.get_logger().warning(self._control.step.reduced or 'load: full work again')

    def _since_last_look(self) -> tuple[list[float], float, int]:
        """What each processed image took, milliseconds, the seconds gone by, and how many images were received."""
        times, self._compute_ms = self._compute_ms, []
        now_s, received = time.monotonic(), self.stats.summary(time.monotonic_ns()).received
        elapsed_s, images = now_s - self._looked_s, received - self._received
        self._looked_s, self._received = now_s, received
        return times, elapsed_s, images

    def _take_step(self) -> None:
        self._pipeline.limit_width(self._control.step.width_share)
        self.decimate(self._control.step.of)

    def use_camera(self, camera: CameraModel | None) -> None:
        """Hand the calibration on."""
        self._pipeline.use_camera(camera)

    def gyro_sink(self) -> Sink:
        """The pipeline."""
        return self._pipeline.add_gyro

    def forget(self) -> None:
        """All history."""
        self._pipeline.reset()


main = main_of(PipelineNode)

if __name__ == '__main__':
    main()
