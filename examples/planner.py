"""Suggests what to do about moving objects: ``go``, ``stop``, or a side-step to the ``left`` or the ``right``.

    python3 planner.py --ros-args -p horizon_s:=3.0

Subscribes to ``detections`` and ``camera_info`` (for the width of the image only, so that no calibration is needed),
publishes ``~/suggestion`` (std_msgs/String), one for each image.

The rule: an object counts when its time to contact is under ``horizon_s`` and it is, or within ``look_ahead_s`` will
be, in the corridor: the middle ``corridor`` of the image. Objects that will be on one side only are passed on the other
side; one in the middle, or some on both sides, mean stop. Time to contact is known for objects of about 60 px and more,
and it is an estimate: over the built-in flight, where no true one is under 3.9 s, 7 of the 120 images suggest a
side-step all the same, with preset default as with visdrone. Slow down on a suggestion rather than trust a single one,
and keep away from people by other means.
"""


import numpy as np
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data  # best effort, which every driver's topics fit
from sensor_msgs.msg import CameraInfo, PointCloud2
from std_msgs.msg import String

from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.records import read_detections
from motion_detect_ros.bridge.runner import run_plain

#: Share of the corridor around the middle where no side is the better one.
UNDECIDED = 0.2


def suggest(detections, width_px, horizon_s=3.0, look_ahead_s=1.0, corridor=0.5):
    """``go``, ``stop``, ``left`` or ``right``; detections: array of ``read_detections``, width_px: of the image."""
    half_px = corridor * width_px / 2
    now_px = detections['u'] - width_px / 2  # from the middle, to the right; u is 0 at the picture's left edge
    soon_px = now_px + look_ahead_s * detections['vel_u']
    meets = (np.minimum(now_px, soon_px) < half_px) & (np.maximum(now_px, soon_px) > -half_px)
    danger = meets & (detections['ttc'] < horizon_s)  # NaN (unknown) and inf (recedes) are no danger
    if not danger.any():
        return 'go'
    at = soon_px[danger] / half_px
    if (at > UNDECIDED).all():
        return 'left'
    if (at < -UNDECIDED).all():
        return 'right'
    return 'stop'


class Planner(Node):
    """Answers each detections message with a suggestion."""

    def __init__(self):
        super().__init__('avoidance')
        self.rule = {name: declare_simple(self, name, default, doc, low, high) for name, default, doc, low, high in (
            ('horizon_s', 3.0, 'time to contact under which an object counts', 0.0, 60.0),
            ('look_ahead_s', 1.0, 'time within which it will be in the corridor', 0.0, 60.0),
            ('corridor', 0.5, 'share of the image', 0.01, 1.0))}
        self.width_px = 0
        self.suggestion = ''
        self.publisher = self.create_publisher(String, '~/suggestion', 5)
        self.create_subscription(CameraInfo, 'camera_info', self.on_camera_info, qos_profile_sensor_data)
        self.create_subscription(PointCloud2, 'detections', self.on_detections, 5)

    def on_camera_info(self, msg):
        """The size of the images: of the sensor's region that they show, so many of its pixels in one."""
        self.width_px = (msg.roi.width or msg.width) // max(1, msg.binning_x)

    def on_detections(self, msg):
        """One image: suggest."""
        if not self.width_px:
            return self.get_logger().warning('no camera_info yet', throttle_duration_sec=5.0)
        suggestion = suggest(read_detections(msg), self.width_px, **self.rule)
        self.publisher.publish(String(data=suggestion))
        if suggestion != self.suggestion:
            self.get_logger().info(suggestion)
            self.suggestion = suggestion


if __name__ == '__main__':
    run_plain(Planner)
