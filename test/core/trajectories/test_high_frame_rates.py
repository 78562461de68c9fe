"""Points of cameras with more frames a second than are kept: they still reach back over a second."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from point_objects import PointObjects

from motion_detect_ros.core.trajectories.points import Points, PointTracker
from motion_detect_ros.core.trajectories.recent_frames import MAX_FRAMES, RecentFrames
from motion_detect_ros.core.types import NANOSECONDS, CameraModel, EgoMotion, EgoStatus, PreparedFrame
from motion_detect_ros.presets import load_preset

WIDTH, HEIGHT = 320, 200
#: Of the ground, pixels a second; of a square against it, and its side.
PAN, OWN, SIDE = np.array([-30.0, -10.0]), np.array([20.0, 0.0]), 14


def texture(seed: int, height: int, width: int, sigma: float) -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(height, width)), (0, 0), sigma)
    return cv2.normalize(noise, None, 20, 235, cv2.NORM_MINMAX).astype(np.uint8)


GROUND, THING = texture(1, HEIGHT + 100, WIDTH + 140, 1.5), texture(2, SIDE, SIDE, 1.0)


def shifted(picture: np.ndarray, way: np.ndarray) -> np.ndarray:
    matrix = np.array([[1.0, 0.0, way[0]], [0.0, 1.0, way[1]]])
    return cv2.warpAffine(picture, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)


def square(seconds: float) -> np.ndarray:
    """(2,) its upper left corner."""
    return np.array([200.0, 120.0]) + seconds * (PAN + OWN)


def picture(seconds: float) -> np.ndarray:
    cover = shifted(np.full(THING.shape, 255, np.uint8), square(seconds)) / 255.0
    ground = shifted(GROUND, np.array([-20.0, -20.0]) + seconds * PAN)
    return np.rint(cover * shifted(THING, square(seconds)) + (1.0 - cover) * ground).astype(np.uint8)


def stamp_ns(index: int, hz: float) -> int:
    return NANOSECONDS + round(index * NANOSECONDS / hz)


def ego(index: int, hz: float) -> EgoMotion:
    matrix = np.eye(3)
    matrix[:2, 2] = PAN / hz
    return EgoMotion(matrix, np.eye(6), EgoStatus.OK if index else EgoStatus.FIRST_FRAME, stamp_ns(index, hz),
                     stamp_ns(index - 1, hz))


def prepared(gray: np.ndarray, index: int, hz: float) -> PreparedFrame:
    return PreparedFrame(gray, 1.0, WIDTH, HEIGHT, stamp_ns(index, hz))


@pytest.mark.parametrize('hz', [25.0, 30.0, 50.0, 60.0, 120.0, 240.0])
def test_frames_of_a_second_are_kept_at_any_rate(hz: float) -> None:
    frames, gray = RecentFrames(), np.zeros((HEIGHT, WIDTH), np.uint8)
    for index in range(round(3 * hz)):
        frames.add(prepared(gray, index, hz), ego(index, hz))
        seconds = np.array([frames.seconds(ago) for ago in range(len(frames))])
        assert seconds[-1] == pytest.approx(min(index / hz, 1.0), abs=0.06)
        assert np.diff(seconds).max(initial=0.0) < 0.06
        assert seconds[:2] == pytest.approx([0.0, 1.0 / hz][:len(seconds)])
        ways = [frames[ago].matrix[:2, 2] for ago in range(len(frames))]
        np.testing.assert_allclose(ways, seconds[:, None] * PAN, atol=1e-6)
    assert len(frames) <= MAX_FRAMES


def test_paths_are_where_points_were_in_the_frames_that_are_kept() -> None:
    hz, frames, tracker, points = 100.0, RecentFrames(), PointTracker(600), Points()
    for index in range(round(1.5 * hz)):
        frames.add(prepared(shifted(GROUND, np.array([-20.0, -20.0]) + index / hz * PAN), index, hz), ego(index, hz))
        tracker.track(frames, None)
        points = tracker.start(frames, None)
    for ago in range(1, len(frames)):
        old = points.age >= ago
        way = points.now[old] - points.path[old, ago]
        assert np.median(np.abs(way - frames.seconds(ago) * PAN)) < 0.1
        assert np.isnan(points.path[~old, ago]).all()
    assert (points.age == len(frames) - 1).sum() > 50
    assert ((points.age > 5) & (points.age < len(frames) - 5)).any(), 'some have started in between'


@pytest.mark.parametrize('hz', [60.0, 200.0])
def test_a_small_slow_square_is_found(hz: float) -> None:
    finder, found = PointObjects(load_preset('visdrone')), []
    for index in range(round(1.8 * hz)):
        candidates = finder.candidates(prepared(picture(index / hz), index, hz), ego(index, hz),
                                       CameraModel.guessed(WIDTH, HEIGHT, 1.0))
        centre = square(index / hz) + SIDE / 2
        found.append(any((np.abs(each.centre - centre) < SIDE / 2).all() for each in candidates))
    finder.wait()
    assert np.mean(found[round(1.2 * hz):]) > 0.8
