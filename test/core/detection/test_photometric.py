"""The photometric test, patches and motion of a region against the same in NumPy and OpenCV, written here."""

from __future__ import annotations

import math
import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest
from joined_patches import joined_patches

from motion_detect_ros.core.background.planar import Background
from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.detection import objects, prediction_errors
from motion_detect_ros.core.detection import segment_patches as segment_patches_module
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.enlarging import enlarge_row, find_columns
from motion_detect_ros.core.detection.image_pair import ImagePair, image_noise
from motion_detect_ros.core.detection.motion_field import MotionField
from motion_detect_ros.core.detection.objects import ObjectFinder
from motion_detect_ros.core.detection.patches import Patch
from motion_detect_ros.core.detection.photometric import (
    PhotometricTest,
    PhotometricTests,
    Place,
    photometric_tests,
    photometric_tests_apart,
    reach_px,
)
from motion_detect_ros.core.detection.photometric_kernels import row_means
from motion_detect_ros.core.detection.prediction_errors import PredictionErrors
from motion_detect_ros.core.detection.segment_patches import CellEdges, JoinLimits, segment_patches
from motion_detect_ros.core.detection.segments import Segment
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.threads import limited
from motion_detect_ros.core.tracking.track import MISS_LOG_ODDS

HEIGHT, WIDTH, ROWS, COLUMNS = 90, 130, 23, 33
MATRIX = np.array([[1.01, -0.02, 3.3], [0.02, 1.01, -2.6], [2e-5, -1e-5, 1.0]])
MOTION = np.float32([5.3, -2.7])
BOXES = [Box(0, 0, WIDTH, HEIGHT), Box(20, 11, 90, 63), Box(100, 60, WIDTH, HEIGHT), Box(5, 7, 6, 8), Box(0, 3, 1, 40)]


def smooth_noise(seed: int) -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(0.0, 1.0, (HEIGHT, WIDTH)), (0, 0), 1.5)
    return np.clip(128.0 + 60.0 * noise / noise.std(), 0, 255).astype(np.uint8)


@pytest.fixture
def pair() -> ImagePair:
    """An earlier picture, and the current one in which half of it moved with the camera, half by MOTION more."""
    earlier = smooth_noise(1)
    further = np.array([[1.0, 0.0, MOTION[0]], [0.0, 1.0, MOTION[1]], [0.0, 0.0, 1.0]])
    current = cv2.warpPerspective(earlier, MATRIX, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    moved = cv2.warpPerspective(earlier, further @ MATRIX, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    current[20:70, 30:100] = moved[20:70, 30:100]
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[:30, :50] = False
    return ImagePair(current, earlier, MATRIX, mask)


def bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    x, y = np.clip(x, 0, image.shape[1] - 1), np.clip(y, 0, image.shape[0] - 1)
    left, top = np.minimum(x.astype(int), image.shape[1] - 2), np.minimum(y.astype(int), image.shape[0] - 2)
    u, v = x - left, y - top
    return ((1 - v) * ((1 - u) * image[top, left] + u * image[top, left + 1])
            + v * ((1 - u) * image[top + 1, left] + u * image[top + 1, left + 1]))


def errors(pair: ImagePair, x: np.ndarray, y: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Current less earlier grey value, both rounded, of points that moved by ``motion`` on top of the camera's."""
    points = np.stack([x - motion[..., 0], y - motion[..., 1], np.ones_like(x)])
    before = np.tensordot(np.linalg.inv(pair.matrix), points, 1)
    return np.rint(bilinear(pair.current, x, y)) - np.rint(bilinear(pair.reference, *(before[:2] / before[2])))


def pixels(box: Box) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[box.top:box.bottom, box.left:box.right].astype(float)
    return x, y


def photometric_test(
    pair: ImagePair, places: list[Place], flow: np.ndarray, noise_gray: float, threshold: float, parts: int = 1,
) -> list[PhotometricTest]:
    """Of several places, before a background of this flow: (2,), or (gh, gw, 2) of a grid over the picture."""
    if flow.ndim == 1:
        return list(photometric_tests_apart(pair, [flow] * len(places), places, noise_gray, threshold))
    height, width = pair.current.shape
    background = PredictionErrors.near(pair, [each.region.grown(each.reach, width, height) for each in places], flow)
    return list(photometric_tests(pair, background, places, noise_gray, threshold, parts))


def field(random: np.random.Generator, unknown_share: float = 0.3) -> MotionField:
    residual, flow = random.normal(0.0, 4.0, (2, ROWS, COLUMNS, 2)).astype(np.float32)
    residual[random.random((ROWS, COLUMNS)) < unknown_share] = np.nan
    sigma = random.uniform(0.2, 2.0, (ROWS, COLUMNS)).astype(np.float32)
    return MotionField(residual, Background(flow, sigma), 0.08, 0.6)


@pytest.mark.parametrize('box', BOXES)
@pytest.mark.parametrize(('uniform', 'noise'), [(True, 3.0), (False, 3.0), (False, 9.0)])
def test_foreground_is_that_of_the_definition(pair: ImagePair, box: Box, uniform: bool, noise: float) -> None:
    """Gain over the threshold, and change where the pixel came from, wherever in the picture that is."""
    x, y = pixels(Box(0, 0, WIDTH, HEIGHT))
    background = np.zeros((HEIGHT, WIDTH, 2))
    if not uniform:
        background = np.stack([0.01 * (x - 50.0), 0.02 * (y - 40.0)], axis=-1)
    threshold = 3.0
    squares = [cv2.blur(errors(pair, x, y, motion) ** 2, (3, 3)) for motion in (background, MOTION.astype(float))]
    gain = np.where(squares[0] > (noise * threshold) ** 2, (squares[0] - squares[1]) / noise ** 2, 0.0)
    changed = cv2.dilate((squares[0] > (noise * threshold) ** 2).astype(np.uint8), np.ones((5, 5), np.uint8))
    from_x, from_y = (np.rint(each).astype(int) for each in np.moveaxis(
        np.stack([x, y], axis=-1) - (MOTION - background), -1, 0))
    inside = (from_x >= 0) & (from_x < WIDTH) & (from_y >= 0) & (from_y < HEIGHT)
    came = inside & (changed[np.where(inside, from_y, 0), np.where(inside, from_x, 0)] > 0)
    region = np.s_[box.top:box.bottom, box.left:box.right]
    foreground = ((gain > threshold ** 2) & came & pair.mask)[region]

    place = Place(box, reach_px(np.float32(MOTION) + 2.0), MOTION)
    flow = np.zeros(2, np.float32) if uniform else background.astype(np.float32)  # a cell a pixel
    found, = photometric_test(pair, [place], flow, noise, threshold)
    assert found.foreground.shape == (box.height, box.width) and found.gain.dtype == np.float32
    assert (np.abs(found.gain - gain[region]) > 0.05).mean() < 0.03  # grey values half-way are rounded up or down
    assert np.count_nonzero(found.foreground != foreground) <= 0.002 * foreground.size
    assert box.area < 2000 or np.count_nonzero(foreground) > 200


@pytest.mark.parametrize(('height', 'width'), [(1, 1), (1, 40), (40, 1), (2, 2)])
def test_every_motion_of_a_plain_picture_explains_it(height: int, width: int) -> None:
    """Origins are far beyond the border, or no numbers, in pictures without a pixel beside another one."""
    picture, all_of_it = np.full((height, width), 77, np.uint8), Box(0, 0, width, height)
    for background in (np.zeros(2, np.float32), np.full((height, width, 2), 1e9, np.float32),
                       np.full(2, np.nan, np.float32), np.full((height, width, 2), -0.5, np.float32)):
        found, = photometric_test(
            ImagePair(picture, picture, np.eye(3)), [Place(all_of_it, 0, MOTION)], background, 2.0, 3.0)
        assert not found.gain.any() and not found.foreground.any()


def squares(now: Box, step: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Pictures of a square that went ``step`` to where it is."""
    ground, thing, pictures = smooth_noise(3), smooth_noise(4)[:20, :20], []
    for box in (now.moved(-step[0], -step[1]), now):
        picture = ground.copy()
        picture[box.top:box.bottom, box.left:box.right] = thing
        pictures.append(picture)
    return pictures[0], pictures[1]


def of_square(
    now: Box, step: tuple[int, int], sigma_px: float = 1.0, beyond: int = 0, still: float = 0.0,
) -> list[Candidate]:
    """What is found of a square that has moved by a step. sigma_px: deviation of the flow; beyond: so many cells around
    the square have its flow too; still: flow of the others, NaN = unknown.
    """
    pictures = squares(now, step)
    residual = np.full((HEIGHT // 5, WIDTH // 5, 2), still, np.float32)
    residual[now.top // 5 - beyond:now.bottom // 5 + beyond, now.left // 5 - beyond:now.right // 5 + beyond] = step
    rows, columns = np.nonzero((residual == step).all(axis=2))
    segment = Segment(rows, columns, 1, Box(columns.min(), rows.min(), columns.max() + 1, rows.max() + 1))
    sigma = np.full(residual.shape[:2], sigma_px, np.float32)
    field_of_it = MotionField(residual, Background(np.zeros_like(residual), sigma), 0.04, 1.0)
    pair = ImagePair(pictures[1], pictures[0], np.eye(3))
    return ObjectFinder(ObjectsConfig()).find([segment], field_of_it, pair, np.arange(2, dtype=np.uint32), 0)


@pytest.mark.parametrize('step', [(6, 0), (16, 0), (-16, 0), (0, 30), (-21, 21)])
def test_every_pixel_of_a_fast_square_is_foreground(step: tuple[int, int]) -> None:
    """A square of 20 px that moves up to one and a half times its size between the frames; its flow is known."""
    now = Box(55, 35, 75, 55).moved(*step)
    found, = of_square(now, step)
    np.testing.assert_allclose(found.centre, [(now.left + now.right) / 2, (now.top + now.bottom) / 2], atol=1.5)
    np.testing.assert_allclose(found.size, 20.0, atol=4.5)  # averaging and closing add to a small box
    assert found.area > 0.7 * 400  # the weakest of the gain are taken for shadow


def test_what_says_less_than_a_miss_is_no_candidate() -> None:
    """Where hardly any flow is known around a square, and the more it deviates: by the same for each doubling."""
    found = [of_square(Box(61, 35, 81, 55), (6, 0), 0.1 * 2.0 ** doublings, 1, math.nan) for doublings in range(9)]
    odds = [each.log_odds for candidates in found for each in candidates]
    steps = np.diff(odds)
    assert 2 <= len(odds) < len(found)
    assert not any(found[len(odds):])
    np.testing.assert_allclose(steps, steps[0], rtol=1e-3)
    assert odds[-1] >= MISS_LOG_ODDS > odds[-1] + steps[0]


def test_segments_are_the_same_by_two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of all parts of a moving square."""
    step, now = (6, 3), Box(55, 35, 75, 55)
    earlier, current = squares(now, step)
    residual = np.zeros((HEIGHT // 5, WIDTH // 5, 2), np.float32)
    residual[now.top // 5:now.bottom // 5, now.left // 5:now.right // 5] = step
    cells = np.argwhere(residual.any(axis=2))
    segments = [Segment(cells[:count, 0].copy(), cells[:count, 1].copy(), 1, Box(
        cells[:count, 1].min(), cells[0, 0], cells[:count, 1].max() + 1, cells[count - 1, 0] + 1))
        for count in range(3, len(cells) + 1)]
    sigma = np.ones(residual.shape[:2], np.float32)
    grid = MotionField(residual, Background(np.zeros_like(residual), sigma), 0.04, 1.0)
    found, where, connect = {}, set(), segment_patches_module.connected_pixels

    def noted(*given):
        if threading.current_thread() not in where:
            where.add(threading.current_thread())
            begun.wait()  # a thread that is late would find its part done
        return connect(*given)

    monkeypatch.setattr(objects, 'LEAST_SEGMENTS', 2)
    monkeypatch.setattr(segment_patches_module, 'connected_pixels', noted)
    for count in (1, 2):
        begun = threading.Barrier(count, timeout=60.0)
        where.clear()
        with limited(count):
            found[count] = [repr(each) for each in ObjectFinder(ObjectsConfig()).find(
                segments, grid, ImagePair(current, earlier, np.eye(3)), np.arange(2, dtype=np.uint32), 0)]
        assert len(where) == count
    assert len(found[1]) == len(segments)
    assert found[1] == found[2]


def test_image_noise_is_the_median_error(pair: ImagePair) -> None:
    x, y = np.meshgrid(np.arange(2.3, WIDTH, 4.0), np.arange(1.6, HEIGHT, 4.0))
    still = np.stack([0.4 + 0.0 * x, 0.01 * y], axis=-1)
    expected = 1.4826 * np.median(np.abs(errors(pair, x, y, still)))
    assert expected > 3.0
    points = np.stack([x, y], axis=-1).astype(np.float32)
    assert image_noise(pair, points, still.astype(np.float32)) == pytest.approx(expected)


def test_pictures_that_cannot_be_written_to_are_taken_too(pair: ImagePair) -> None:
    places, still = [Place(BOXES[1], 0, MOTION)], np.zeros(2, np.float32)
    expected, = photometric_test(pair, places, still, 3.0, 3.0)
    for picture in (pair.current, pair.reference):
        picture.flags.writeable = False
    found, = photometric_test(
        ImagePair(pair.current, pair.reference, pair.matrix, pair.mask), places, still, 3.0, 3.0)
    assert expected.foreground.any()
    np.testing.assert_array_equal(found.foreground, expected.foreground)


@pytest.mark.parametrize('unknown', [0.0, 0.3, 1.0])
def test_motion_in_a_window_is_that_of_numpy(unknown: float) -> None:
    random = np.random.default_rng(5)
    grid = field(random, unknown)
    windows = np.array([(0, ROWS, 0, COLUMNS), (3, 9, 4, 21), (7, 8, 30, 33), (22, 23, 0, 1)])
    for (top, bottom, left, right), motion, sigmas, known in zip(
            windows, *grid.object_motions(windows), strict=True):
        window = np.s_[top:bottom, left:right]
        own = (grid.residual - grid.background.flow)[window].reshape(-1, 2)
        own = own[np.isfinite(own[:, 0])]
        assert known == pytest.approx(len(own) / ((bottom - top) * (right - left)))
        if not len(own):
            assert (motion.tolist(), sigmas) == ([0.0, 0.0], 0.0)
            continue
        length = np.hypot(*own.T)
        expected = np.median(own[length >= np.median(length)], axis=0)
        np.testing.assert_allclose(motion, expected, rtol=1e-5)
        noise = np.median(grid.background.sigma_px[window][np.isfinite(grid.residual[window][..., 0])])
        assert sigmas == pytest.approx(float(np.hypot(*expected) / noise), rel=1e-5)


@pytest.mark.parametrize('box', BOXES)
def test_rows_of_a_grid_are_those_of_opencv(box: Box) -> None:
    grid = np.random.default_rng(6).normal(0.0, 4.0, (ROWS, COLUMNS, 2)).astype(np.float32)
    expected = bilinear_grid(grid)[box.top:box.bottom, box.left:box.right]
    west, share = np.empty(box.width, np.uint32), np.empty(box.width, np.float32)
    find_columns(box.left, COLUMNS, WIDTH, box.width, west, share)
    for rows in (range(box.height), range(0, box.height, 7), range(box.height - 1, -1, -3)):  # however far apart
        above, lines, line = -1, np.empty((4, box.width), np.float32), np.empty((2, box.width), np.float32)
        for row in rows:
            above = enlarge_row(grid, box.top + row, HEIGHT, box.width, west, share, above, lines, line)
            np.testing.assert_allclose(line.T, expected[row], atol=1e-4)


def bilinear_grid(grid: np.ndarray) -> np.ndarray:
    """(HEIGHT, WIDTH, 2) of cells, whose outermost are replicated beyond their centres."""
    x, y = np.meshgrid((np.arange(WIDTH) + 0.5) * COLUMNS / WIDTH - 0.5,
                       (np.arange(HEIGHT) + 0.5) * ROWS / HEIGHT - 0.5)
    return np.stack([bilinear(grid[..., axis], x, y) for axis in (0, 1)], axis=-1)


@pytest.mark.parametrize('threads', [1, 2])
def test_errors_near_boxes_are_those_of_the_definition(
    pair: ImagePair, threads: int, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a picture of several tiles, in and beside the boxes, by one thread or two."""
    monkeypatch.setattr(prediction_errors, 'TILE_PX', 8)
    monkeypatch.setattr(prediction_errors, 'LEAST_TILES', 4)
    grid = np.random.default_rng(6).normal(0.0, 3.0, (ROWS, COLUMNS, 2)).astype(np.float32)
    with limited(threads):
        found = PredictionErrors.near(pair, BOXES[1:], grid)
    x, y = pixels(Box(0, 0, WIDTH, HEIGHT))
    expected = errors(pair, x, y, bilinear_grid(grid)) ** 2
    for box in (each.grown(1, WIDTH, HEIGHT) for each in BOXES[1:]):
        inside = np.s_[box.top:box.bottom, box.left:box.right]
        off = np.abs(np.sqrt(found.values[inside].astype(float)) - np.sqrt(expected[inside]))
        assert off.max() <= 1.0 and (off > 0.0).mean() < 0.02  # grey values half-way are rounded up or down


def test_each_region_is_tested_before_a_background_of_its_own(pair: ImagePair) -> None:
    """Each as alone, also where they overlap; of one of them a row is masked."""
    mask = pair.mask.copy()
    mask[BOXES[1].top + 2] = False
    masked = replace(pair, mask=mask)
    places = [Place(box, 4, MOTION) for box in (*BOXES, BOXES[1])]
    flows = list(np.random.default_rng(8).normal(0.0, 1.5, (len(places), 2)).astype(np.float32))
    together = list(photometric_tests_apart(masked, flows, places, 3.0, 3.0))
    for found, place, flow in zip(together, places, flows, strict=True):
        expected, = photometric_tests_apart(pair, [flow], [place], 3.0, 3.0)
        np.testing.assert_array_equal(found.gain, expected.gain)
        region = place.region
        np.testing.assert_array_equal(
            found.foreground, expected.foreground & mask[region.top:region.bottom, region.left:region.right])
    assert sum(found.foreground.any() for found in together) > len(BOXES) // 2
    assert (together[1].foreground != together[-1].foreground).any()


@pytest.mark.parametrize(('rows', 'columns'), [(1, 1), (1, 7), (7, 1), (2, 2), (9, 14)])
def test_mean_errors_are_those_of_opencv(rows: int, columns: int) -> None:
    """Whole rows and parts of them; beyond the border the pixels within are mirrored."""
    values = np.random.default_rng(3).integers(0, 255 ** 2 + 1, (rows, columns)).astype(np.uint16)
    expected = cv2.blur(values.astype(np.float64), (3, 3), borderType=cv2.BORDER_REFLECT_101)
    part = columns // 3, max(columns // 3 + 1, columns - 2)
    for begin, end in [(0, columns), (0, 1), (columns - 1, columns), part]:
        for row in range(rows):
            means = np.empty(end - begin, np.float32)
            row_means(values, row, begin, np.empty(columns + 2, np.int32), means)
            np.testing.assert_allclose(means, expected[row, begin:end], rtol=1e-6)


def test_regions_together_are_as_each_by_itself(pair: ImagePair) -> None:
    """Of different sizes, reaches and motions, by one thread and by two."""
    places = [Place(box, reach, np.float32(motion)) for box, reach, motion in zip(
        BOXES, (0, 12, 3, 40, 9), ((5.3, -2.7), (5.0, -3.0), (-4.0, 0.5), (0.0, 0.0), (5.3, -2.7)), strict=True)]
    grid = np.random.default_rng(6).normal(0.0, 0.4, (ROWS, COLUMNS, 2)).astype(np.float32)
    alone = [photometric_test(pair, [place], grid, 3.0, 3.0)[0] for place in places]
    assert sum(each.foreground.any() for each in alone) >= 2
    for parts in (1, 2):
        with limited(parts):
            together = photometric_test(pair, places, grid, 3.0, 3.0, parts)
        for one, other in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one.foreground, other.foreground)
            np.testing.assert_array_equal(one.gain, other.gain)


def test_what_a_pixel_is_does_not_depend_on_the_region_around_it(pair: ImagePair) -> None:
    """Nor do changes near its origin, of which a part lies beyond all origins of a region of one pixel."""
    grid = np.random.default_rng(6).normal(0.0, 0.4, (ROWS, COLUMNS, 2)).astype(np.float32)
    region, reach = Box(15, 12, 115, 78), reach_px(MOTION + 2.0)
    whole, = photometric_test(pair, [Place(region, reach, MOTION)], grid, 3.0, 3.0)
    rows, columns = np.mgrid[region.top:region.bottom:3, region.left:region.right:3].reshape(2, -1)
    places = [Place(Box(column, row, column + 1, row + 1), reach, MOTION)
              for row, column in zip(rows.tolist(), columns.tolist(), strict=True)]
    alone = np.array([each.foreground[0, 0] for each in photometric_test(pair, places, grid, 3.0, 3.0)])
    assert 100 < alone.sum() < len(alone) - 100
    np.testing.assert_array_equal(alone, whole.foreground[rows - region.top, columns - region.left])


def test_motions_of_segments_are_the_medians_of_their_cells() -> None:
    grid = field(np.random.default_rng(7))
    rows, columns = np.nonzero(np.isfinite(grid.residual[..., 0]))
    counts = (1, 200, 2, 9)
    found = grid.motions_of([Segment(rows[:count], columns[:count], 1, Box(0, 0, COLUMNS, ROWS)) for count in counts])
    for count, motions in zip(counts, found, strict=True):
        cells = np.s_[rows[:count], columns[:count]]
        for motion, of in zip(motions, (grid.residual, grid.residual - grid.background.flow), strict=True):
            np.testing.assert_allclose(motion, 0.6 * np.median(of[cells], axis=0), rtol=1e-5)


def test_patches_are_the_strong_pixels_of_what_touches_the_segment() -> None:
    random, config = np.random.default_rng(8), ObjectsConfig()
    mask = cv2.GaussianBlur(random.normal(0.0, 1.0, (120, 160)), (0, 0), 3.0) > 0.06
    gain = random.exponential(20.0, mask.shape).astype(np.float32)
    inside = np.zeros(mask.shape, bool)
    inside[40:, 30:90] = True
    rows, columns = np.nonzero(inside[::10, ::10])  # the region lies at (20, 50) in a picture of 300 x 200, cells of 10
    segment = Segment(rows + 5, columns + 2, 1, Box(5, 9, 11, 17))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (config.closing_px, config.closing_px))
    _, labels = cv2.connectedComponents(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, kernel))
    expected, refused = [], 0
    for number in range(1, labels.max() + 1):
        pixels = mask & (labels == number)
        strong = pixels & (gain > config.peak_share * np.percentile(gain[pixels], 90.0))
        if not (pixels & inside).any() or pixels.sum() < 8 or strong.sum() < 8:
            refused += 1
            continue
        y, x = np.nonzero(strong)
        expected.append(Patch(Box(x.min(), y.min(), x.max() + 1, y.max() + 1), len(x)))
    assert len(expected) >= 3 and refused >= 2
    tests = PhotometricTests(np.array([[20, 50, 180, 170]] * 2), np.array([0, mask.size, 2 * mask.size]),
                             np.tile(mask.ravel(), 2), np.tile(gain.ravel(), 2))
    elsewhere = Segment(rows + 5, columns + 8, 1, Box(11, 9, 17, 17))
    edges = CellEdges.of((20, 30), (200, 300))
    for first, second in ((segment, elsewhere), (elsewhere, segment)):
        found = segment_patches(tests, [first, second], edges, config, JoinLimits(), parts=2)
        wanted, other = found if first is segment else reversed(found)
        assert wanted == joined_patches(expected) != other
