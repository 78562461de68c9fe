"""Photometric test: which pixels does an object's motion explain better than the background flow?

Two hypotheses for every pixel of a candidate: it moved with the background, or with the object. Each predicts the
pixel from the reference frame. The likelihood gain is the squared error of the first less that of the second, over the
variance of the image noise, averaged over a small window. It is near zero for flow smeared around an object and for
false flow on textureless ground.

Uncovered background may fit the object's motion too (the ghost of every difference image). A pixel of the object at p
was at p - motion before, and there the image changed as well; for a ghost that place lies behind the object, where
nothing changed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.enlarging import enlarge_row, find_columns
from motion_detect_ros.core.detection.image_pair import ImagePair
from motion_detect_ros.core.detection.prediction_errors import BESIDE_PX, PredictionErrors, row_errors, row_means
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.threads import HELPERS
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Window in which a change at the origin is searched, pixels.
SLACK_PX = 5


@dataclass(frozen=True)
class BackgroundMotion:
    """``flow``: (gh, gw, 2) beyond the ego-motion on a grid over the image, pixels over the pair, (1, 1, 2) where it is
    the same everywhere; ``errors``: under it.
    """

    flow: FloatArray
    errors: PredictionErrors


@dataclass(frozen=True)
class Place:
    """``region`` that an object may cover; ``reach``: how far beyond it its pixels may come from (``reach_px``), those
    from farther away count as background; ``motion``: (2,) over the pair, beyond the ego-motion; working pixels.
    """

    region: Box
    reach: int
    motion: FloatArray


@dataclass(frozen=True)
class PhotometricTest:
    """``foreground``: (h, w) mask of the moving object; ``gain``: (h, w) likelihood gain, 0 where the background alone
    explains a pixel.
    """

    foreground: BoolArray
    gain: FloatArray


@dataclass(frozen=True)
class PhotometricTests:
    """Those of several regions. ``boxes``: (n, 4) left, top, right, bottom of them; ``starts``: (n + 1,) where the
    pixels of each begin in ``foreground`` and ``gain``.
    """

    boxes: npt.NDArray[np.int64]
    starts: npt.NDArray[np.int64]
    foreground: BoolArray
    gain: FloatArray

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index: int) -> PhotometricTest:
        left, top, right, bottom = self.boxes[index].tolist()
        shape, there = (bottom - top, right - left), slice(self.starts[index], self.starts[index + 1])
        return PhotometricTest(self.foreground[there].reshape(shape), self.gain[there].reshape(shape))


def photometric_tests(
    pair: ImagePair, background: BackgroundMotion, places: Sequence[Place], noise_gray: float, threshold_sigma: float,
    parts: int = 1,
) -> PhotometricTests:
    """Which pixels of each place its motion explains better than the background, by ``threshold_sigma`` noise levels.

    Errors of ``background`` are known within the places' reach; noise_gray: one deviation; parts: threads.
    """
    boxes = np.array([(*each.region.edges, each.reach) for each in places])
    motions = np.stack([each.motion for each in places])
    sides, known = boxes[:, 2:4] - boxes[:, :2], background.errors
    starts = np.concatenate([[0], np.cumsum(sides.prod(axis=1))])
    foreground, gain = np.zeros(starts[-1], np.bool_), np.empty(starts[-1], np.float32)
    reach = 2 * np.maximum(boxes[:, 4:], BESIDE_PX) + 2 * BESIDE_PX
    (width, height), area = (sides + reach).max(axis=0).tolist(), int((sides + reach).prod(axis=1).max())

    def every(first: int) -> None:
        _compare_all(*pair.pictures, pair.back, known.values, known.box.left, known.box.top, boxes, background.flow,
                     motions, np.float32(noise_gray ** 2), np.float32((noise_gray * threshold_sigma) ** 2),
                     np.float32(threshold_sigma ** 2), first, parts, np.empty((2, width), np.uint32),
                     np.empty((4, width), np.uint8), np.empty((9, width), np.float32), np.empty(width, np.int32),
                     np.empty(area, np.uint16), np.empty((height, 2), np.int64), np.empty(2 * area, np.int32),
                     np.empty(area, np.bool_), starts, foreground, gain)

    HELPERS.share(every, range(parts))
    tests = PhotometricTests(boxes[:, :4], starts, foreground, gain)
    if pair.mask is not None:
        for n, place in enumerate(places):
            region, mask = place.region, tests[n].foreground
            mask &= pair.mask[region.top:region.bottom, region.left:region.right]
    return tests


def reach_px(object_motion: FloatArray) -> int:
    """Largest distance of an object's pixels from their origins, with the slack of the test.

    object_motion: (2,) pixels over the pair, against the background.
    """
    return math.ceil(float(np.hypot(object_motion[0], object_motion[1]))) + SLACK_PX


@kernel()
def _compare_all(  # type: ignore[no-untyped-def]
    current, reference, back, errors, errors_left, errors_top, boxes, flow, motions, noise, change, threshold, first,
    step, indices, corners, rows, sums, moved, spans, origins, over, starts, masks, gains,
):
    """``masks``, ``gains``: (.,) of every ``step``-th of the regions ``boxes``, (n, 5) left, top, right, bottom, reach,
    whose pixels begin at ``starts``, (n + 1,); motions: (n, 2); scratch as ``_compare``, for the largest.
    """
    height, width = current.shape
    for n in range(first, len(boxes), step):
        left, top, right, bottom, reach = boxes[n]
        window = max(0, left - reach), max(0, top - reach), min(width, right + reach), min(height, bottom + reach)
        around_left, around_top = max(0, left - BESIDE_PX), max(0, top - BESIDE_PX)
        wide, high = min(width, right + BESIDE_PX) - around_left, min(height, bottom + BESIDE_PX) - around_top
        shape = bottom - top, right - left
        area, start, end = shape[0] * shape[1], starts[n], starts[n + 1]
        beyond = (window[3] - window[1]) * (window[2] - window[0])
        _compare(current, reference, back, errors, errors_left, errors_top, left, top, around_left, around_top, window,
                 flow, motions[n], noise, change, threshold, indices, corners, rows, sums,
                 moved[:wide * high].reshape(high, wide), spans[:high],
                 origins[:2 * area].reshape(shape[0], shape[1], 2),
                 over[:beyond].reshape(window[3] - window[1], window[2] - window[0]),
                 masks[start:end].reshape(shape), gains[start:end].reshape(shape))


@kernel()
def _compare(  # type: ignore[no-untyped-def]
    current, reference, back, errors, errors_left, errors_top, left, top, around_left, around_top, window, flow, motion,
    noise, change, threshold, indices, corners, rows, sums, moved, spans, origins, over, mask, gain,
):
    """``mask``: pixels of a region at left, top with a gain over ``threshold`` and a change at their origin, which is
    in the window (left, top, right, bottom); ``gain``: over ``noise``, 0 where the background leaves no more than
    ``threshold``.

    errors: of the background, at errors_left, errors_top, known in the window and beside it; motion: (2,); change: mean
    error from which the image changed; mask: False; scratch: moved, spans: (., .) uint16 and (., 2) of the region and
    what is beside it, at around_left, around_top; origins: (h, w, 2) int32; over: as large as the window; indices: (2,
    .) uint32, corners: (4, .) uint8, rows: (9, .), sums: (.,) int32 of w + 2 and more.
    """
    right, down = left - around_left, top - around_top
    _fill_spans(errors, left - errors_left, top - errors_top, right, down, noise, threshold, sums, gain, spans)
    _fill_moved(current, reference, back, around_left, around_top, motion, indices[0], corners, rows, spans, moved)
    _fill_gains(moved, right, down, noise, threshold, spans, sums, rows[0], mask, gain)
    first_x, last_x, first_y, last_y = _fill_origins(
        flow, left, top, window, motion, current.shape, right, down, spans, indices[1], rows, mask, origins)
    if last_x < first_x:
        return
    slack = SLACK_PX // 2
    first_x, last_x = max(window[0], first_x - slack), min(window[2], last_x + slack + 1)
    first_y, last_y = max(window[1], first_y - slack), min(window[3], last_y + slack + 1)
    means = rows[0, :last_x - first_x]
    for row in range(first_y, last_y):
        row_means(errors, row - errors_top, first_x - errors_left, sums, means)
        for n in range(len(means)):
            over[row - window[1], first_x - window[0] + n] = means[n] > change
    for r in range(mask.shape[0]):
        for c in range(spans[down + r, 0] - right, spans[down + r, 1] - right):
            if mask[r, c]:
                column, row = origins[r, c, 0], origins[r, c, 1]
                mask[r, c] = _any(over, max(window[1], row - slack) - window[1],
                                  min(window[3], row + slack + 1) - window[1],
                                  max(window[0], column - slack) - window[0],
                                  min(window[2], column + slack + 1) - window[0])


@kernel(error_model='numpy')
def _fill_spans(  # type: ignore[no-untyped-def]
    errors, left, top, right, down, noise, threshold, sums, gain, spans,
):
    """``gain``: (h, w) background's mean errors at left, top of those, where they are over ``threshold``, else 0;
    ``spans``: (., 2) first of those in each row and one beyond the last, in a box that the region is right, down in.
    """
    height, width = gain.shape
    for q in range(len(spans)):
        spans[q, 0], spans[q, 1] = right + width, 0
    for r in range(height):
        means = gain[r]
        row_means(errors, top + r, left, sums, means)
        for c in range(width):
            means[c] = means[c] if means[c] / noise > threshold else np.float32(0.0)
        first, last = 0, width
        while first < width and means[first] == 0.0:
            first += 1
        while last > first and means[last - 1] == 0.0:
            last -= 1
        if first < last:
            spans[down + r, 0], spans[down + r, 1] = right + first, right + last


@kernel()
def _fill_moved(  # type: ignore[no-untyped-def]
    current, reference, back, left, top, motion, corner, corners, rows, spans, moved,
):
    """``moved``: (h, w) errors under a motion at left, top of the current image, in the spans and beside them."""
    height, width = moved.shape
    for q in range(height):
        start, end = spans[q, 0], spans[q, 1]
        for n in (max(q - 1, 0), min(q + 1, height - 1)):
            start, end = min(start, spans[n, 0]), max(end, spans[n, 1])
        start, end = max(start - BESIDE_PX, 0), min(end + BESIDE_PX, width)
        if start < end:
            row_errors(current, reference, back, left + start, top + q, motion[:1], motion[1:], rows, corner, corners,
                       moved[q, start:end])


@kernel(error_model='numpy')
def _fill_gains(moved, right, down, noise, threshold, spans, sums, means, mask, gain):  # type: ignore[no-untyped-def]
    """``gain``: (h, w) from the background's errors there, at right, down of ``moved``; ``mask``: over ``threshold``.

    sums: (w + 2 or more,) int32; means: (w or more,).
    """
    for r in range(len(gain)):
        start, end = spans[down + r, 0], spans[down + r, 1]
        if start >= end:
            continue
        mean = means[:end - start]
        gains, passed = gain[r, start - right:end - right], mask[r, start - right:end - right]
        row_means(moved, down + r, start, sums, mean)
        for c in range(len(mean)):
            gains[c] = (gains[c] - mean[c]) / noise if gains[c] > 0.0 else np.float32(0.0)
        for c in range(len(mean)):
            passed[c] = gains[c] > threshold


@kernel()
def _fill_origins(  # type: ignore[no-untyped-def]
    flow, left, top, window, motion, size, right, down, spans, west, rows, mask, origins,
):
    """``origins``: column and row where each pixel of ``mask``, (h, w) at left, top, was before it moved by ``motion``
    beyond the flow; ``mask`` is cleared where that is not in the window. Returns the first and the last column and row.
    """
    (height, width), above, (window_left, window_top, window_right, window_bottom) = mask.shape, -1, window
    west, share, line, lines = west[:width], rows[8, :width], rows[2:4], rows[4:8]
    first_x, last_x, first_y, last_y = window_right, window_left - 1, window_bottom, window_top - 1
    find_columns(left, flow.shape[1], size[1], west, share)
    for r in range(height):
        start, end = spans[down + r, 0] - right, spans[down + r, 1] - right
        if start >= end or not mask[r, start:end].any():
            continue
        above = enlarge_row(flow, top + r, size[0], west, share, above, lines, line)
        for c in range(start, end):
            if not mask[r, c]:
                continue
            x = np.float32(left + c) - (motion[0] - line[0, c])
            y = np.float32(top + r) - (motion[1] - line[1, c])
            column, row = -1, -1
            if window_left - 1.0 < x < window_right and window_top - 1.0 < y < window_bottom:
                column, row = int(np.rint(x)), int(np.rint(y))
            mask[r, c] = window_left <= column < window_right and window_top <= row < window_bottom
            if mask[r, c]:
                origins[r, c, 0], origins[r, c, 1] = column, row
                first_x, last_x = min(first_x, column), max(last_x, column)
                first_y, last_y = min(first_y, row), max(last_y, row)
    return first_x, last_x, first_y, last_y


@kernel()
def _any(values, top, bottom, left, right):  # type: ignore[no-untyped-def]
    """Whether one of a window is True."""
    for r in range(top, bottom):
        for c in range(left, right):
            if values[r, c]:
                return True
    return False
