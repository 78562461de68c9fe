"""Which camera_info belongs to an image, and why none does, live and in bags."""

from __future__ import annotations

from typing import Any

from motion_detect_ros.core.stamp_order import REORDER_S
from motion_detect_ros.core.types import NANOSECONDS, CameraModel
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
    latest: of a lens that zooms each image has its own. Where their stamps go back, those of later times are of another
    run of the clock and do not count any more.
    """

    def __init__(self, rectified: bool) -> None:
        """rectified: as for ``camera_of``."""
        self._rectified = rectified
        self._camera: CameraModel | None = None
        self._cameras: dict[int, CameraModel | None] = {}  # never changed: another thread may look at it
        self._latest_ns = 0
        self.state = self._told = NONE
        self._images = 0
        self._lens_problem = ''

    def note(self, info: Any) -> None:
        """A message has come, whatever library has read it; one without a calibration takes the place of the earlier
        one too.
        """
        stamp_ns, known = stamp_of(info), self._cameras.copy()
        if self._latest_ns - stamp_ns >= REORDER_S * NANOSECONDS:  # of another run of the clock
            known = {earlier_ns: camera for earlier_ns, camera in known.items() if earlier_ns < stamp_ns}
        self._camera = known[stamp_ns] = camera_of(info, self._rectified)
        self._lens_problem = '' if self._rectified else lens_problem(info)
        if len(known) > KEPT:
            del known[next(iter(known))]
        self._cameras, self._latest_ns = known, stamp_ns
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
        known = self._cameras
        if image_stamp_ns in known:
            return known[image_stamp_ns]
        before = max((stamp_ns for stamp_ns in known if stamp_ns < image_stamp_ns), default=None)
        return self._camera if before is None else known[before]

    def complaint(self) -> str:
        """Why bearings are unknown or inexact, in a sentence, once for each reason; empty where nothing is new."""
        told, self._told = self._told, self.state
        if self.state == NONE:
            return 'no camera_info: bearings are NaN' if self._images == PATIENCE else ''
        if self.state in {USED, told}:
            return ''
        return f'camera_info {self.state}' + ('' if self.state.startswith(WITHOUT_LENS) else ': bearings are NaN')
