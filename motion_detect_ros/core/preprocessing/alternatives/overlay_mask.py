"""Burnt-in overlays (text, symbols, own hull): corners and their edges that stay constant while the scene moves."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.types import NANOSECONDS, BoolArray, ByteArray, FloatArray

#: How long a pixel must have stayed the same under a moving image, seconds, and how often the mask is updated.
SAME_S, REFRESH_S = 3.0, 1.0
#: Gaps in time, seconds, that reset the detector.
MAX_GAP_S = 1.0
#: Grey values that differ by no more are the same (noise, compression).
SAME_GRAY = 8
#: Blocks over the image, and the deviation of grey values from which one has texture.
BLOCKS = (8, 6)
TEXTURE_GRAY = 8.0
#: Share of a textured block's pixels, and of the textured blocks, that a moving image changes.
CHANGED_SHARE, MOVING_SHARE = 0.05, 0.5
#: Window of the corner response, pixels.
CORNER_PX = 5
#: Smaller eigenvalue of the structure tensor, and its share of the larger one, from which there is structure in both
#: directions: edges along the motion stay the same in any scene.
CORNER_RESPONSE, CORNER_SHARE = 2e-3, 0.2
#: Steps between neighbours that make an edge; edges belong to an overlay where they are connected to its corners.
EDGE_GRAY = 16
#: Gaps between the corners of an overlay that are closed, and how far it reaches around them, pixels.
GAP_PX, REACH_PX = 15, 4
#: A mask that covers a larger share of the image is rejected.
MAX_SHARE = 0.25


class OverlayFinder:
    """Detects overlays in a sequence of images of one size; ``mask`` is the current estimate."""

    def __init__(self) -> None:
        self.mask: BoolArray | None = None
        self.reset()

    def reset(self) -> None:
        """Clear all images and the mask."""
        self._start(np.empty((0, 0), np.uint8), 0)

    def _start(self, gray: ByteArray, stamp_ns: int) -> None:
        self.mask = None
        self._previous, self._stamp_ns = gray, stamp_ns
        self._first = gray.copy()
        self._same_s: FloatArray = np.zeros(gray.shape, np.float32)
        self._since_refresh_s = 0.0

    def step(self, gray: ByteArray, stamp_ns: int) -> BoolArray | None:
        """Add an image, (h, w) uint8; returns the mask, False on overlays, None while there are none.

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
    """Structure that stayed the same and has such corners, closed and filled to patches.

    None without any, or where it covers too much to be an overlay.
    """
    overlay = np.zeros(gray.shape, np.uint8)
    structure = ((_edges(gray) | _corners(gray)) & same).astype(np.uint8)
    closed = cv2.morphologyEx(_connected_to(structure, _corners(gray) & same), cv2.MORPH_CLOSE, _square(GAP_PX))
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    framed = [contour for contour in contours if cv2.contourArea(contour) <= MAX_SHARE * gray.size]
    cv2.drawContours(overlay, framed, -1, 1, cv2.FILLED)
    overlay = cv2.dilate(overlay | closed, _square(2 * REACH_PX + 1))
    share = cv2.countNonZero(overlay) / gray.size
    return overlay == 0 if 0.0 < share <= MAX_SHARE else None


def _corners(gray: ByteArray) -> BoolArray:
    """Structure in both directions; none at the border, where a line ends in every scene."""
    both: FloatArray = np.abs(cv2.cornerEigenValsAndVecs(gray, CORNER_PX, ksize=3)[..., :2])
    least = both.min(axis=2)
    corners: BoolArray = (least > CORNER_RESPONSE) & (least > CORNER_SHARE * both.max(axis=2))
    for side in (np.s_[:CORNER_PX], np.s_[-CORNER_PX:], np.s_[:, :CORNER_PX], np.s_[:, -CORNER_PX:]):
        corners[side] = False
    return corners


def _edges(gray: ByteArray) -> BoolArray:
    """Pixels that differ from their right or lower neighbour."""
    edges = np.zeros(gray.shape, np.bool_)
    edges[:, :-1] = cv2.absdiff(gray[:, 1:], gray[:, :-1]) > EDGE_GRAY
    edges[:-1] |= cv2.absdiff(gray[1:], gray[:-1]) > EDGE_GRAY
    return edges


def _connected_to(pixels: ByteArray, seeds: BoolArray) -> ByteArray:
    """The connected components of ``pixels`` that contain a seed."""
    count, labels = cv2.connectedComponents(pixels)
    chosen = np.zeros(count, np.uint8)
    chosen[labels[seeds]] = 1
    chosen[0] = 0
    found: ByteArray = chosen[labels]
    return found


def _square(side_px: int) -> ByteArray:
    return np.ones((side_px, side_px), np.uint8)
