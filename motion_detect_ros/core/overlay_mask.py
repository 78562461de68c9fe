"""Burnt-in overlays (text, symbols, the own hull): corners that stay the same while the rest of the picture moves."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.types import NANOSECONDS, BoolArray, ByteArray, FloatArray

#: How long a pixel must have stayed the same under a moving picture, seconds, and how often that is looked at.
SAME_S, REFRESH_S = 3.0, 1.0
#: Gaps in time, seconds, after which everything starts anew.
MAX_GAP_S = 1.0
#: Grey values that differ by no more are the same (noise, compression).
SAME_GRAY = 8
#: Blocks over the picture, and the deviation of grey values from which one has texture.
BLOCKS = (8, 6)
TEXTURE_GRAY = 8.0
#: Share of a textured block's pixels, and of the textured blocks, that a moving picture changes.
CHANGED_SHARE, MOVING_SHARE = 0.05, 0.5
#: Window of the corner response, pixels.
CORNER_PX = 5
#: Response from which there is structure in both directions: edges along the motion stay the same in any scene.
CORNER_RESPONSE = 2e-3
#: Gaps between the corners of an overlay that are closed, and how far it reaches around them, pixels.
GAP_PX, REACH_PX = 15, 4
#: Overlays do not cover more of the picture; what does is the scene.
MAX_SHARE = 0.25


class OverlayFinder:
    """Watches pictures of one size go by; ``mask`` is what it has learnt."""

    def __init__(self) -> None:
        self.mask: BoolArray | None = None
        self.reset()

    def reset(self) -> None:
        """Forget every picture, and the mask."""
        self._start(np.empty((0, 0), np.uint8), 0)

    def _start(self, gray: ByteArray, stamp_ns: int) -> None:
        self.mask = None
        self._previous, self._stamp_ns = gray, stamp_ns
        self._first = gray.copy()
        self._same_s: FloatArray = np.zeros(gray.shape, np.float32)
        self._since_refresh_s = 0.0

    def step(self, gray: ByteArray, stamp_ns: int) -> BoolArray | None:
        """Take in a picture, (h, w) uint8; the mask, False on overlays, None while there are none.

        A pixel is compared with what it was when it last changed, so that slow drift counts as change.
        """
        dt_s = (stamp_ns - self._stamp_ns) / NANOSECONDS
        if self._previous.shape != gray.shape or not 0.0 < dt_s <= MAX_GAP_S:
            self._start(gray, stamp_ns)
            return None
        self._watch(gray, dt_s)
        self._previous, self._stamp_ns = gray, stamp_ns
        return self.mask

    def _watch(self, gray: ByteArray, dt_s: float) -> None:
        changed = cv2.absdiff(gray, self._first) > SAME_GRAY
        np.copyto(self._first, gray, where=changed)
        self._same_s[changed] = 0.0
        if not _moving(gray, self._previous):
            return
        self._same_s[~changed] += dt_s
        self._since_refresh_s += dt_s
        if self._since_refresh_s >= REFRESH_S:
            self._since_refresh_s = 0.0
            self.mask = _overlay_mask(gray, self._same_s >= SAME_S)


def _moving(gray: ByteArray, previous: ByteArray) -> bool:
    """Whether most of what has texture changed."""
    mean, square, changed = (
        cv2.resize(values.astype(np.float32), BLOCKS, interpolation=cv2.INTER_AREA)
        for values in (gray, np.square(gray, dtype=np.float32), cv2.absdiff(gray, previous) > SAME_GRAY))
    textured = square - mean ** 2 > TEXTURE_GRAY ** 2
    moving = textured & (changed > CHANGED_SHARE)
    return bool(np.count_nonzero(moving) > MOVING_SHARE * np.count_nonzero(textured))


def _overlay_mask(gray: ByteArray, same: BoolArray) -> BoolArray | None:
    """Corners that stayed the same, closed to patches; None where there are none, or too many to be an overlay."""
    response: FloatArray = cv2.cornerMinEigenVal(gray, CORNER_PX, ksize=3)
    corner = response > CORNER_RESPONSE
    patches = cv2.morphologyEx((corner & same).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((GAP_PX, GAP_PX), np.uint8))
    reach = np.ones((2 * REACH_PX + 1, 2 * REACH_PX + 1), np.uint8)
    overlay: BoolArray = cv2.dilate(patches, reach) > 0
    return ~overlay if 0.0 < overlay.mean() <= MAX_SHARE else None
