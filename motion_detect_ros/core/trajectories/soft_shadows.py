"""What hardly differs from the ground that was there before: soft shadows, and what is smeared around an object.

They move as the object does, so no motion tells them from it; the ground shows through them. Hard shadows are as dark
as many vehicles: see ``hard_shadows``.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import cv2
import numpy as np

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.trajectories.recent_frames import RecentFrames
from motion_detect_ros.core.types import BoolArray, ByteArray

#: Ratio of the grey values of soft shadows to those of the ground; added to both, grey levels: dark ones are noisy.
DARKEST, BRIGHTEST, BLACK_GRAY = 0.74, 1.05, 4.0
#: What such a ratio tells of a pixel: the ground shows through, it is brighter, it is darker.
FAINT, BRIGHT, DARK = 1, 2, 3
#: The ground is known where an object has gone its longer side and so many pixels since.
BEYOND_PX = 4.0
#: Pixels this close to the object are its own: what people draw, and the window of a point, reach a little beyond it.
MARGIN = np.ones((5, 5), np.uint8)
#: Less than this share of its pixels is no object.
LEAST_SHARE = 0.3


class SoftShadows:
    """Those in the current frame, which is compared with the oldest one, stabilised and in the light of now."""

    def __init__(self, frames: RecentFrames) -> None:
        """frames: as they are; what they show later is not looked at."""
        self._frames, self._oldest = frames.copy(), len(frames) - 1
        self._seconds = frames.seconds(self._oldest)

    def of(self, own: BoolArray, region: Box, speed_px_s: float, side_px: float) -> BoolArray:
        """(h, w) pixels of a region that are not the object but may be its shadow; none where that is not known.

        own: (h, w) what moves with the object; region: on the image; speed_px_s: against the background; side_px: the
        longer side; both in pixels of the working resolution.
        """
        shadow = np.zeros_like(own)
        if not self.ground_known(speed_px_s, side_px):
            return shadow
        body = np.empty(own.shape, np.uint8)
        number = _hiding(own, self.tones, region.left, region.top, body)
        left = number - _showing(own, self.tones, region.left, region.top, cv2.dilate(body, MARGIN), shadow)
        return shadow if left >= LEAST_SHARE * number else np.zeros_like(own)

    def ground_known(self, speed_px_s: float, side_px: float) -> bool:
        """Whether an object, as in ``of``, has left the place where it was in the oldest frame."""
        return speed_px_s * self._seconds >= side_px + BEYOND_PX

    @cached_property
    def tones(self) -> ByteArray:
        """(ceil(h / 2), ceil(w / 2)) the image at half its size: where it is ``FAINT``, ``BRIGHT`` and ``DARK``."""
        now = self._frames[0].half
        tones = np.empty_like(now)
        _fill_tones(now, self._frames.earlier_half(self._oldest), tones)
        return tones


def without_shadow(candidate: Candidate, shadows: SoftShadows, scale: float, width: int, height: int) -> Candidate:
    """A candidate of flow, its box without its soft shadow; scale: working pixels per full-resolution pixel; width,
    height: of the working resolution.
    """
    half = candidate.size / 2.0
    low, high = scale * (candidate.centre - half), scale * (candidate.centre + half)
    region = Box(*np.floor(low).astype(int).tolist(), *np.ceil(high).astype(int).tolist()).grown(0, width, height)
    if region.width <= 0 or region.height <= 0:
        return candidate
    own = np.ones((region.height, region.width), np.bool_)
    speed = scale * float(np.hypot(*candidate.velocity_px_s))
    beside = ~shadows.of(own, region, speed, scale * float(candidate.size.max()))
    rows, columns = np.flatnonzero(beside.any(axis=1)), np.flatnonzero(beside.any(axis=0))
    low = np.maximum(low, [region.left + columns[0], region.top + rows[0]]) / scale
    high = np.minimum(high, [region.left + columns[-1] + 1, region.top + rows[-1] + 1]) / scale
    return replace(candidate, centre=(low + high) / 2.0, size=high - low)


@kernel(error_model='numpy')
def _fill_tones(now, before, tones):  # type: ignore[no-untyped-def]
    """``tones``: (h, w) of grey values against those before, 0 at the limits between them."""
    black, darkest, brightest = np.float32(BLACK_GRAY), np.float32(DARKEST), np.float32(BRIGHTEST)
    for r in range(now.shape[0]):
        for c in range(now.shape[1]):
            ratio = (np.float32(now[r, c]) + black) / (np.float32(before[r, c]) + black)
            if ratio > brightest:
                tones[r, c] = BRIGHT
            elif ratio < darkest:
                tones[r, c] = DARK
            else:
                tones[r, c] = FAINT if darkest < ratio < brightest else 0


@kernel()
def _hiding(own, tones, left, top, body):  # type: ignore[no-untyped-def]
    """``body``: (h, w) 1 where ``own`` is and the ground does not show through; returns the number of ``own``.

    tones: (H, W) at half the size of the image; the masks are at left, top of it.
    """
    count = 0
    for r in range(own.shape[0]):
        for c in range(own.shape[1]):
            count += own[r, c]
            body[r, c] = own[r, c] and tones[(top + r) // 2, (left + c) // 2] != FAINT
    return count


@kernel()
def _showing(own, tones, left, top, body, shadow):  # type: ignore[no-untyped-def]
    """``shadow``: (h, w) where the ground shows through and no ``body`` is; returns how many of them are of ``own``."""
    count = 0
    for r in range(own.shape[0]):
        for c in range(own.shape[1]):
            shadow[r, c] = tones[(top + r) // 2, (left + c) // 2] == FAINT and not body[r, c]
            count += shadow[r, c] and own[r, c]
    return count
