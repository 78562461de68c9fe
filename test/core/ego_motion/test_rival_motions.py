"""A road full of vehicles with more texture than the ground: the ground is what most of the picture shows."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest
from traffic import traffic
from warps import HEIGHT, PERIOD_NS, about_centre, corner_error, view, world

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.ego_motion import rival_motions
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import EgoMotion

PICTURES = 6


def seen(speed_m_s: float) -> list[np.ndarray]:
    return [frame.image for frame in traffic(speed_m_s, PICTURES)]


def motions(pictures: list[np.ndarray]) -> list[EgoMotion]:
    config = PipelineConfig()
    stage, prepare = EgoMotionStage(config), Preprocessor(config.preprocessing)
    return [stage.process(prepare.process(each, (index + 1) * PERIOD_NS)) for index, each in enumerate(pictures)]


@pytest.mark.parametrize('speed_m_s', [4.0, 8.0])
def test_the_ground_is_what_most_of_the_picture_shows(speed_m_s: float) -> None:
    """Vehicles go by 3 and 7 pixels a frame."""
    assert [corner_error(ego.matrix, np.eye(3)) for ego in motions(seen(speed_m_s))[1:]] == [
        pytest.approx(0.0, abs=0.5)] * (PICTURES - 1)


@pytest.mark.parametrize('speed_m_s', [4.0, 8.0])
@pytest.mark.parametrize('degrees', [2.0, 4.0])
def test_so_it_is_while_the_camera_turns(degrees: float, speed_m_s: float) -> None:
    """Turns of over 5 % are tracked a second time and fitted anew, where the first fit's rival has none.

    Seen in the middle of the pictures, 400 x 600 pixels.
    """
    pictures = []
    for index, picture in enumerate(seen(speed_m_s)):
        (height, width), turn = picture.shape[:2], degrees * (index - 2.5)
        about = cv2.getRotationMatrix2D((width / 2.0, height / 2.0), turn, 1.0)
        whole = cv2.warpAffine(picture, about, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        pictures.append(whole[70:470, 180:780])
    true = np.vstack([cv2.getRotationMatrix2D((300.0, 200.0), degrees, 1.0), [0.0, 0.0, 1.0]])
    assert [corner_error(ego.matrix, true) for ego in motions(pictures)[1:]] == [
        pytest.approx(0.0, abs=0.5)] * (PICTURES - 1)


def test_where_there_was_no_rival_none_is_looked_for_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three strips of like texture and size that go their own ways, for 0.8 s."""
    looked, rivals = list[int](), rival_motions._rivals
    monkeypatch.setattr(rival_motions, '_rivals', lambda *each: (looked.append(1), rivals(*each))[1])
    ways, strips = [(world(3), -4), (world(4), 6), (world(5), 1)], np.linspace(0, HEIGHT, 4).astype(int)
    pictures = []
    for index in range(20):
        views = [view(scene, about_centre(0.0, 1.0, way * index, 0.0)) for scene, way in ways]
        pictures.append(np.vstack([each[low:high] for each, (low, high) in zip(views, pairwise(strips), strict=True)]))
    assert all(ego.ok for ego in motions(pictures)[1:])
    assert len(looked) == 2
