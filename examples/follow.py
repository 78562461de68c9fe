"""Follows one moving object: keeps its track id, and turns the camera to it.

    python3 follow.py --ros-args -p gain:=1.0 -r cmd_vel:=/my_robot/cmd_vel

Subscribes to ``detections`` (calibrated: bearings are needed), publishes ``~/target`` (sensor_msgs/PointCloud2:
the target's detection, empty while it is out of sight) and ``cmd_vel`` (geometry_msgs/TwistStamped) for each image.

The target is the oldest track, the one with more score among equals; it stays the target until it has not been seen for
``lost_s``. The command is in the axes of REP 103 (x forward, y left, z up) of a robot that looks along its camera:
``angular.z`` turns to the target (positive: to the left), ``linear.z`` climbs to it. While the target is out of sight
the command is zero.
"""

import math

import numpy as np
from geometry_msgs.msg import TwistStamped
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.records import read_detections, records_to_msg
from motion_detect_ros.bridge.runner import run_plain


class Target:
    """The id that is followed; 0 = none."""

    def __init__(self, lost_s):
        self.lost_s, self.id, self.seen_s = lost_s, 0, -math.inf

    def update(self, detections, now_s):
        """The target's detection, or none while it is out of sight; detections: array of ``read_detections``."""
        if now_s - self.seen_s > self.lost_s or now_s < self.seen_s:
            self.id = 0
        if not self.id and len(detections):
            self.id = int(max(detections, key=lambda one: (one['age'], one['score']))['id'])
        found = detections[detections['id'] == self.id]
        if len(found):
            self.seen_s = now_s
        return found


class Follower(Node):
    """Answers each detections message with the target and a command."""

    def __init__(self):
        super().__init__('follower')
        self.gain = declare_simple(self, 'gain', 1.0, 'rad/s and m/s for each rad off the axis', 0.0, 100.0)
        self.target = Target(declare_simple(self, 'lost_s', 1.0, 'longest time out of sight', 0.0, 1000.0))
        self.targets = self.create_publisher(PointCloud2, '~/target', 5)
        self.commands = self.create_publisher(TwistStamped, 'cmd_vel', 5)
        self.create_subscription(PointCloud2, 'detections', self.on_detections, 5)

    def on_detections(self, msg):
        """One image: look for the target and turn to it."""
        found = self.target.update(read_detections(msg), msg.header.stamp.sec + 1e-9 * msg.header.stamp.nanosec)
        self.targets.publish(records_to_msg(found, msg.header))
        command = TwistStamped(header=Header(stamp=msg.header.stamp, frame_id='base_link'))
        known = found[np.isfinite(found['bearing_z'])]
        if len(known) < len(found):
            self.get_logger().warning('objects without bearings: camera_info is missing or all zero, or they are where '
                                      'the lens has no ray', throttle_duration_sec=5.0)
        for one in known:
            command.twist.angular.z = -self.gain * math.atan2(one['bearing_x'], one['bearing_z'])
            command.twist.linear.z = -self.gain * math.asin(max(-1.0, min(1.0, one['bearing_y'])))
        self.commands.publish(command)


if __name__ == '__main__':
    run_plain(Follower)
