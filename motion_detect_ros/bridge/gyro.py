"""The ``imu`` topic: angular rates on their way to a stage."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.qos import imu_qos, overridable
from motion_detect_ros.bridge.topics import IMU
from motion_detect_ros.core.types import DoubleArray
from motion_detect_ros.sources.inertial import GyroQueue, GyroSample

#: An image waits this long for the sample after it, seconds.
WAIT_S = 0.1

#: ``add_gyro`` of a stage: stamp (ns), (3,) rate (rad/s, IMU frame).
Sink = Callable[[int, DoubleArray], None]


class GyroInput:
    """Subscribed until the node is deactivated, in the executor; feeds the stage in its own thread."""

    def __init__(self, node: ManagedNode, sink: Sink, time_offset_s: float) -> None:
        self._sink = sink
        self._queue = GyroQueue(time_offset_s)
        node.subscribe(IMU.kind, IMU.name, self._on_imu, imu_qos('best_effort'), qos_overriding_options=overridable())

    @property
    def received(self) -> bool:
        """Whether any sample has come; messages without angular velocity are none."""
        return self._queue.started

    def feed(self, image_stamp_ns: int) -> None:
        """Give the stage what it needs for an image, late samples included; called before the image is processed."""
        self._queue.wait_for(image_stamp_ns, WAIT_S)
        for sample in self._queue.take(image_stamp_ns):
            self._sink(sample.stamp_ns, np.array(sample.rate))

    def _on_imu(self, msg: Any) -> None:
        if (rate := IMU.from_msg(msg)) is not None:
            self._queue.add(GyroSample(stamp_ns(msg.header), rate))
