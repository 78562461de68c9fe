"""Features to track: where they are found, how they are spread, how good an ego-motion they give."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from warps import about_centre, corner_error, estimate, view, world

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig
from motion_detect_ros.core.ego_motion.features import KINDS, MASKED_PX, AllowedPlaces, _spread, find_features
from motion_detect_ros.core.errors import BackendError, ConfigError
from motion_detect_ros.core.settings import with_settings

CORNER_KINDS = ('shi_tomasi', 'harris', 'fast', 'orb', 'brisk')


def find(kind: str, picture: np.ndarray, count: int = 480, quality: float = 1e-5, mask: np.ndarray | None = None):
    """Points of a kind; the test is skipped where this OpenCV has none."""
    try:
        return find_features(kind, picture, count, quality, mask)
    except BackendError as error:
        pytest.skip(str(error))


def camera_picture(drawn: np.ndarray, seed: int = 0) -> np.ndarray:
    """A drawing as a camera gives it: a little soft, a little noisy."""
    noise = np.random.default_rng(seed).normal(0.0, 1.5, drawn.shape)
    return np.clip(cv2.GaussianBlur(drawn.astype(np.float64), (0, 0), 0.7) + noise, 0, 255).round().astype(np.uint8)


def textured(seed: int = 1) -> np.ndarray:
    """(480, 640) texture everywhere."""
    return view(world(seed), np.eye(3))


def cells(points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """How many points each cell of the grid holds."""
    counts, *_ = np.histogram2d(points[:, 1], points[:, 0], (6, 8), ((0, shape[0]), (0, shape[1])))
    return counts


@pytest.mark.parametrize('kind', KINDS)
class TestEveryKind:
    def test_one_textured_corner_does_not_own_the_estimate(self, kind):
        picture = textured()
        random = np.random.default_rng(1)
        fine = random.integers(0, 255, (40, 50)).astype(np.uint8)
        picture[300:460, 420:620] = cv2.resize(fine, (200, 160), interpolation=cv2.INTER_CUBIC)
        counts = cells(find(kind, picture), picture.shape)
        assert counts.max() <= 10  # 480 points in 48 cells
        assert (counts > 0).mean() > 0.8

    def test_nothing_inside_a_mask_nor_at_its_edge(self, kind):
        picture, mask = textured(), np.ones((480, 640), np.bool_)
        picture[60:130, 100:200:3] = 255  # burnt-in text: the strongest structure of all
        mask[60:130, 100:200] = False
        points = find(kind, picture, mask=mask)
        assert len(points) > 50
        near = (np.abs(points - [149.5, 94.5]) <= np.array([50.5, 35.5]) + MASKED_PX - 1).all(axis=1)
        assert not near.any()

    def test_what_is_masked_does_not_set_the_scale_of_quality(self, kind):
        plain, mask = textured(), np.ones((480, 640), np.bool_)
        plain[:90] = 60
        mask[:90] = False
        text = plain.copy()
        text[:40, 0:640:4] = 255
        np.testing.assert_array_equal(
            find(kind, text, quality=0.2, mask=mask), find(kind, plain, quality=0.2, mask=mask))

    def test_a_textureless_picture_has_none(self, kind):
        points = find(kind, np.full((240, 320), 90, np.uint8))
        assert points.shape == (0, 2) and points.dtype == np.float32

    def test_ego_motion_from_them(self, kind):
        find(kind, np.zeros((64, 64), np.uint8))
        config = PipelineConfig(ego_motion=EgoMotionConfig(features=kind))
        true = about_centre(1.0, 1.01, 6.0, -4.0)
        errors = [corner_error(estimate(view(world(seed), np.eye(3)), view(world(seed), true), config).matrix, true)
                  for seed in range(5)]
        assert np.median(errors) < 0.1, errors


@pytest.mark.parametrize('kind', CORNER_KINDS)
def test_corners_of_drawn_rectangles(kind):
    drawn, corners = np.full((240, 320), 60, np.uint8), []
    for left, top, width, height in ((30, 30, 60, 50), (150, 40, 90, 40), (60, 130, 120, 70), (230, 140, 50, 60)):
        drawn[top:top + height, left:left + width] = 180
        corners += [(x, y) for x in (left, left + width - 1) for y in (top, top + height - 1)]
    points = find(kind, camera_picture(drawn), quality=0.1)
    distance = np.abs(points[:, None] - np.array(corners)[None]).max(axis=2)
    assert distance.min(axis=0).max() <= (2.0 if kind == 'brisk' else 1.0)  # pulled towards its half-size octave
    if kind in {'shi_tomasi', 'harris', 'fast'}:  # the others look at shrunken pictures too, where edges are ragged
        assert distance.min(axis=1).max() <= 1.0


def test_centres_of_drawn_spots():
    centres = np.array([(60, 50), (150, 100), (250, 60), (80, 180), (240, 190)])
    y, x = np.mgrid[:240, :320]
    hills = [np.exp(-((x - u) ** 2 + (y - v) ** 2) / 18.0) for u, v in centres]
    points = find('mser', np.round(60 + 100 * np.sum(hills, axis=0)).astype(np.uint8))
    distance = np.linalg.norm(points[:, None] - centres[None], axis=2)
    assert distance.min(axis=0).max() < 0.5 and distance.min(axis=1).max() < 0.5


def test_an_unknown_kind_is_refused():
    with pytest.raises(BackendError, match="expected one of shi_tomasi, harris, fast, orb, brisk, mser, got 'surf'"):
        find_features('surf', textured(), 100, 0.1)


def test_a_kind_that_this_opencv_lacks_says_what_to_install(monkeypatch):
    for name in ('BRISK_create', 'xfeatures2d'):
        monkeypatch.delattr(cv2, name, raising=False)
    with pytest.raises(BackendError, match='brisk.*install opencv-contrib-python-headless'):
        find_features('brisk', textured(), 100, 0.1)


@pytest.mark.parametrize('count', [48, 480, 10])
def test_the_strongest_of_each_cell_come_cell_by_cell_strongest_first(count: int) -> None:
    random = np.random.default_rng(count)
    points = random.uniform((0.0, 0.0), (640.0, 480.0), (900, 2))
    strength = random.integers(1, 40, 900).astype(float)  # of equal ones the first comes first
    expected = []
    for row in range(6):
        for column in range(8):
            inside = ((points // 80.0) == (column, row)).all(axis=1)
            mine = np.flatnonzero(inside)
            expected.extend(mine[np.argsort(-strength[mine], kind='stable')][:max(1, count // 48)])
    np.testing.assert_array_equal(_spread(points, strength, (480, 640), count), points[expected])


def test_places_are_those_of_the_mask_of_each_call():
    picture, places = textured(), AllowedPlaces()
    left, right = np.ones((480, 640), np.bool_), np.ones((480, 640), np.bool_)
    left[:, :320] = right[:, 320:] = False
    for mask in (left, left, right, None, left):
        np.testing.assert_array_equal(find_features('harris', picture, 480, 1e-5, mask, places),
                                      find_features('harris', picture, 480, 1e-5, mask))
    smaller = np.ascontiguousarray(picture[:240])
    np.testing.assert_array_equal(find_features('harris', smaller, 480, 1e-5, None, places),
                                  find_features('harris', smaller, 480, 1e-5, None))


def test_the_fewest_features_that_can_be_set_are_not_exceeded() -> None:
    """Every cell of the grid holds one: fewer cannot be had, so fewer cannot be asked for."""
    least = min(number for number in range(1, 100) if not refused(number))
    assert len(find('shi_tomasi', textured(), count=least)) == least


def refused(number: int) -> bool:
    """Whether the settings refuse so many features."""
    try:
        with_settings(PipelineConfig(), {'ego_motion.max_corners': number})
    except ConfigError:
        return True
    return False
