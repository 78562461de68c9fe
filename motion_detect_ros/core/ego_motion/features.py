"""Feature detectors; the features are distributed evenly over the image."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.preprocessing.scene_mask import inner_scene
from motion_detect_ros.core.types import BoolArray, ByteArray, DoubleArray, FloatArray

#: Window of the corner response, and least distance of points from the border, pixels.
BLOCK_PX = 5
#: Least distance from what the mask leaves out, pixels: neither the corner response at half resolution nor the window
#: of the tracker, of 16 px, may see text or hull, which stand still.
MASKED_PX = 7
#: Width from which corners are detected at half resolution: tracking needs texture, not an exact corner position.
HALVED_FROM_PX = 640
#: Cells over which points are distributed.
ROWS, COLUMNS = 6, 8
#: Weight of the squared trace in the score of Harris and Stephens.
HARRIS_K = 0.04
#: Contrast threshold of FAST, ORB and BRISK, grey levels.
CONTRAST_GRAY = 4
#: ORB detects this many times the wanted features, so that every cell has a choice.
ORB_SURPLUS = 32
#: Octaves of BRISK above the image itself: the centre of a large blob is textureless for the tracker.
BRISK_OCTAVES = 1
#: Contrast that an extremal region must be stable over, grey levels, and the areas it may have, pixels: the tracker's
#: window must see its border.
MSER_DELTA_GRAY, MSER_MIN_AREA, MSER_MAX_AREA = 2, 20, 1000

Response = Callable[[ByteArray], FloatArray]
Detector = Callable[[ByteArray, int, ByteArray], tuple[DoubleArray, DoubleArray]]


class AllowedPlaces:
    """Where points may be, kept while images come with the same mask."""

    def __init__(self) -> None:
        self._mask: BoolArray | None = None
        self._allowed: BoolArray | None = None

    def of(self, shape: tuple[int, ...], mask: BoolArray | None) -> BoolArray:
        """(H, W) = ``shape``: pixels at least ``BLOCK_PX`` from the border, ``MASKED_PX`` from what is masked out."""
        if self._allowed is None or self._allowed.shape != shape or mask is not self._mask:
            self._mask, self._allowed = mask, _allowed(shape, mask)
        return self._allowed


def find_features(
    kind: str, gray: ByteArray, count: int, quality: float, mask: BoolArray | None = None,
    places: AllowedPlaces | None = None,
) -> FloatArray:
    """The strongest points of every cell of a grid, so that one textured spot does not dominate.

    kind: ``shi_tomasi`` (smallest eigenvalue of the structure tensor, Shi and Tomasi 1994), ``harris`` (Harris and
    Stephens 1988), ``fast`` (Rosten and Drummond 2006), ``orb`` (FAST over scales, ranked by Harris, Rublee et al.
    2011), ``brisk`` (Leutenegger et al. 2011), ``mser`` (centres of small maximally stable regions, Matas et al. 2002).
    gray: (H, W) uint8; quality: smallest strength, relative to the best; mask: (H, W), no points where it is
    False, nor within ``MASKED_PX`` of it; places: of earlier calls.
    Returns (N, 2) float32, pixels (x, y), N <= max(count, number of cells).
    Raises: BackendError for a kind that is unknown or not in this OpenCV.
    Source of the grid: Kitt et al. 2010.
    """
    allowed = (places or AllowedPlaces()).of(gray.shape, mask)
    if kind in RESPONSES:
        points, strength = _corners(RESPONSES[kind], gray, allowed, quality)
    elif kind in DETECTORS:
        points, strength = _inside(*DETECTORS[kind](gray, count, allowed.view(np.uint8)), allowed)
        strong = strength > quality * strength.max(initial=0.0)
        points, strength = points[strong], strength[strong]
    else:
        raise BackendError(f'features: expected one of {", ".join(KINDS)}, got {kind!r}')
    return _spread(points, strength, gray.shape, count).astype(np.float32)


def check_features(kind: str) -> None:
    """Raises: BackendError for a kind that is unknown or not in this OpenCV."""
    find_features(kind, np.zeros((64, 64), np.uint8), ROWS * COLUMNS, 0.5)


def _shi_tomasi(gray: ByteArray) -> FloatArray:
    response: FloatArray = cv2.cornerMinEigenVal(gray, BLOCK_PX, ksize=3)
    return response


def _harris(gray: ByteArray) -> FloatArray:
    response: FloatArray = cv2.cornerHarris(gray, BLOCK_PX, ksize=3, k=HARRIS_K)
    return response


def _fast(gray: ByteArray, _count: int, allowed: ByteArray) -> tuple[DoubleArray, DoubleArray]:
    return _keypoints(cv2.FastFeatureDetector_create(CONTRAST_GRAY).detect(gray, allowed))


def _orb(gray: ByteArray, count: int, allowed: ByteArray) -> tuple[DoubleArray, DoubleArray]:
    return _keypoints(cv2.ORB_create(
        ORB_SURPLUS * count, edgeThreshold=BLOCK_PX, fastThreshold=CONTRAST_GRAY).detect(gray, allowed))


def _brisk(gray: ByteArray, _count: int, allowed: ByteArray) -> tuple[DoubleArray, DoubleArray]:
    create = getattr(cv2, 'BRISK_create', None) or getattr(getattr(cv2, 'xfeatures2d', None), 'BRISK_create', None)
    if create is None:
        raise BackendError(f'features brisk: not in this OpenCV ({cv2.__version__}); '
                           'install opencv-contrib-python-headless')
    return _keypoints(create(CONTRAST_GRAY, BRISK_OCTAVES).detect(gray, allowed))


def _mser(gray: ByteArray, _count: int, _allowed: ByteArray) -> tuple[DoubleArray, DoubleArray]:
    """Centres of gravity; the strength of a region is its area."""
    regions, _ = cv2.MSER_create(MSER_DELTA_GRAY, MSER_MIN_AREA, MSER_MAX_AREA).detectRegions(gray)
    centres = np.array([region.mean(axis=0) for region in regions], np.float64).reshape(-1, 2)
    return centres, np.array([len(region) for region in regions], np.float64)


RESPONSES: dict[str, Response] = {'shi_tomasi': _shi_tomasi, 'harris': _harris}
DETECTORS: dict[str, Detector] = {'fast': _fast, 'orb': _orb, 'brisk': _brisk, 'mser': _mser}
KINDS = (*RESPONSES, *DETECTORS)


def _keypoints(found: tuple[cv2.KeyPoint, ...]) -> tuple[DoubleArray, DoubleArray]:
    """(N, 2) positions and (N,) strengths."""
    points = np.asarray(cv2.KeyPoint_convert(found), np.float64).reshape(-1, 2)
    return points, np.fromiter((keypoint.response for keypoint in found), np.float64, len(found))


def _allowed(shape: tuple[int, ...], mask: BoolArray | None) -> BoolArray:
    inside = (slice(BLOCK_PX, -BLOCK_PX),) * 2
    allowed = np.zeros(shape, np.bool_)
    allowed[inside] = True if mask is None else inner_scene(mask, MASKED_PX)[inside]
    return allowed


def _corners(
    respond: Response, gray: ByteArray, allowed: BoolArray, quality: float,
) -> tuple[DoubleArray, DoubleArray]:
    """Peaks of the response; of a wide image at half resolution, where a pixel of the block is two of the image."""
    height, width = (side // 2 * 2 for side in gray.shape)
    if width < HALVED_FROM_PX:
        return _peaks(respond(gray), allowed, quality, BLOCK_PX)
    small = cv2.resize(gray[:height, :width], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    points, strength = _peaks(respond(small), allowed[:height:2, :width:2], quality, BLOCK_PX // 2)
    return 2.0 * points + 0.5, strength


def _peaks(
    response: FloatArray, allowed: BoolArray, quality: float, reach: int,
) -> tuple[DoubleArray, DoubleArray]:
    """Local maxima, within ``reach`` pixels, of a response map over ``quality`` times the greatest."""
    np.multiply(response, allowed, out=response)
    side = 2 * reach + 1
    peak = response == cv2.dilate(response, np.ones((side, side), np.uint8))
    peak &= response > quality * float(response.max())
    found = np.flatnonzero(peak)
    ys, xs = np.divmod(found, response.shape[1])
    return np.column_stack([xs, ys]).astype(np.float64), response.ravel()[found].astype(np.float64)


def _inside(points: DoubleArray, strength: DoubleArray, allowed: BoolArray) -> tuple[DoubleArray, DoubleArray]:
    column, row = np.rint(points).astype(np.intp).T
    keep = allowed[row, column]
    return points[keep], strength[keep]


def _spread(points: DoubleArray, strength: DoubleArray, shape: tuple[int, ...], count: int) -> DoubleArray:
    """The same number of points from every cell, strongest first."""
    keep = np.full((ROWS * COLUMNS, max(1, count // (ROWS * COLUMNS))), -1, np.intp)
    _strongest(points, strength, shape[0], shape[1], keep)
    chosen: DoubleArray = points[keep[keep >= 0]]
    return chosen


@kernel()
def _strongest(points, strength, height, width, keep):  # type: ignore[no-untyped-def]
    """``keep``: (cells, most) of -1, then the indices of the strongest points of each cell, in their order."""
    most = keep.shape[1]
    for n in range(len(points)):
        cell = (int(points[n, 1]) * ROWS // height) * COLUMNS + int(points[n, 0]) * COLUMNS // width
        place = most
        while place > 0 and (keep[cell, place - 1] < 0 or strength[keep[cell, place - 1]] < strength[n]):
            if place < most:
                keep[cell, place] = keep[cell, place - 1]
            place -= 1
        if place < most:
            keep[cell, place] = n
