"""Parts that move as one body, on courses that are known: circles and straight lines."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.trajectories.alike import moved_alike, moved_as_one_body

SECONDS = (1.0, 0.48, 0.32, 0.2, 0.12)
ONE_PAIR = np.array([[0, 1]])
RADIUS = 150.0


def on_circle(offsets: list[tuple[float, float]], rate: float) -> tuple[list[np.ndarray], np.ndarray]:
    """Displacements and places of parts of a car on a circle; offsets: from its middle, ahead and to the side."""
    places = np.array([[RADIUS + side, ahead] for ahead, side in offsets])
    ways = []
    for seconds in SECONDS:
        back = -rate * seconds
        turn = np.array([[np.cos(back), -np.sin(back)], [np.sin(back), np.cos(back)]])
        ways.append(places - places @ turn.T)
    return ways, places


def straight(velocities: list[tuple[float, float]]) -> list[np.ndarray]:
    return [seconds * np.array(velocities) for seconds in SECONDS]


def test_points_are_compared_over_the_longest_baseline_that_both_have() -> None:
    """Against their definition, pair by pair: a pixel and 4 % of the shorter way."""
    random = np.random.default_rng(0)
    ways = [seconds * 40.0 + random.normal(0.0, 0.8, (60, 2)) for seconds in SECONDS]
    for index, way in enumerate(ways):
        way[random.random(60) < 0.8 - 0.2 * index] = np.nan
    ways[-1][:2] = np.nan
    pairs = random.integers(0, 60, (500, 2))

    def alike(one: int, other: int) -> bool:
        for way in ways:
            if np.isfinite(way[[one, other]]).all():
                shorter = min(np.linalg.norm(way[one]), np.linalg.norm(way[other]))
                return bool(np.linalg.norm(way[one] - way[other]) < 1.0 + 0.04 * shorter)
        return False

    expected = [alike(*pair) for pair in pairs.tolist()]
    assert 100 < sum(expected) < 400
    assert moved_alike(ways, pairs).tolist() == expected
    assert not moved_alike([], pairs).any()


@pytest.mark.parametrize('rate', [0.3, -0.3, 0.5])
def test_ends_of_a_car_that_turns_are_one_body(rate: float) -> None:
    ways, places = on_circle([(40.0, 0.0), (-40.0, 0.0)], rate)
    assert not moved_alike(ways, ONE_PAIR)[0]
    assert moved_as_one_body(ways, SECONDS, places, ONE_PAIR)[0]


def test_sides_of_a_bus_that_turns_are_one_body() -> None:
    """The outer one goes 6 px further than the inner one, of 60."""
    ways, places = on_circle([(0.0, 8.0), (0.0, -8.0)], 0.4)
    assert moved_as_one_body(ways, SECONDS, places, ONE_PAIR)[0]


def test_neighbours_on_straight_courses_that_differ_as_much_are_two() -> None:
    """Abreast, 40 px apart, 40 and 50 px/s: as the sides of what turns by a quarter radian."""
    places = np.array([[0.0, 0.0], [0.0, 40.0]])
    assert not moved_as_one_body(straight([(40.0, 0.0), (50.0, 0.0)]), SECONDS, places, ONE_PAIR)[0]


def test_two_that_follow_each_other_round_a_bend_at_two_speeds_are_two() -> None:
    """The first goes away from the second: along the line between them a turn changes nothing."""
    (slow, places), (fast, _) = (on_circle([(40.0, 0.0), (-40.0, 0.0)], rate) for rate in (0.3, 0.45))
    ways = [np.stack([one[0], other[1]]) for one, other in zip(fast, slow, strict=True)]
    assert not moved_as_one_body(ways, SECONDS, places, ONE_PAIR)[0]


def test_errors_of_the_tracker_are_no_turn() -> None:
    """Straight and slow, half a pixel off the course half a second ago: a direction that is not certain."""
    places = np.array([[0.0, 0.0], [0.0, 40.0]])
    ways = straight([(8.0, 0.0), (11.0, 0.0)])
    ways[1] = ways[1] + [0.0, 0.4]
    assert not moved_as_one_body(ways, SECONDS, places, ONE_PAIR)[0]


def test_the_longest_baseline_that_both_have_decides() -> None:
    places = np.array([[0.0, 0.0], [40.0, 0.0]])
    ways = straight([(40.0, 0.0), (40.0, 0.0)])
    ways[0] = np.array([[40.0, 0.0], [60.0, 0.0]])
    assert not moved_as_one_body(ways, SECONDS, places, ONE_PAIR)[0]
    ways[0][1] = np.nan
    assert moved_as_one_body(ways, SECONDS, places, ONE_PAIR)[0]
    assert not moved_as_one_body([np.full((2, 2), np.nan)] * len(SECONDS), SECONDS, places, ONE_PAIR)[0]


def test_parts_around_the_same_place() -> None:
    """One within the other: there is no line between them."""
    places = np.zeros((2, 2))
    assert moved_as_one_body(straight([(40.0, 0.0), (40.0, 0.0)]), SECONDS, places, ONE_PAIR)[0]
    assert not moved_as_one_body(straight([(40.0, 0.0), (60.0, 0.0)]), SECONDS, places, ONE_PAIR)[0]
