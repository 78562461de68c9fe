"""Features are found in every second frame, behind its answer; they go on into the next one, and never into others."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion import feature_based
from motion_detect_ros.core.ego_motion.feature_based import IndirectMethod
from motion_detect_ros.core.threads import limited
from motion_detect_ros.core.types import PreparedFrame

PERIOD_NS = 40_000_000


def pan(index: int, period_ns: int = PERIOD_NS, mask: np.ndarray | None = None) -> PreparedFrame:
    """The picture moves 3 px to the left in each frame."""
    noise = np.random.default_rng(5).normal(size=(200, 500))
    ground = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.5), None, 20, 235, cv2.NORM_MINMAX).astype(np.uint8)
    gray = np.ascontiguousarray(ground[:, 3 * index:3 * index + 300])
    return PreparedFrame(gray, 1.0, 300, 200, (index + 1) * period_ns, mask)


def looked_at(monkeypatch: pytest.MonkeyPatch, frames: list[PreparedFrame]) -> list[int]:
    """Numbers of the frames in which features were found, as they are."""
    numbers, find = list[int](), feature_based.find_features

    def noted(kind: str, gray: np.ndarray, *rest: object) -> np.ndarray:
        numbers.append(next(index for index, frame in enumerate(frames) if frame.gray is gray))
        return find(kind, gray, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(feature_based, 'find_features', noted)
    return numbers


@pytest.mark.parametrize(('period_ns', 'expected'), [
    (PERIOD_NS, [0, 1, 3, 4, 6]), (2 * PERIOD_NS, [0, 1, 2, 3, 4, 5, 6, 7])], ids=['25 Hz', '12.5 Hz'])
@pytest.mark.parametrize('threads', [1, 2])
def test_features_are_found_in_every_second_frame_and_again_where_frames_were_left_out(
    monkeypatch: pytest.MonkeyPatch, period_ns: int, expected: list[int], threads: int,
) -> None:
    frames = [pan(index, period_ns) for index in range(8)]
    method, found_in = IndirectMethod(EgoMotionConfig()), looked_at(monkeypatch, frames)
    shifts = []
    for earlier, later in [(0, 1), (1, 2), (2, 3), (4, 5), (5, 6), (6, 7)]:
        measured = method.measure(frames[earlier], frames[later])
        assert measured.fit is not None
        shifts.append(measured.fit.theta[0])
        with limited(threads):
            method.look_ahead(frames[later])
    method.wait()
    assert found_in == [number for number in expected if threads == 2 or number not in (3, 7)]
    assert shifts == pytest.approx([-3.0] * 6, abs=0.05)


def test_none_go_on_into_the_mask_and_new_ones_are_found_where_too_few_do(monkeypatch: pytest.MonkeyPatch) -> None:
    masks = [np.ones((200, 300), np.bool_) for _ in range(3)]
    masks[0][:, 290:], masks[1][:, 150:] = False, False
    for mask, found in zip(masks, ([0, 1], [0, 1, 2], [0, 1]), strict=True):
        frames = [pan(0), pan(1), pan(2, mask=mask), pan(3)]
        method, found_in = IndirectMethod(EgoMotionConfig()), looked_at(monkeypatch, frames)
        ways = [method.measure(*pair) for pair in pairwise(frames)]
        assert found_in == found
        assert (ways[2].earlier[:, 0] > 285).any() == bool(mask[:, 286:].all())
        monkeypatch.undo()


def test_few_are_lost_from_frame_to_frame_and_still_new_ones_are_found_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 100 Hz features would go on for six frames; in each of these a tenth of the picture is covered."""
    masks = [np.ones((200, 300), np.bool_) for _ in range(5)]
    for index, mask in enumerate(masks):
        mask[:, 300 - 32 * index:] = False
    frames = [pan(index, 10_000_000, mask) for index, mask in enumerate(masks)]
    method, found_in = IndirectMethod(EgoMotionConfig()), looked_at(monkeypatch, frames)
    for pair in pairwise(frames):
        assert method.measure(*pair).fit is not None
    assert found_in == [0, 1, 3]


def test_features_are_found_by_the_next_frame_where_none_was_looked_ahead_for():
    method = IndirectMethod(EgoMotionConfig())
    shifts = [method.measure(pan(index), pan(index + 1)).fit.theta[0] for index in range(3)]
    assert shifts == pytest.approx([-3.0] * 3, abs=0.05)
