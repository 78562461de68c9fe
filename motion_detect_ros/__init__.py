"""Moving-object detection from a single moving camera: ROS 2 nodes and offline tools."""

import os

__version__ = '0.1.0'

# Read when the library is loaded. OpenCV: a picture whose header promises more pixels would take gigabytes. NumPy's
# OpenBLAS: its threads wait for their next call in a loop, for so many cycles (a power of 2); before NumPy 2 that is a
# core that does nothing else, as every inverse of a 3 x 3 matrix wakes them.
os.environ.setdefault('OPENCV_IO_MAX_IMAGE_PIXELS', '100000000')
os.environ.setdefault('OPENBLAS_THREAD_TIMEOUT', '4')
