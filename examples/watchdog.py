#!/usr/bin/env python3
"""Stops the vehicle while the detector does not work: passes cmd_vel_in on to cmd_vel, or zero with the reason.

    python3 examples/watchdog.py --ros-args -p stages:=/pipeline

"stages" names the nodes that must be well, separated by commas: /pipeline, or
/ego_motion,/optical_flow,/art2_clustering. Zero is sent at 20 Hz, as whoever drives forgets old commands. Commands are
Twist, with "stamped" TwistStamped, as follow.py gives them.
"""

from __future__ import annotations

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node

from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.runner import run_plain
from motion_detect_ros.bridge.watchdog import Watchdog
from motion_detect_ros.core.errors import ConfigError

PERIOD_S = 0.05


class Guard(Node):
    """Lets commands pass only while the watchdog has nothing to say."""

    def __init__(self) -> None:
        super().__init__('watchdog')
        stages = str(declare_simple(self, 'stages', '/pipeline', 'nodes that must be well, separated by commas'))
        silence_s = float(declare_simple(self, 'detections_s', 0.5, 'longest silence on detections', 0.01, 60.0))
        names = [name.strip() for name in stages.split(',')]
        if not all(name.startswith('/') for name in names):
            raise ConfigError(f'parameter stages: expected full names of nodes, such as /pipeline, got {stages!r}')
        self._watchdog = Watchdog(self, names, silence_s)
        self._trouble = ''
        self._kind = TwistStamped if declare_simple(self, 'stamped', False, 'commands are TwistStamped') else Twist
        self._commands = self.create_publisher(self._kind, 'cmd_vel', 1)
        self.create_subscription(self._kind, 'cmd_vel_in', self._on_command, 1)
        self.create_timer(PERIOD_S, self._check)

    def _check(self) -> None:
        trouble = self._watchdog.trouble()
        if trouble:
            stop = self._kind()
            if self._kind is TwistStamped:
                stop.header.stamp = self.get_clock().now().to_msg()
            self._commands.publish(stop)
        if trouble != self._trouble:
            self.get_logger().warning(f'stop: {trouble}' if trouble else 'drive on')
            self._trouble = trouble

    def _on_command(self, command: Twist | TwistStamped) -> None:
        if not self._watchdog.trouble():
            self._commands.publish(command)


if __name__ == '__main__':
    run_plain(Guard)
