"""Features of a flow field, selectable as input of ART2 (``art2.features``).

A field is (gh, gw, 2), (dx, dy) in pixels, NaN where the flow is unknown. Every feature is NaN there, and only
there: neighbours use the cells that are known. Windows are squares of an odd number of cells, cut at the
border of the field.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.errors import FrameError
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import BoolArray, FloatArray

Bins = npt.NDArray[np.intp]

#: Bins of the local histograms; a window of 7 x 7 cells fills them.
BINS = 8
#: Bins of the histogram of a whole object or image; Chaudhry et al. 2009 find no gain beyond 30.
HOOF_BINS = 30


def angle(flow: FloatArray) -> FloatArray:
    """(gh, gw) direction, radians in (-pi, pi], 0 along +x, positive towards +y (down in the image)."""
    direction: FloatArray = np.arctan2(flow[..., 1], flow[..., 0])
    return direction


def divergence(flow: FloatArray, cell_px: tuple[float, float]) -> FloatArray:
    """(gh, gw) d(dx)/dx + d(dy)/dy, "per baseline": an expansion by the factor 1 + s has 2 s.

    flow: (gh, gw, 2) pixels; cell_px: width and height of a grid cell, pixels. Central differences, one-sided beside
    unknown cells and the border. Source: Koenderink and van Doorn 1976.
    """
    expansion: FloatArray = _along_x(flow[..., 0], cell_px) + _along_y(flow[..., 1], cell_px)
    return expansion


def curl(flow: FloatArray, cell_px: tuple[float, float]) -> FloatArray:
    """(gh, gw) d(dy)/dx - d(dx)/dy: a rotation by w radians has 2 w, positive for a turn from +x towards +y.

    Arguments, differences and source as in ``divergence``.
    """
    turn: FloatArray = _along_x(flow[..., 1], cell_px) - _along_y(flow[..., 0], cell_px)
    return turn


def consistency(flow: FloatArray, window: int) -> FloatArray:
    """(gh, gw) 1 - |f - m| / (|f| + |m|) in [0, 1], m the mean vector of the other cells of the window.

    1 where a cell moves as its neighbours do, 0 where it moves against them or alone; NaN without neighbours.
    """
    known = _known(flow)
    others = _window_sum(known.astype(np.float32)[..., None], window)[..., 0] - 1.0
    others[(others < 0.5) | ~known] = np.nan
    mean = (_window_sum(flow, window) - flow) / others[..., None]
    both = magnitude(flow) + magnitude(mean)
    agreement = 1.0 - magnitude(flow - mean) / np.where(both > 0.0, both, 1.0)
    return np.clip(agreement, 0.0, 1.0).astype(np.float32)


def temporal_change(flow: FloatArray, previous: FloatArray | None) -> FloatArray:
    """(gh, gw) |f - f_previous| of the same cell, pixels; NaN where either is unknown or there is no previous field.

    Raises: FrameError where the fields have different shapes.
    """
    if previous is None:
        return np.full(flow.shape[:2], np.nan, np.float32)
    if previous.shape != flow.shape:
        raise FrameError(f'previous flow: expected shape {flow.shape}, got {previous.shape}')
    return magnitude(flow - previous)


def hoof(flow: FloatArray, bins: int = HOOF_BINS) -> FloatArray:
    """(bins,) histogram of oriented optical flow: share of the total length in each direction, sums to 1.

    flow: (..., 2) vectors of an object or an image, NaN = unknown. Bin b of B holds the angles to the horizontal from
    -pi/2 + pi b / B on, left and right alike, each vector with its length: what walks left looks as what walks right,
    and small noise counts little. All zero where nothing moves.
    Source: Chaudhry et al. 2009, section 2.
    """
    vectors = flow[np.isfinite(flow).all(axis=-1)]
    length = magnitude(vectors)
    counts = np.bincount(_symmetric_bin(vectors, bins), length, bins)
    total = float(counts.sum())
    return (counts / (total if total > 0.0 else 1.0)).astype(np.float32)


def local_hoof(flow: FloatArray, window: int, bins: int = BINS) -> FloatArray:
    """(gh, gw, bins) ``hoof`` of the window around every cell."""
    return _shares(_window_histogram(flow, _symmetric_bin(flow, bins), window, bins), flow)


def entropy(flow: FloatArray, window: int, bins: int = BINS) -> FloatArray:
    """(gh, gw) - sum p ln p of the directions in the window, nats in [0, ln ``bins``].

    p: shares of the total length that fall into ``bins`` equal sectors of the full circle. 0 for one direction,
    greatest for all directions alike (Shannon 1948); 0 also where nothing moves.
    """
    p = _shares(_window_histogram(flow, _full_bin(flow, bins), window, bins), flow)
    total: FloatArray = -(p * np.log(np.where(p > 0.0, p, 1.0))).sum(axis=-1)
    return np.maximum(total, 0.0).astype(np.float32)


def coherence(flow: FloatArray, window: int) -> FloatArray:
    """(gh, gw) |sum of vectors| / sum of lengths in the window, in [0, 1].

    1 where all move one way, near 0 where directions cancel; 1 also where nothing moves. The mean resultant length of
    directional statistics (Mardia and Jupp 2000, 2.3.1), weighted by length.
    """
    total = magnitude(_window_sum(flow, window))
    lengths = _window_sum(magnitude(flow)[..., None], window)[..., 0]
    share = np.where(lengths > 0.0, total / np.where(lengths > 0.0, lengths, 1.0), 1.0)
    return np.where(_known(flow), np.minimum(share, 1.0), np.nan).astype(np.float32)


def _known(values: FloatArray) -> BoolArray:
    """(gh, gw) True where all of (gh, gw, n) values are known."""
    known: BoolArray = np.all(np.isfinite(values), axis=-1)
    return known


def _window_sum(values: FloatArray, window: int) -> FloatArray:
    """(gh, gw, n) sum of the known values in the window around each cell. Raises: FrameError for an even window."""
    if window < 1 or window % 2 == 0:
        raise FrameError(f'window: expected an odd number of cells, got {window}')
    filled = np.where(_known(values)[..., None], values, 0.0).astype(np.float32)
    sums: FloatArray = cv2.boxFilter(
        filled, -1, (window, window), normalize=False, borderType=cv2.BORDER_CONSTANT).reshape(values.shape)
    return sums


def _symmetric_bin(flow: FloatArray, bins: int) -> Bins:
    """Bin of each vector's angle to the horizontal, left and right alike; 0 where it is unknown."""
    theta = np.nan_to_num(np.arctan2(flow[..., 1], np.abs(flow[..., 0])))
    return np.clip(np.floor((theta / np.pi + 0.5) * bins), 0, bins - 1).astype(np.intp)


def _full_bin(flow: FloatArray, bins: int) -> Bins:
    """Sector of each vector's direction, the first one about +x; 0 where it is unknown."""
    theta = np.nan_to_num(angle(flow))
    return np.rint(theta / (2.0 * np.pi) * bins).astype(np.intp) % bins


def _window_histogram(flow: FloatArray, index: Bins, window: int, bins: int) -> FloatArray:
    """(gh, gw, bins) total length in each bin, over the window."""
    weights = np.zeros((*flow.shape[:2], bins), np.float32)
    np.put_along_axis(weights, index[..., None], np.nan_to_num(magnitude(flow))[..., None], axis=-1)
    return _window_sum(weights, window)


def _shares(counts: FloatArray, flow: FloatArray) -> FloatArray:
    """Histograms that sum to 1 (0 where nothing moves), NaN where the flow is unknown."""
    total = counts.sum(axis=-1, keepdims=True)
    shares = counts / np.where(total > 0.0, total, 1.0)
    shares[~_known(flow)] = np.nan
    return shares.astype(np.float32)


def _along_x(component: FloatArray, cell_px: tuple[float, float]) -> FloatArray:
    return _along_y(component.T, (cell_px[1], cell_px[0])).T


def _along_y(component: FloatArray, cell_px: tuple[float, float]) -> FloatArray:
    """Mean of the differences to both sides, of one where the other is unknown."""
    border = np.full((1, component.shape[1]), np.nan, np.float32)
    step = np.concatenate([border, np.diff(component, axis=0), border]) / np.float32(cell_px[1])
    back, ahead = step[:-1], step[1:]
    total: FloatArray = np.where(np.isnan(back), ahead, back) + np.where(np.isnan(ahead), back, ahead)
    return total / np.float32(2.0)
