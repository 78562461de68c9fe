"""Ids of objects that are hidden for a while, under an exact camera motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from motion_detect_ros.core.config import TracksConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.tracking.tracker import Tracker

DT_S, WIDTH, HEIGHT = 0.04, 640, 480
PAN = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]])


def seen(frame: float, start: tuple[float, float] = (80.0, 200.0), step_px: tuple[float, float] = (3.0, 0.0),
         size: tuple[float, float] = (40.0, 20.0)) -> Candidate:
    """An object that moves by ``step_px`` a frame over a ground that passes by ``PAN``."""
    centre = np.array(start) + frame * (np.array(step_px) + PAN[:2, 2])
    return Candidate(centre, np.array(size), np.array(step_px) / DT_S, 300.0, 3.0, 1)


def reports(frames: Sequence[list[Candidate]], tracker: Tracker | None = None) -> list[np.ndarray]:
    tracker = tracker or Tracker(TracksConfig())
    return [tracker.step(each, PAN, DT_S, WIDTH, HEIGHT) for each in frames]


def hidden(count: int, after: list[list[Candidate]]) -> list[list[Candidate]]:
    return [[seen(frame)] for frame in range(10)] + [[]] * count + after


@pytest.mark.parametrize('count', [8, 15, 22])
@pytest.mark.parametrize('lag_px', [0.0, 10.0])
def test_an_object_that_was_hidden_gets_its_id_back(count: int, lag_px: float) -> None:
    after = [[seen(frame, start=(80.0 - lag_px, 200.0))] for frame in range(10 + count, 18 + count)]
    found = reports(hidden(count, after))
    assert found[9]['id'].tolist() == [1] and len(found[9 + count]) == 0
    assert found[-1]['id'].tolist() == [1]
    assert found[-1]['age'].tolist() == [len(found)]


def test_one_that_stopped_and_goes_on_gets_its_id_back() -> None:
    stood = 15
    after = [[seen(frame, start=(80.0 - 3.0 * stood, 200.0))] for frame in range(10 + stood, 18 + stood)]
    assert reports(hidden(stood, after))[-1]['id'].tolist() == [1]


@pytest.mark.parametrize('after', [
    {'start': (80.0, 280.0)}, {'start': (200.0, 200.0)}, {'size': (90.0, 60.0)},
], ids=['beside', 'ahead', 'larger'])
def test_another_object_gets_an_id_of_its_own(after: dict) -> None:
    found = reports(hidden(10, [[seen(frame, **after)] for frame in range(20, 28)]))
    assert found[-1]['id'].tolist() == [2]


def test_after_over_a_second_it_is_a_new_object() -> None:
    found = reports(hidden(32, [[seen(frame)] for frame in range(42, 50)]))
    assert found[-1]['id'].tolist() == [2]


@pytest.mark.parametrize('along', [np.array([1.0, 0.0]), np.array([0.0, 1.0])], ids=['across', 'down'])
@pytest.mark.parametrize(('away_px', 'back_px', 'number'), [(10.0, -20.0, 2), (0.0, 0.0, 1)], ids=['left', 'hidden'])
def test_what_left_the_picture_does_not_come_back(
    away_px: float, back_px: float, number: int, along: np.ndarray,
) -> None:
    """Even where the camera turns back and something is where it would be, and as fast."""
    tracker, place, found = Tracker(TracksConfig()), np.array([WIDTH, HEIGHT]) - 140.0 * along - 200.0 * along[::-1], []
    for frame, pan_px in enumerate([2.0] * 11 + [away_px] * 8 + [back_px] * 8 + [-3.0] * 8):
        place = place + (pan_px + 3.0) * along
        matrix = np.eye(3)
        matrix[:2, 2] = pan_px * along
        one = Candidate(place, np.array([40.0, 40.0]), 3.0 / DT_S * along, 300.0, 3.0, 1)
        found.append(tracker.step([] if 10 < frame < 27 else [one], matrix, DT_S, WIDTH, HEIGHT))
    assert found[10]['id'].tolist() == [1]
    assert found[-1]['id'].tolist() == [number]


@pytest.mark.parametrize('forget', [Tracker.reset, lambda tracker: tracker.coast_without_frame(DT_S, WIDTH)])
def test_nothing_is_remembered_over_a_break(forget) -> None:
    tracker = Tracker(TracksConfig())
    reports(hidden(8, []), tracker)
    forget(tracker)
    assert reports([[seen(frame)] for frame in range(19, 27)], tracker)[-1]['id'].tolist() == [2]


def beside(offsets: Sequence[float], frame: int) -> list[Candidate]:
    return [seen(frame, start=(80.0, 200.0 + each)) for each in offsets]


@pytest.mark.parametrize('order', [1, -1])
@pytest.mark.parametrize(('before', 'after', 'ids'), [
    ((0.0, 30.0), (0.0, 30.0), (1, 2)), ((0.0, 30.0), (9.0, 37.0), (1, 2)), ((0.0,), (0.0, 20.0), (1, 2)),
    ((0.0,), (11.0, 2.0), (2, 1)),
])
def test_of_several_the_nearest_pairs_go_on(before: tuple[float, ...], after: tuple[float, ...], ids: tuple[int, ...],
                                            order: int) -> None:
    frames = [beside(before, frame) for frame in range(10)] + [[]] * 12
    found = reports([*frames, *[beside(after[::order], frame) for frame in range(22, 30)]])[-1]
    assert dict(zip(np.argsort(np.argsort(found['v'])).tolist(), found['id'].tolist(), strict=True)) == dict(
        zip(np.argsort(np.argsort(after)).tolist(), ids, strict=True))


def test_what_was_seen_beside_it_is_another_object() -> None:
    tracker = Tracker(TracksConfig(confirm_s=0.6, confirm_window_s=0.8))
    both = [beside((0.0,), frame) for frame in range(20)] + [beside((0.0, 9.0), frame) for frame in range(20, 30)]
    found = reports([*both, *[beside((9.0,), frame) for frame in range(30, 50)]], tracker)
    assert found[25]['id'].tolist() == [1] and found[-1]['id'].tolist() == [2]


def test_an_id_goes_to_one_object_only() -> None:
    """A second one appears where the first might have come back, too, had it not."""
    first = [beside((0.0,), frame) for frame in range(22, 28)]
    both = [beside((0.0, 9.0), frame) for frame in range(28, 38)]
    found = reports([*[beside((0.0,), frame) for frame in range(10)], *[[]] * 12, *first, *both])
    assert found[27]['id'].tolist() == [1] and sorted(found[-1]['id']) == [1, 2]


@pytest.mark.parametrize('step_px', [(-3.0, 0.0), (0.0, 8.0)])
def test_what_goes_another_way_is_another_object(step_px: tuple[float, float]) -> None:
    place = np.array([80.0, 200.0]) + 22 * np.array([3.0, 0.0])
    start = place - 22 * np.array(step_px)
    after = [[seen(frame, (start[0], start[1]), step_px)] for frame in range(20, 28)]
    assert reports(hidden(10, after))[-1]['id'].tolist() == [2]
