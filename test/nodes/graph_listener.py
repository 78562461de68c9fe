"""A peer in another network namespace: prints a line for every detections and diagnostics message.

    python graph_listener.py     ->  ``detections STAMP_NS SECONDS`` and ``/node LEVEL SECONDS MESSAGE``
"""

from __future__ import annotations

import contextlib
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import PointCloud2


def on_detections(message: PointCloud2) -> None:
    stamp = message.header.stamp
    print('detections', stamp.sec * 1_000_000_000 + stamp.nanosec, time.monotonic(), flush=True)


def on_diagnostics(message: DiagnosticArray) -> None:
    for status in message.status:
        print(status.name, status.level[0], time.monotonic(), status.message, flush=True)


def main() -> None:
    rclpy.init()
    node = rclpy.create_node('listener')
    node.create_subscription(PointCloud2, 'detections', on_detections, 100)
    node.create_subscription(DiagnosticArray, '/diagnostics', on_diagnostics, 100)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == '__main__':
    main()
