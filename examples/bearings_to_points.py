"""Moving objects as obstacle points, for Nav2's costmap and collision monitor.

    python3 bearings_to_points.py --ros-args -p range_m:=4.0

Subscribes to ``detections``, publishes ``points`` (sensor_msgs/PointCloud2: x, y, z float32 in metres, and id), one for
each image, empty where nothing moves.

One camera measures directions, not distances. Each point stands on its object's bearing at the ASSUMED distance
``range_m``: its direction is measured, its distance is a decision of yours, such as the distance at which the robot
shall stop. Points are in the optical frame of the images (x right, y down, z forward): Nav2 brings them to its own
frame by TF, so base_link -> camera_optical_frame must be published.
"""

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.records import read_detections, records_to_msg
from motion_detect_ros.bridge.runner import run_plain

POINT = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('id', '<u4')])


def points_of(detections, range_m):
    """(n,) records of POINT; detections without a bearing (no calibration) are left out."""
    known = detections[np.isfinite(detections['bearing_z'])]
    points = np.zeros(len(known), POINT)
    for axis in 'xyz':
        points[axis] = range_m * known[f'bearing_{axis}']
    points['id'] = known['id']
    return points


class BearingsToPoints(Node):
    """Answers each detections message with a cloud."""

    def __init__(self):
        super().__init__('bearings_to_points')
        self.range_m = declare_simple(self, 'range_m', 5.0, 'assumed distance', 0.1, 1000.0)
        self.publisher = self.create_publisher(PointCloud2, 'points', 5)
        self.create_subscription(PointCloud2, 'detections', self.on_detections, 5)

    def on_detections(self, msg):
        """One image: publish its points, in its frame and with its stamp."""
        detections = read_detections(msg)
        points = points_of(detections, self.range_m)
        if len(points) < len(detections):
            self.get_logger().warning('objects without bearings: camera_info is missing or all zero, or they are where '
                                      'the lens has no ray', throttle_duration_sec=5.0)
        self.publisher.publish(records_to_msg(points, msg.header))


if __name__ == '__main__':
    run_plain(BearingsToPoints)
