"""Exceptions of the package: one base, one class per layer."""


class MotionDetectError(Exception):
    """Base of everything the package raises on purpose."""


class ConfigError(MotionDetectError):
    """A setting is unknown, of the wrong type, or outside its range."""


class FrameError(MotionDetectError):
    """An image cannot be processed: wrong shape, type or size."""


class BackendError(MotionDetectError):
    """A selected method is not available in this installation."""


class SourceError(MotionDetectError):
    """An input (file, folder, device, address) is missing or unreadable."""


class MessageError(MotionDetectError):
    """A ROS message does not hold what its type or fields promise."""
