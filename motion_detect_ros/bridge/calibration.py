"""The ``camera_info`` topic: which calibration belongs to the images, and why none does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.sources.camera_info import camera_of, lens_problem

#: Sizes that a driver rounds otherwise when it bins pixels, pixels.
SIZE_TOLERANCE_PX = 1
NONE, USED = 'none', 'used'
WITHOUT_LENS = 'used without distortion, which is refused'
UNCALIBRATED = 'refused (camera_info holds no calibration: expected focal lengths of 1 px or more)'
#: How many camera_info are kept for images that are processed later than they come.
KEPT = 100
#: Images that are waited for a first camera_info before its absence is worth a warning.
PATIENCE = 20


class Calibration:
    """The latest camera_info. The executor notes them; the stage asks for one before an image.

    The one with the stamp of the image counts where it has come, else the latest: of a lens that zooms each image has
    its own.
    """

    def __init__(self, rectified: bool) -> None:
        """rectified: as for ``camera_of``."""
        self._rectified = rectified
        self._camera: CameraModel | None = None
        self._cameras: dict[int, CameraModel | None] = {}
        self.state = self._told = NONE
        self._images = 0
        self._lens_problem = ''

    def note(self, info: Any) -> None:
        """A message has come; one without a calibration takes the place of the earlier one too."""
        self._camera = self._cameras[stamp_ns(info.header)] = camera_of(info, self._rectified)
        self._lens_problem = '' if self._rectified else lens_problem(info)
        if len(self._cameras) > KEPT:
            del self._cameras[next(iter(self._cameras))]
        if self._camera is None:
            self.state = UNCALIBRATED

    def for_image(self, image_stamp_ns: int, width: int, height: int) -> CameraModel | None:
        """The calibration of an image of this size, pixels; None where there is none, ``state`` says why.

        A camera_info of another size belongs to other images. One without a size is taken to be of this one.
        """
        self._images += 1
        camera = self._cameras.get(image_stamp_ns, self._camera)
        if camera is None:
            if self._cameras:
                self.state = UNCALIBRATED
            return None
        sizes = (camera.width, camera.height)
        if any(sizes) and max(abs(sizes[0] - width), abs(sizes[1] - height)) > SIZE_TOLERANCE_PX:
            self.state = (f'refused (camera_info is of {camera.width}x{camera.height} px, '
                          f'the images of {width}x{height})')
            return None
        self.state = f'{WITHOUT_LENS} ({self._lens_problem})' if self._lens_problem else USED
        return camera

    def complaint(self) -> str:
        """Why bearings are unknown or inexact, in a sentence, once for each reason; empty where nothing is new."""
        told, self._told = self._told, self.state
        if self.state == NONE:
            return 'no camera_info: bearings are NaN' if self._images == PATIENCE else ''
        if self.state in {USED, told}:
            return ''
        return f'camera_info {self.state}' + ('' if self.state.startswith(WITHOUT_LENS) else ': bearings are NaN')


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
