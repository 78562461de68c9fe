"""From flow to candidates: fragments, and how well the flow around an object is known."""

from __future__ import annotations

import numpy as np
import pytest
from street import CAMERA, box_cells, flow, motion, street_depth

from motion_detect_ros.core.background.planar import Background
from motion_detect_ros.core.background.static_points import fit_static_scene
from motion_detect_ros.core.config import BackgroundConfig, PipelineConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.detector import MotionDetector, without_fragments
from motion_detect_ros.core.detection.motion_field import MotionField
from motion_detect_ros.core.detection.objects import ObjectFinder
from motion_detect_ros.core.geometry.frame_history import ReferenceFrame
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import FlowField, PreparedFrame


def candidate(x: float, y: float, width: float, height: float, vx: float = 50.0, vy: float = 0.0) -> Candidate:
    return Candidate(np.array([x, y]), np.array([width, height]), np.array([vx, vy]), width * height, 1.0, 0)


CAR = candidate(100.0, 100.0, 80.0, 40.0)


@pytest.mark.parametrize(('other', 'kept'), [
    (candidate(150.0, 110.0, 18.0, 10.0), False),  # a shadow behind the car
    (candidate(150.0, 110.0, 18.0, 10.0, vx=15.0), True),  # a person who walks beside it
    (candidate(150.0, 110.0, 18.0, 10.0, vx=-50.0), True),
    (candidate(170.0, 110.0, 18.0, 10.0), True),  # 21 px away from it
    (candidate(160.0, 100.0, 40.0, 30.0), True),  # another car: 1200 of 3200 square pixels
])
def test_fragments_move_with_a_larger_object_beside_them(other, kept):
    for both in ([CAR, other], [other, CAR]):
        found = without_fragments(both)
        assert any(one is CAR for one in found)
        assert any(one is other for one in found) is kept


def test_alone_nothing_is_a_fragment():
    assert without_fragments([]) == []
    assert without_fragments([CAR]) == [CAR]


def test_known_share_around_a_window():
    residual = np.zeros((40, 50, 2), np.float32)
    residual[:, :10] = np.nan
    still = Background(np.zeros_like(residual), np.ones((40, 50), np.float32), True)
    field = MotionField(residual, still, 0.04, 1.0)
    # 28 x 28 cells about the window less its own 16: columns 6 to 33, of which 6 to 9 are not known
    # cut at the picture's edge: rows 0 to 15, columns 34 to 49, all known; nothing is around all of it
    windows = np.array([(12, 16, 18, 22), (0, 4, 46, 50), (0, 40, 0, 50)])
    assert field.known_around(windows).tolist() == pytest.approx([(28 * 24 - 16) / (784 - 16), 1.0, 0.0])


@pytest.mark.parametrize(('own_m', 'left_m'), [((0.4, 0.0, 0.0), 1.0), ((0.0, 0.0, 0.6), 0.4), ((0.0, 0.0, -1.0), 2.0)])
def test_growth_before_a_background_in_space_is_that_of_the_objects_own_cells(
    own_m: tuple[float, float, float], left_m: float, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A box 12 m ahead of a camera that drives 1 m a frame crosses, drives ahead, or comes: ``left_m`` closer."""
    box = box_cells(70, 36, 84, 58)
    moved = np.zeros((*box.shape, 3))
    moved[box] = own_m
    field = flow(np.where(box, 12.0, street_depth()), *motion((0.0, 0.01, 0.0), (0.05, 0.0, 1.0)), moved)
    field += np.random.default_rng(0).normal(0.0, 0.05, field.shape).astype(np.float32)
    scene = fit_static_scene(field, field, magnitude(field), CAMERA, BackgroundConfig())
    assert scene is not None
    grey = np.zeros((CAMERA.height, CAMERA.width), np.uint8)

    def on_the_box(_self: object, segments: object, grid: MotionField, *_: object) -> list[Candidate]:
        motions, _sigmas, _known = grid.object_motions(np.array([(36, 58, 70, 84)]))
        return [Candidate(np.array([308.0, 188.0]), np.array([56.0, 88.0]), motions[0] / grid.seconds, 4928.0, 3.0, 1)]

    monkeypatch.setattr(ObjectFinder, 'find', on_the_box)
    found = MotionDetector(PipelineConfig()).candidates(
        FlowField(field, CAMERA.width, CAMERA.height, 10 ** 8), field, scene.background,
        PreparedFrame(grey, 1.0, CAMERA.width, CAMERA.height, 10 ** 8), ReferenceFrame(grey, np.eye(3), 0.1), 0.1)
    assert found[0].growth is not None
    assert found[0].growth.rate == pytest.approx(left_m / 12.0 / 0.1, rel=0.15)
