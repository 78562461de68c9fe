"""Soft shadows of what moves: pictures whose objects and shadows are known."""

from __future__ import annotations

import numpy as np
import pytest
from point_objects import PointObjects
from still_camera import frames_of, step
from warps import blocks

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.presets import load_preset

PERIOD_NS, FRAMES = 40_000_000, 26
HEIGHT, WIDTH = 240, 480
CAMERA = CameraModel(WIDTH, HEIGHT, 480.0, 480.0, WIDTH / 2.0, HEIGHT / 2.0)
#: The object in the last frame, its shadow below it, and a region around both.
OBJECT, SHADOW, REGION = Box(260, 100, 300, 124), Box(260, 124, 300, 140), Box(250, 90, 310, 150)


def scene(
    ago: int, speed: float = 4.0, darkness: float = 0.85, light: float = 1.0, body: tuple[int, int] = (160, 255),
    ground: tuple[int, int] = (80, 120),
) -> np.ndarray:
    """An object that moves to the right by ``speed`` pixels a frame over textured ground, and its shadow.

    darkness: share of the light that the shadow leaves; light: of the last frame.
    """
    gray = blocks(1, HEIGHT, WIDTH, *ground)
    way = round(speed * ago)
    gray[SHADOW.top:SHADOW.bottom, SHADOW.left - way:SHADOW.right - way] *= darkness
    gray[OBJECT.top:OBJECT.bottom, OBJECT.left - way:OBJECT.right - way] = blocks(
        2, OBJECT.height, OBJECT.width, *body)
    return np.clip(np.rint(gray * (light if ago == 0 else 1.0)), 0, 255).astype(np.uint8)


def shadow_of(speed: float = 4.0, frames: int = FRAMES, **scene_options: float | tuple[int, int]) -> np.ndarray:
    """(h, w) pixels of the region that are taken for a shadow."""
    history = frames_of((scene(ago, speed, **scene_options) for ago in range(frames - 1, -1, -1)), PERIOD_NS)
    own = np.zeros((REGION.height, REGION.width), bool)
    own[OBJECT.top - REGION.top:SHADOW.bottom - REGION.top, 10:50] = True
    return SoftShadows(history).of(own, REGION, speed * 25.0, 50.0)


def shares(speed: float = 4.0, frames: int = FRAMES, **scene_options: float | tuple[int, int]) -> tuple[float, float]:
    """Shares of the shadow's and of the object's pixels that are taken for a shadow."""
    found = shadow_of(speed, frames, **scene_options)
    shadow = found[SHADOW.top + 2 - REGION.top:SHADOW.bottom - REGION.top, 10:50]
    body = found[OBJECT.top - REGION.top:OBJECT.bottom - REGION.top, 10:50]
    return float(shadow.mean()), float(body.mean())


class TestSoftShadows:
    def test_ground_that_shows_through_is_a_shadow_and_what_hides_it_is_none(self) -> None:
        shadow, body = shares()
        assert shadow > 0.9
        assert body == 0.0

    def test_two_pixels_around_the_object_are_its_own(self) -> None:
        below = shadow_of()[OBJECT.bottom - REGION.top:, 20:40]
        assert not below[:2].any()
        assert below[3:SHADOW.height].all()

    def test_what_the_object_has_not_left_yet_is_not_told_from_it(self) -> None:
        """In 0.2 s it has gone 20 of its 50 pixels: the oldest picture shows itself there."""
        assert shares(frames=6) == (0.0, 0.0)

    def test_so_is_what_goes_less_than_its_size_in_all_of_the_time(self) -> None:
        assert shares(speed=1.5) == (0.0, 0.0)

    def test_the_first_frame_knows_no_ground(self) -> None:
        assert shares(frames=1) == (0.0, 0.0)

    def test_a_hard_shadow_may_be_a_dark_vehicle(self) -> None:
        assert shares(darkness=0.5)[0] == 0.0

    def test_an_object_hardly_darker_than_the_ground_is_no_shadow_of_itself(self) -> None:
        """All of it lets the ground show through, as far as grey values tell: then none of it is left out."""
        assert shares(body=(90, 94), ground=(96, 104)) == (0.0, 0.0)

    @pytest.mark.parametrize('light', [0.85, 1.15])
    def test_the_light_of_the_whole_picture_is_none(self, light: float) -> None:
        shadow, body = shares(light=light)
        assert shadow > 0.8
        assert body < 0.05


def finder_after(darkness: float) -> tuple[PointObjects, list[Candidate]]:
    finder, found = PointObjects(load_preset('visdrone')), list[Candidate]()
    for index in range(FRAMES):
        found = finder.candidates(*step(scene(FRAMES - 1 - index, darkness=darkness), index, PERIOD_NS), CAMERA)
    return finder, found


def bottom(candidate: Candidate) -> float:
    return float(candidate.centre[1] + candidate.size[1] / 2.0)


class TestBoxes:
    def test_of_points_end_where_the_object_does(self) -> None:
        _, (found,) = finder_after(darkness=0.85)
        assert bottom(found) == pytest.approx(OBJECT.bottom, abs=4.0)

    def test_of_points_hold_a_hard_shadow(self) -> None:
        """The counterpart of the test above: without it that box might be short for another reason."""
        _, (found,) = finder_after(darkness=0.5)
        assert bottom(found) == pytest.approx(SHADOW.bottom, abs=4.0)

    def test_of_flow_end_where_the_object_does(self) -> None:
        finder, _ = finder_after(darkness=0.85)
        whole = Candidate(np.array([280.0, 120.0]), np.array([40.0, 40.0]), np.array([100.0, 0.0]), 1600.0, 0.0, 1)
        (found,) = finder.evidence.without_shadows([whole])
        assert bottom(whole) == 140.0
        assert bottom(found) == pytest.approx(OBJECT.bottom, abs=4.0)
        assert found.centre[1] - found.size[1] / 2.0 == pytest.approx(100.0)
        assert found.velocity_px_s.tolist() == [100.0, 0.0]

    def test_of_flow_outside_of_the_picture_stay(self) -> None:
        finder, _ = finder_after(darkness=0.85)
        outside = Candidate(np.array([-30.0, 120.0]), np.array([40.0, 40.0]), np.array([100.0, 0.0]), 1600.0, 0.0, 1)
        assert finder.evidence.without_shadows([outside]) == [outside]
