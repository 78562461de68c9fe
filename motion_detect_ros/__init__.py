"""Moving-object detection from a single moving camera: ROS 2 nodes and offline tools."""

import os

__version__ = '0.1.0'

# OpenCV reads it when it is loaded: a picture whose header promises more pixels would take gigabytes.
os.environ.setdefault('OPENCV_IO_MAX_IMAGE_PIXELS', '100000000')
