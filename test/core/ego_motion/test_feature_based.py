"""Features are found once for each frame, behind the answer to it, and never those of another frame are tracked."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion import feature_based
from motion_detect_ros.core.ego_motion.feature_based import IndirectMethod
from motion_detect_ros.core.threads import limited
from motion_detect_ros.core.types import PreparedFrame

PERIOD_NS = 40_000_000


def pan(index: int) -> PreparedFrame:
    """The picture moves 3 px to the left in each frame."""
    noise = np.random.default_rng(5).normal(size=(200, 500))
    ground = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.5), None, 20, 235, cv2.NORM_MINMAX).astype(np.uint8)
    gray = np.ascontiguousarray(ground[:, 3 * index:3 * index + 300])
    return PreparedFrame(gray, 1.0, 300, 200, (index + 1) * PERIOD_NS)


def test_features_are_found_once_a_frame_and_again_where_frames_were_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    frames, looked_at = [pan(index) for index in range(6)], list[int]()
    method, find = IndirectMethod(EgoMotionConfig()), feature_based.find_features

    def noted(kind: str, gray: np.ndarray, *rest: object) -> np.ndarray:
        looked_at.append(next(index for index, frame in enumerate(frames) if frame.gray is gray))
        return find(kind, gray, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(feature_based, 'find_features', noted)
    shifts = []
    for earlier, later in [(0, 1), (1, 2), (2, 3), (4, 5)]:
        measured = method.measure(frames[earlier], frames[later])
        assert measured.fit is not None
        shifts.append(measured.fit.theta[0])
        with limited(2):
            method.look_ahead(frames[later])
    method.wait()
    assert looked_at == [0, 1, 2, 3, 4, 5]
    assert shifts == pytest.approx([-3.0] * 4, abs=0.05)


def test_features_are_found_by_the_next_frame_where_none_was_looked_ahead_for():
    method = IndirectMethod(EgoMotionConfig())
    shifts = [method.measure(pan(index), pan(index + 1)).fit.theta[0] for index in range(3)]
    assert shifts == pytest.approx([-3.0] * 3, abs=0.05)
