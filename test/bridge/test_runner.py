"""The loop that every node runs in."""

from __future__ import annotations

import threading

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future

from motion_detect_ros.bridge.runner import spin
from motion_detect_ros.cli.live import own_domain

TICKS = 200


@pytest.mark.timeout(30)
def test_spinning_leaves_nothing_behind_and_ends_at_once(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context, finished, left = Context(), Future(), []
    rclpy.init(context=context, domain_id=own_domain())
    node, executor = rclpy.create_node('busy', context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def tick() -> None:
        left.append(len(finished._callbacks))
        if len(left) == TICKS:
            node.destroy_timer(timer)  # nothing else wakes the executor from now on
            threading.Timer(0.2, finished.set_result, (None,)).start()

    timer = node.create_timer(0.001, tick)
    spin(executor, finished)
    executor.shutdown(timeout_sec=2.0)
    node.destroy_node()
    rclpy.shutdown(context=context)
    assert (len(left), max(left)) == (TICKS, 1)
