"""Where the next frame is expected, and what of it is believed: against known motions."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
import pytest
from warps import HEIGHT, WIDTH, about_centre, corner_error, view, world

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig
from motion_detect_ros.core.ego_motion import feature_based, point_tracking
from motion_detect_ros.core.ego_motion.expected_motion import ExpectedMotion
from motion_detect_ros.core.ego_motion.feature_based import IndirectMethod
from motion_detect_ros.core.ego_motion.point_tracking import Tracks
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.types import ByteArray, DoubleArray, PreparedFrame

PERIOD_NS = 40_000_000


def frame(gray: ByteArray, stamp_ns: int, scale: float = 1.0) -> PreparedFrame:
    return PreparedFrame(gray, scale, round(gray.shape[1] / scale), round(gray.shape[0] / scale), stamp_ns)


def tracks(error_gray: float = 3.0, failed: int = 0) -> Tracks:
    """Those that failed look like nothing."""
    good = np.arange(100) >= failed
    return Tracks(np.zeros((100, 2), np.float32), good, np.where(good, np.float32(error_gray), np.float32(90.0)))


def shift(dx: float, dy: float = 0.0) -> DoubleArray:
    return np.array([[1.0, 0.0, dx], [0.0, 1.0, dy], [0.0, 0.0, 1.0]])


class TestExpectedMotion:
    BLANK = np.zeros((48, 64), np.uint8)

    def after(self, motions: Sequence[DoubleArray], period_ns: int = PERIOD_NS) -> tuple[ExpectedMotion, PreparedFrame]:
        """What has seen the motions, and the last frame."""
        expected, last = ExpectedMotion(), frame(self.BLANK, 0)
        for index, motion in enumerate(motions):
            now = frame(self.BLANK, (index + 1) * period_ns)
            expected.saw(last, now, motion, tracks())
            last = now
        return expected, last

    def test_it_goes_on_as_it_went(self) -> None:
        expected, last = self.after([shift(3.0, -2.0)] * 2)
        for nanoseconds, share in ((PERIOD_NS, 1.0), (PERIOD_NS // 2, 0.5), (PERIOD_NS * 5 // 4, 1.25)):
            between = expected.between(last, frame(self.BLANK, last.stamp_ns + nanoseconds))
            np.testing.assert_allclose(between, shift(3.0 * share, -2.0 * share), atol=1e-9)

    @pytest.mark.parametrize('motions', [[], [shift(3.0)], [shift(3.0), shift(3.0), shift(5.0)]],
                             ids=['nothing', 'one motion', 'a jerk'])
    def test_nothing_is_expected_after(self, motions: list[DoubleArray]) -> None:
        expected, last = self.after(motions)
        assert expected.between(last, frame(self.BLANK, last.stamp_ns + PERIOD_NS)) is None

    def test_a_turn_shows_at_the_corners(self) -> None:
        turned = np.vstack([cv2.getRotationMatrix2D((32, 24), 3.0, 1.0), [0.0, 0.0, 1.0]])  # 2 px there
        expected, last = self.after([np.eye(3), np.eye(3), turned])
        assert expected.between(last, frame(self.BLANK, last.stamp_ns + PERIOD_NS)) is None

    @pytest.mark.parametrize(('scale', 'off_px', 'expected'), [
        (1.0, 1.4, True), (1.0, 1.6, False), (0.5, 2.8, True), (0.5, 3.2, False)])
    def test_a_small_jerk_of_the_working_picture_is_none(self, scale: float, off_px: float, expected: bool) -> None:
        motions, frames = ExpectedMotion(), [frame(self.BLANK, index * PERIOD_NS, scale) for index in range(5)]
        for (last, now), dx in zip(pairwise(frames[:4]), (3.0, 3.0, 3.0 + off_px), strict=True):
            motions.saw(last, now, shift(dx), tracks())
        assert (motions.between(frames[3], frames[4]) is not None) == expected

    def test_nothing_is_expected_from_another_frame_nor_over_a_long_time(self) -> None:
        expected, last = self.after([shift(3.0)] * 3)
        after = frame(self.BLANK, last.stamp_ns + PERIOD_NS)
        assert expected.between(frame(self.BLANK, last.stamp_ns), after) is None
        assert expected.between(last, frame(self.BLANK, last.stamp_ns + 59_000_000)) is not None
        assert expected.between(last, frame(self.BLANK, last.stamp_ns + 61_000_000)) is None
        expected, last = self.after([shift(3.0)] * 3, 2 * PERIOD_NS)
        assert expected.between(last, frame(self.BLANK, last.stamp_ns + 2 * PERIOD_NS)) is None

    @pytest.mark.parametrize(('now', 'confirmed'), [
        (tracks(), True), (tracks(failed=50), True), (tracks(failed=51), False), (tracks(error_gray=6.9), True),
        (tracks(error_gray=7.1), False)])
    def test_points_confirm_it_that_are_found_and_look_alike(self, now: Tracks, confirmed: bool) -> None:
        expected, _ = self.after([shift(3.0)] * 3)
        assert expected.confirmed_by(now) == confirmed


def flown(steps: Sequence[DoubleArray], pattern_px: int = 0) -> list[tuple[PreparedFrame, DoubleArray]]:
    """Frames of a ground, and the motion into each; with a pattern that repeats itself after so many pixels."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    at, frames = np.eye(3), []
    for index, step in enumerate(steps):
        at = step @ at
        picture = view(world(3), at)
        if pattern_px:
            back = np.linalg.inv(at)
            u, v = (2.0 * np.pi / pattern_px * (row[0] * x + row[1] * y + row[2]) for row in back[:2])
            picture = cv2.addWeighted(picture, 0.4, (128 + 50 * np.sin(u) * np.sin(v)).astype(np.uint8), 0.6, 0)
        frames.append((frame(picture, (index + 1) * PERIOD_NS), step))
    return frames


EVEN = [np.eye(3), *[about_centre(0.2, 1.002, 3.0, -1.0)] * 6]


@pytest.mark.parametrize('told', [False, True], ids=['as it was', 'by a gyroscope'])
def test_an_even_flight_needs_the_pyramid_at_its_start_only(told: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a gyroscope tells of the next motion is a first guess only, and goes before what the last one tells."""
    levels, track = list[int](), point_tracking.lucas_kanade

    def noted(one: ByteArray, other: ByteArray, points: object, start: object, options: dict[str, int]) -> object:
        levels.append(options['maxLevel'])
        return track(one, other, points, start, options)  # type: ignore[arg-type]

    monkeypatch.setattr(point_tracking, 'lucas_kanade', noted)
    method, frames = IndirectMethod(EgoMotionConfig()), flown(EVEN)
    for index, ((previous, _), (now, motion)) in enumerate(pairwise(frames)):
        levels.clear()
        fit = method.measure(previous, now, motion if told else None).fit
        assert fit is not None
        assert corner_error(feature_based.theta_matrix(fit.theta, feature_based.centre_of(now)), motion) < 0.1
        assert (max(levels) > 0) == (told or index < 2), index


@pytest.mark.parametrize('jump_px', [5.0, 9.0, 40.0])
@pytest.mark.parametrize('pattern_px', [0, 8, 16, 24])
def test_a_jump_out_of_an_even_flight_is_followed_at_once(jump_px: float, pattern_px: int) -> None:
    """Also over a ground that repeats itself, where all points are found at their neighbours."""
    steps = [*EVEN, about_centre(0.0, 1.0, jump_px, 0.0), *EVEN[1:3]]
    stage = EgoMotionStage(PipelineConfig(ego_motion=EgoMotionConfig(smoothing='none')))
    for index, (now, motion) in enumerate(flown(steps, pattern_px)):
        ego = stage.process(now)
        if index:
            assert ego.ok and corner_error(ego.matrix, motion) < 0.1, index
