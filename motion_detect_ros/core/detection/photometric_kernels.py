"""The loops over pixels of prediction errors and of the photometric test.

They stand together because what they share is compiled once in a process, and kernels of one module are compiled by
one process (``kernel_compiler``).
"""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.detection.enlarging import enlarge_row, find_columns
from motion_detect_ros.core.kernels import kernel

#: Window over which errors are averaged, and its pixels beside its centre.
WINDOW_PX = 3
BESIDE_PX = WINDOW_PX // 2
#: Window in which a change at the origin is searched, pixels.
SLACK_PX = 5


@kernel()
def compare(  # type: ignore[no-untyped-def]
    current, reference, back, errors, boxes, flows, apart, whole, motions, noise, change, threshold, first, step,
    indices, corners, rows, sums, moved, spans, origins, over, starts, masks, gains,
):
    """``masks``: pixels of every ``step``-th region with a gain over ``threshold`` and a change at their origin, within
    the region's reach; ``gains``: over ``noise``, 0 where the background leaves no more than ``threshold``; those of
    each begin at ``starts``, (n + 1,).

    errors: of the background, (H, W); boxes: (n, 5) left, top, right, bottom, reach; flows: (1, gh, gw, 2) of the
    background; apart: there is one for each region, and errors are scratch, (1, .) uint16 for the largest region with
    what it reaches to and a pixel more; whole: (1, 1) True; motions: (n, 2); change: mean error from which the image
    changed; masks: False; scratch for the largest region: origins: (., 4) int32; with what it reaches to: moved:
    uint16, over: bool, (.,); spans: (., 2); of two columns more than that: indices: (2, .) uint32, corners: (4, .)
    uint8, rows: (9, .), sums: (.,) int32.
    """
    slack, size = SLACK_PX // 2, current.shape
    for n in range(first, len(boxes), step):
        left, top, right, bottom, reach = boxes[n, 0], boxes[n, 1], boxes[n, 2], boxes[n, 3], boxes[n, 4]
        still, flow, still_left, still_top = errors, flows[n if apart else 0], 0, 0
        if apart:
            still_left, still_top = max(0, left - reach - BESIDE_PX), max(0, top - reach - BESIDE_PX)
            wide = min(size[1], right + reach + BESIDE_PX) - still_left
            high = min(size[0], bottom + reach + BESIDE_PX) - still_top
            still = errors.ravel()[:high * wide].reshape(high, wide)
            fill_tiles(current, reference, back, still_left, still_top, flow, max(high, wide), whole, 0, 1, indices,
                       corners, rows, still)
        mask = masks[starts[n]:starts[n + 1]].reshape(bottom - top, right - left)
        gain = gains[starts[n]:starts[n + 1]].reshape(bottom - top, right - left)
        beside_left, beside_top = max(0, left - BESIDE_PX), max(0, top - BESIDE_PX)
        wide, high = min(size[1], right + BESIDE_PX) - beside_left, min(size[0], bottom + BESIDE_PX) - beside_top
        there, across, down = moved[:wide * high].reshape(high, wide), left - beside_left, top - beside_top
        _fill_spans(still, left - still_left, top - still_top, across, down, noise, threshold, sums, gain, spans)
        _fill_moved(current, reference, back, beside_left, beside_top, motions[n], indices[0], corners, rows, spans,
                    there)
        _fill_gains(there, across, down, noise, threshold, spans, sums, rows[0], mask, gain)
        count = _fill_origins(flow, left, top, motions[n], size, across, down, spans, indices[1], rows, mask, origins)
        left, right, top, bottom = (max(0, left - reach), min(size[1], right + reach), max(0, top - reach),
                                    min(size[0], bottom + reach))
        begin, end, above, below = right, left, bottom, top
        for m in range(count):
            column, row = origins[m, 2], origins[m, 3]
            if left <= column < right and top <= row < bottom:
                begin, end = min(begin, column - slack), max(end, column + slack + 1)
                above, below = min(above, row - slack), max(below, row + slack + 1)
        begin, end, above, below = max(left, begin), min(right, end), max(top, above), min(bottom, below)
        wide = end - begin
        for row in range(above, below):
            row_means(still, row - still_top, begin - still_left, sums, rows[0, :wide])
            for m in range(wide):
                over[(row - above) * wide + m] = rows[0, m] > change
        for m in range(count):
            column, row = origins[m, 2], origins[m, 3]
            if not (left <= column < right and top <= row < bottom and _any_near(
                    over, wide, column - begin, row - above, below - above)):
                mask[origins[m, 0], origins[m, 1]] = False


@kernel(error_model='numpy')
def _fill_spans(  # type: ignore[no-untyped-def]
    errors, left, top, right, down, noise, threshold, sums, gain, spans,
):
    """``gain``: (h, w) background's mean errors at left, top of those, where they are over ``threshold``, else 0;
    ``spans``: (., 2) first of those in each row and one beyond the last, in a box that the region is right, down in.
    """
    height, width = gain.shape
    for q in range(height + 2 * BESIDE_PX):
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
    (height, width), flow = moved.shape, rows[2:4]
    for c in range(width):
        flow[0, c], flow[1, c] = motion[0], motion[1]
    for q in range(height):
        start, end = spans[q, 0], spans[q, 1]
        for n in range(max(q - 1, 0), min(q + 2, height)):
            start, end = min(start, spans[n, 0]), max(end, spans[n, 1])
        start, end = max(start - BESIDE_PX, 0), min(end + BESIDE_PX, width)
        if start < end:
            row_errors(current, reference, back, left + start, top + q, flow, end - start, rows, corner, corners,
                       moved[q, start:])


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
    flow, left, top, motion, size, right, down, spans, west, rows, mask, origins,
):
    """First rows of ``origins``: row and column of each pixel of ``mask``, (h, w) at left, top, and column and row of
    the image where it was before it moved by ``motion`` beyond the flow, -1 beyond the image; returns their number.
    """
    count, above, share, line, lines, width = 0, -1, rows[8], rows[2:4], rows[4:8], mask.shape[1]
    find_columns(left, flow.shape[1], size[1], width, west, share)
    for r in range(len(mask)):
        start, end = spans[down + r, 0] - right, spans[down + r, 1] - right
        while start < end and not mask[r, start]:
            start += 1
        if start >= end:
            continue
        above = enlarge_row(flow, top + r, size[0], width, west, share, above, lines, line)
        for c in range(start, end):
            if mask[r, c]:
                x = np.float32(left + c) - (motion[0] - line[0, c])
                y = np.float32(top + r) - (motion[1] - line[1, c])
                seen = -1.0 < x < size[1] and -1.0 < y < size[0]
                origins[count, 0], origins[count, 1] = r, c
                origins[count, 2] = np.int32(np.rint(x)) if seen else -1
                origins[count, 3] = np.int32(np.rint(y)) if seen else -1
                count += 1
    return count


@kernel()
def _any_near(values, wide, column, row, high):  # type: ignore[no-untyped-def]
    """Whether one of (high, wide) values, row after row, is True near a place."""
    slack = SLACK_PX // 2
    for r in range(max(0, row - slack), min(high, row + slack + 1)):
        for c in range(max(0, column - slack), min(wide, column + slack + 1)):
            if values[r * wide + c]:
                return True
    return False


@kernel()
def fill_tiles(  # type: ignore[no-untyped-def]
    current, reference, back, left, top, flow, tile_px, wanted, first, step, indices, corners, rows, errors,
):
    """``errors``: (h, w) at left, top of the current image, of the tiles that are ``wanted``, (th, tw), in every
    ``step``-th row of them.

    flow: (gh, gw, 2) of a grid over the image, (1, 1, 2) where it is the same everywhere; scratch: indices: (2, w)
    uint32, corners: (4, w) uint8, rows: (9, w).
    """
    (height, width), west, share, line, lines = errors.shape, indices[1], rows[8], rows[2:4], rows[4:8]
    for band in range(first, len(wanted), step):
        end = 0
        for column in range(wanted.shape[1]):
            if not wanted[band, column] or column * tile_px < end:
                continue
            start, tile, above = column * tile_px, column, -1
            while tile < wanted.shape[1] and wanted[band, tile]:
                tile += 1
            end = min(width, tile * tile_px)
            find_columns(left + start, flow.shape[1], current.shape[1], end - start, west, share)
            for r in range(band * tile_px, min(height, (band + 1) * tile_px)):
                above = enlarge_row(flow, top + r, current.shape[0], end - start, west, share, above, lines, line)
                row_errors(current, reference, back, left + start, top + r, line, end - start, rows, indices[0],
                           corners, errors[r, start:])


@kernel()
def row_errors(  # type: ignore[no-untyped-def]
    current, reference, back, left, row, flow, count, place, corner, corners, errors,
):
    """``errors``: (.,) uint16 squared ones of the grey values of ``count`` pixels from ``left`` on of a row of the
    current image under a flow (2, .).

    Scratch: place: (2, .), corner: (.,) uint32, corners: (4, .) uint8. A row at a time, as only the look-up of pixels
    cannot be vectorised.
    """
    for c in range(count):
        place[0, c], place[1, c] = np.float32(np.int32(left + c)) - flow[0, c], np.float32(row) - flow[1, c]
    grey_before(reference, back, place[0], place[1], count, corner, corners)
    for c in range(count):
        miss = np.int32(current[row, left + c]) - np.int32(place[0, c])
        errors[c] = np.uint16(miss * miss)


@kernel()
def row_means(errors, row, begin, sums, means):  # type: ignore[no-untyped-def]
    """``means``: (w,) of errors (., .) from ``begin`` on of a row, each over its window; beyond the border those of the
    pixels within are mirrored. sums: (w + 2 or more,) int32.
    """
    last, width = errors.shape[1] - 1, len(means)
    first, after = max(0, begin - 1), min(last, begin + width) + 1
    above, own, below = _three_rows(errors, row, first, after)
    three = sums[first - begin + 1:after - begin + 1]
    for n in range(len(three)):
        three[n] = np.int32(above[n]) + np.int32(own[n]) + np.int32(below[n])
    if begin == 0:
        sums[0] = sums[1 + min(1, last)]
    if begin + width > last:
        sums[width + 1] = sums[width - 1 if last > 0 else 1]
    west, middle, east = sums[:width], sums[1:width + 1], sums[2:width + 2]
    for n in range(width):
        means[n] = np.float64(west[n] + middle[n] + east[n]) * (1.0 / WINDOW_PX ** 2)


@kernel()
def _three_rows(errors, row, first, after):  # type: ignore[no-untyped-def]
    """Columns ``first`` .. ``after`` of the row above a row, of itself and of the one below, mirrored at the ends."""
    last = errors.shape[0] - 1
    above, below = row - 1 if row > 0 else min(1, last), row + 1 if row < last else max(last - 1, 0)
    return errors[above, first:after], errors[row, first:after], errors[below, first:after]


@kernel(error_model='numpy')
def grey_before(image, back, x, y, count, corner, corners):  # type: ignore[no-untyped-def]
    """``x``: (.,) of ``count`` positions with ``y``, then grey values of an image at what ``back`` makes of them.

    Linear, rounded; beyond the border of the image, and for NaN, those of the border. Scratch: corner: (.,) uint32, of
    the upper left of the four pixels around, counted row by row; corners: (4, .) uint8.
    """
    rows, columns = image.shape
    pixels, right, below = image.ravel(), np.uint32(min(1, columns - 1)), np.uint32(columns if rows > 1 else 0)
    a, b, c, d, e, f = back[0, 0], back[0, 1], back[0, 2], back[1, 0], back[1, 1], back[1, 2]
    g, h, i = back[2, 0], back[2, 1], back[2, 2]
    zero, last_x, last_y = np.float32(0.0), np.float32(columns - 1), np.float32(rows - 1)
    last_left, last_top = np.float32(max(columns - 2, 0)), np.float32(max(rows - 2, 0))
    for n in range(count):
        depth = g * x[n] + h * y[n] + i
        px, py = (a * x[n] + b * y[n] + c) / depth, (d * x[n] + e * y[n] + f) / depth
        px, py = px if px > zero else zero, py if py > zero else zero
        px, py = px if px < last_x else last_x, py if py < last_y else last_y
        left, top = np.int32(px if px < last_left else last_left), np.int32(py if py < last_top else last_top)
        x[n], y[n] = px - np.float32(left), py - np.float32(top)
        corner[n] = np.uint32(top) * np.uint32(columns) + np.uint32(left)
    for n in range(count):
        corners[0, n], corners[1, n] = pixels[corner[n]], pixels[corner[n] + right]
        corners[2, n], corners[3, n] = pixels[corner[n] + below], pixels[corner[n] + below + right]
    for n in range(count):
        nw, ne = np.float32(corners[0, n]), np.float32(corners[1, n])
        sw, se = np.float32(corners[2, n]), np.float32(corners[3, n])
        high, low = nw + x[n] * (ne - nw), sw + x[n] * (se - sw)
        x[n] = np.rint(high + y[n] * (low - high))
