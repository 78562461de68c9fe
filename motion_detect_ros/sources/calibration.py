"""Which camera_info belongs to an image, and why none does, live and in bags."""

from __future__ import annotations

from typing import Any

from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.sources.camera_info import camera_of, lens_problem
from motion_detect_ros.sources.messages import stamp_of

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
    """Those that have come. They are noted as they come; before an image is processed its own is asked for.

    The one with the stamp of the image counts where it has come, else the latest one that is not after it, else the
    latest: of a lens that zooms each image has its own.
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
        """A message has come, whatever library has read it; one without a calibration takes the place of the earlier
        one too.
        """
        self._camera = self._cameras[stamp_of(info)] = camera_of(info, self._rectified)
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
        camera = self._camera_at(image_stamp_ns)
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

    def _camera_at(self, image_stamp_ns: int) -> CameraModel | None:
        if image_stamp_ns in self._cameras:
            return self._cameras[image_stamp_ns]
        before = max((stamp_ns for stamp_ns in self._cameras if stamp_ns < image_stamp_ns), default=None)
        return self._camera if before is None else self._cameras[before]

    def complaint(self) -> str:
        """Why bearings are unknown or inexact, in a sentence, once for each reason; empty where nothing is new."""
        told, self._told = self._told, self.state
        if self.state == NONE:
            return 'no camera_info: bearings are NaN' if self._images == PATIENCE else ''
        if self.state in {USED, told}:
            return ''
        return f'camera_info {self.state}' + ('' if self.state.startswith(WITHOUT_LENS) else ': bearings are NaN')
