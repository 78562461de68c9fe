"""Moving-object detection from a single moving camera: ROS 2 nodes and offline tools."""

__version__ = '0.1.0'
