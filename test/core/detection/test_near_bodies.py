"""Bodies near the camera: they fill most of the picture, and bend."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from joined_patches import joined_patches

from motion_detect_ros.core.background.selection import BackgroundSelector
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.objects import ObjectFinder
from motion_detect_ros.core.detection.patches import Patch
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.presets import load_preset

HEIGHT, WIDTH, FRAMES = 360, 640, 8
#: Left, top, right, bottom of a cross, whose bars are a third as wide as the picture is high.
LEFT, TOP, RIGHT, BOTTOM = 60, 20, 560, 340


def _texture(seed: int) -> np.ndarray:
    grain = np.random.default_rng(seed).normal(0.0, 60.0, (HEIGHT, WIDTH + 4 * FRAMES))
    return np.clip(128.0 + 3.0 * cv2.GaussianBlur(grain, (0, 0), 2.0), 0, 255).astype(np.uint8)


def _cross() -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[TOP:BOTTOM, 250:370] = mask[120:240, LEFT:RIGHT] = True
    return mask


def _seen(preset: str, mask: np.ndarray, body: np.ndarray | None = None) -> tuple[list[tuple[float, ...]], int]:
    """Left, top, right, bottom of what is reported after ``mask`` went to the right, and how far it went.

    body: picture of it, as wide as ``_texture``, which is the default.
    """
    pipeline, ground, body = MotionPipeline(load_preset(preset)), _texture(0), _texture(1) if body is None else body
    for index in range(FRAMES):
        shift = 4 * index
        image = np.where(np.roll(mask, shift, axis=1), np.roll(body, shift, axis=1)[:, :WIDTH], ground[:, :WIDTH])
        detections = pipeline.process(image, (index + 1) * 40_000_000).detections
    return [(one['u'] - one['width'] / 2, one['v'] - one['height'] / 2,
             one['u'] + one['width'] / 2, one['v'] + one['height'] / 2) for one in detections], shift


@pytest.mark.parametrize('preset', ['default', 'kitti'])
def test_what_reaches_from_one_side_of_the_picture_to_the_other_is_reported(preset: str) -> None:
    """Nothing is more urgent for who must not hit it. Its box is two thirds of the picture, itself a third."""
    mask = _cross()
    assert 0.6 < (RIGHT - LEFT) * (BOTTOM - TOP) / mask.size < 0.75
    assert mask.mean() < 0.4
    edges, shift = _seen(preset, mask)
    assert len(edges) == 1
    np.testing.assert_allclose(edges[0], (LEFT + shift, TOP, RIGHT + shift, BOTTOM), atol=12)


#: Left, top, right, bottom of a body and of its leg beside it. The box of both is a fifth of the picture, and
#: twice what their own boxes cover.
BODY, LEG = (200, 60, 260, 300), (272, 220, 400, 300)


def _body_and_leg() -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), bool)
    for left, top, right, bottom in (BODY, LEG):
        mask[top:bottom, left:right] = True
    return mask


@pytest.mark.parametrize('preset', ['default', 'kitti'])
def test_leg_stretched_out_beside_its_body_is_in_its_box(preset: str) -> None:
    edges, shift = _seen(preset, _body_and_leg())
    assert len(edges) == 1
    np.testing.assert_allclose(edges[0], (200 + shift, 60, 400 + shift, 300), atol=12)


@pytest.mark.parametrize('preset', ['default', 'kitti'])
def test_before_a_background_in_space_it_is_not(preset: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """There the photometric test reaches far beside what moves, and what it finds may be flow that leaks."""
    fit = BackgroundSelector.fit
    monkeypatch.setattr(BackgroundSelector, 'fit', lambda *given: replace(fit(*given), smooth=False))
    edges, shift = _seen(preset, _body_and_leg())
    assert len(edges) == 2
    for found, (left, top, right, bottom) in zip(sorted(edges), (BODY, LEG), strict=True):
        np.testing.assert_allclose(found, (left + shift, top, right + shift, bottom), atol=12)


#: A trunk, and a limb that sticks out beside its lower end: a box of 60 x 110 = 6600 around 2000 + 2000.
TRUNK, LIMB = Patch(Box(0, 0, 20, 100), 900), Patch(Box(20, 60, 60, 110), 700)


def test_limbs_are_parts_of_a_near_body() -> None:
    assert joined_patches([TRUNK, LIMB], near_area=6600.0) == [Patch(Box(0, 0, 60, 110), 1600)]


def test_of_smaller_boxes_the_same_are_two_objects_side_by_side() -> None:
    assert len(joined_patches([TRUNK, LIMB], near_area=6601.0)) == 2
    assert len(joined_patches([TRUNK, LIMB])) == 2


def test_far_apart_near_bodies_are_two() -> None:
    """More than half of the box around them would be empty."""
    assert len(joined_patches([TRUNK, Patch(Box(20, 95, 70, 135), 700)], near_area=1000.0)) == 2


#: Left, top, right, bottom of a body of plain fur: a fifth of the picture, with little on it but a collar and a nose.
FUR = (140, 80, 400, 260)
MARKS = ((150, 90, 175, 130), (250, 100, 270, 150), (370, 215, 395, 250), (180, 225, 215, 245))


def _fur() -> np.ndarray:
    body = np.full((HEIGHT, WIDTH + 4 * FRAMES), 200, np.uint8)
    body += np.linspace(0, 25, body.shape[1]).astype(np.uint8)  # so that it does not go unseen that it moves
    for left, top, right, bottom in MARKS:
        body[top:bottom, left:right] = _texture(2)[top:bottom, left:right]
    return body


@pytest.mark.parametrize('preset', ['default', 'kitti'])
def test_plain_body_with_marks_is_one_object(preset: str) -> None:
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[FUR[1]:FUR[3], FUR[0]:FUR[2]] = True
    edges, shift = _seen(preset, mask, _fur())
    assert len(edges) == 1
    np.testing.assert_allclose(edges[0], (FUR[0] + shift, FUR[1], FUR[2] + shift, FUR[3]), atol=20)


@pytest.mark.parametrize(('preset', 'whole'), [('kitti', True), ('visdrone', False)])
def test_where_points_are_tracked_parts_stay_apart(preset: str, whole: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """From above it is vehicles side by side that make a large segment."""
    areas: list[float] = []
    find = ObjectFinder.find

    def noted(finder: ObjectFinder, *given: Any) -> list[Candidate]:
        candidates = find(finder, *given)
        areas.extend(candidate.size.prod() for candidate in candidates)
        return candidates

    monkeypatch.setattr(ObjectFinder, 'find', noted)
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[FUR[1]:FUR[3], FUR[0]:FUR[2]] = True
    _seen(preset, mask, _fur())
    assert len(areas) > 3
    assert (max(areas) > 0.15 * mask.size) == whole


#: Three marks in a box of 200 x 100.
SCATTERED = [Patch(Box(0, 0, 20, 20), 300), Patch(Box(90, 40, 110, 60), 200), Patch(Box(180, 80, 200, 100), 100)]


def _same(ones: list[Patch], others: list[Patch]) -> bool:
    """In whatever order."""
    return set(ones) == set(others) and len(ones) == len(others)


def test_parts_of_a_large_segment_are_one_body() -> None:
    assert joined_patches(SCATTERED, least_area=20000.0, most_area=50000.0) == [Patch(Box(0, 0, 200, 100), 600)]


def test_parts_of_a_small_one_may_be_neighbours() -> None:
    assert _same(joined_patches(SCATTERED, least_area=20001.0, most_area=50000.0), SCATTERED)


def test_parts_are_better_than_a_box_too_large_to_be_reported() -> None:
    assert _same(joined_patches(SCATTERED, least_area=100.0, most_area=19999.0), SCATTERED)


def test_one_part_or_none_stay() -> None:
    assert joined_patches([], least_area=0.0, most_area=1e9) == []
    assert joined_patches(SCATTERED[:1], least_area=0.0, most_area=1e9) == SCATTERED[:1]
