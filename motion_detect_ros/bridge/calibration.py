"""The ``camera_info`` topic of a stage: the calibration of each image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.sources.calibration import Calibration


class StageCamera:
    """What a stage has been told of the calibration of its images. ``state``: as of ``Calibration``."""

    def __init__(
        self, rectified: bool, use: Callable[[CameraModel | None], None], warn: Callable[[str], object],
    ) -> None:
        """use: tells the stage; warn: tells the user why bearings are unknown."""
        self._rectified, self._use, self._warn = rectified, use, warn
        self._calibration = Calibration(rectified)
        self._in_use: CameraModel | None = None

    @property
    def state(self) -> str:
        """What becomes of the camera_info."""
        return self._calibration.state

    def note(self, info: Any) -> None:
        """A message has come. Only noted: the stage takes it before the next image, the executor must not wait."""
        self._calibration.note(info)

    def forget(self) -> None:
        """Every message that has come; the stage has none, either."""
        self._calibration = Calibration(self._rectified)
        self.tell_nothing()

    def tell_nothing(self) -> None:
        """The stage has no calibration until one is known to be that of its images."""
        self._in_use = None
        self._use(None)

    def update(self, image_stamp_ns: int, width: int, height: int) -> None:
        """The stage gets that of an image of this size, pixels, where it has another one."""
        camera = self._calibration.for_image(image_stamp_ns, width, height)
        if camera != self._in_use:
            self._in_use = camera
            self._use(camera)
        complaint = self._calibration.complaint()
        if complaint:
            self._warn(complaint)
