"""Prints the boxes of ``detections_2d``, as any consumer of ``vision_msgs`` gets them.

    sudo apt install ros-jazzy-vision-msgs    # before the detector is started: it looks for the package then
    python3 vision_boxes.py

``vision_msgs/Detection2DArray`` has no velocity, no time to contact and no bearing: those are in ``detections``.
"""

import sys
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node


def lines_of(msg):
    """One line for each box; msg: Detection2DArray."""
    for detection in msg.detections:
        box, hypothesis = detection.bbox, detection.results[0].hypothesis
        yield (f'{detection.id}: {hypothesis.class_id} {hypothesis.score:.2f} at ({box.center.position.x:.1f}, '
               f'{box.center.position.y:.1f}), {box.size_x:.1f} x {box.size_y:.1f} px')


def show(msg):
    """Print one message."""
    for line in lines_of(msg):
        print(line, flush=True)


def main():
    """Until Ctrl-C."""
    try:
        from vision_msgs.msg import Detection2DArray
    except ImportError:
        print('vision_boxes: expected the package vision_msgs: sudo apt install ros-jazzy-vision-msgs', file=sys.stderr)
        sys.exit(2)
    rclpy.init()
    node = Node('vision_boxes')
    node.create_subscription(Detection2DArray, 'detections_2d', show, 5)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == '__main__':
    main()
