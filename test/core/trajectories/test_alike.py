"""Parts that move as one body, on courses that are known: circles and straight lines."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.trajectories.alike import inner_motion, moved_alike, moved_as_one_body

SECONDS = (1.0, 0.48, 0.32, 0.2, 0.12)
ONE_PAIR = np.array([[0, 1]])
RADIUS = 150.0
#: Of parts whose points did not move against each other.
RIGID = np.zeros((len(SECONDS), 2, 3))


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
    assert moved_as_one_body(ways, RIGID, SECONDS, places, ONE_PAIR)[0]


def test_sides_of_a_bus_that_turns_are_one_body() -> None:
    """The outer one goes 6 px further than the inner one, of 60."""
    ways, places = on_circle([(0.0, 8.0), (0.0, -8.0)], 0.4)
    assert moved_as_one_body(ways, RIGID, SECONDS, places, ONE_PAIR)[0]


def test_neighbours_on_straight_courses_that_differ_as_much_are_two() -> None:
    """Abreast, 40 px apart, 40 and 50 px/s: as the sides of what turns by a quarter radian."""
    places = np.array([[0.0, 0.0], [0.0, 40.0]])
    assert not moved_as_one_body(straight([(40.0, 0.0), (50.0, 0.0)]), RIGID, SECONDS, places, ONE_PAIR)[0]


def test_two_that_follow_each_other_round_a_bend_at_two_speeds_are_two() -> None:
    """The first goes away from the second: along the line between them a turn changes nothing."""
    (slow, places), (fast, _) = (on_circle([(40.0, 0.0), (-40.0, 0.0)], rate) for rate in (0.3, 0.45))
    ways = [np.stack([one[0], other[1]]) for one, other in zip(fast, slow, strict=True)]
    assert not moved_as_one_body(ways, RIGID, SECONDS, places, ONE_PAIR)[0]


def test_errors_of_the_tracker_are_no_turn() -> None:
    """Straight and slow, half a pixel off the course half a second ago: a direction that is not certain."""
    places = np.array([[0.0, 0.0], [0.0, 40.0]])
    ways = straight([(8.0, 0.0), (11.0, 0.0)])
    ways[1] = ways[1] + [0.0, 0.4]
    assert not moved_as_one_body(ways, RIGID, SECONDS, places, ONE_PAIR)[0]


def test_the_longest_baseline_that_both_have_decides() -> None:
    places = np.array([[0.0, 0.0], [40.0, 0.0]])
    ways = straight([(40.0, 0.0), (40.0, 0.0)])
    ways[0] = np.array([[40.0, 0.0], [60.0, 0.0]])
    assert not moved_as_one_body(ways, RIGID, SECONDS, places, ONE_PAIR)[0]
    ways[0][1] = np.nan
    assert moved_as_one_body(ways, RIGID, SECONDS, places, ONE_PAIR)[0]
    assert not moved_as_one_body([np.full((2, 2), np.nan)] * len(SECONDS), RIGID, SECONDS, places, ONE_PAIR)[0]


def test_parts_around_the_same_place() -> None:
    """One within the other: there is no line between them."""
    places = np.zeros((2, 2))
    assert moved_as_one_body(straight([(40.0, 0.0), (40.0, 0.0)]), RIGID, SECONDS, places, ONE_PAIR)[0]
    assert not moved_as_one_body(straight([(40.0, 0.0), (60.0, 0.0)]), RIGID, SECONDS, places, ONE_PAIR)[0]


def ends_of_a_van(growth: float, turn: float, velocity: tuple[float, float]) -> tuple[list[np.ndarray], np.ndarray]:
    """Ways and places of ten points around each of its ends, 80 px apart; growth, turn: radians, a second."""
    offsets = np.random.default_rng(2).uniform(-10.0, 10.0, (20, 2))
    places = (offsets + np.repeat([[300.0, 200.0], [356.0, 257.0]], 10, axis=0)).astype(np.float32)
    middle, ways = np.array([328.0, 228.5]), []
    for seconds in SECONDS:
        cos, sin = np.cos(turn * seconds), np.sin(turn * seconds)
        scale = np.exp(-growth * seconds)
        before = scale * (places - middle) @ np.array([[cos, -sin], [sin, cos]]) + middle - np.multiply(
            velocity, seconds)
        ways.append(places - before)
    return ways, places


OWNER = np.repeat([0, 1], 10)


def parts_of(ways: list[np.ndarray], places: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Those of whole parts."""
    return ([np.stack([way[part == OWNER].mean(axis=0) for part in (0, 1)]) for way in ways],
            np.stack([places[part == OWNER].mean(axis=0) for part in (0, 1)]).astype(np.float64))


@pytest.mark.parametrize(('growth', 'turn'), [(0.12, 0.0), (-0.12, 0.0), (0.1, 0.1), (0.0, 0.25), (0.0, -0.25)])
def test_what_comes_closer_or_turns_where_it_stands_is_one_body(growth: float, turn: float) -> None:
    """A van of 80 px that a slanted view shows smaller and smaller, 12 % in a second, or a load under a crane."""
    ways, places = ends_of_a_van(growth, turn, (20.0, 5.0))
    of_parts, centres = parts_of(ways, places)
    inner = inner_motion(ways, places, OWNER, 2)
    assert moved_as_one_body(of_parts, inner, SECONDS, centres, ONE_PAIR)[0]
    assert not moved_as_one_body(of_parts, RIGID, SECONDS, centres, ONE_PAIR)[0], 'else it shows nothing'


@pytest.mark.parametrize('growth', [0.12, 0.0, -0.05])
def test_two_that_come_apart_by_more_than_they_grow_are_two(growth: float) -> None:
    ways, places = ends_of_a_van(growth, 0.0, (20.0, 5.0))
    for way, seconds in zip(ways, SECONDS, strict=True):
        way[OWNER == 1] += np.multiply((6.0, 6.0), seconds)
    of_parts, centres = parts_of(ways, places)
    assert not moved_as_one_body(of_parts, inner_motion(ways, places, OWNER, 2), SECONDS, centres, ONE_PAIR)[0]


@pytest.mark.parametrize(('share', 'joined'), [(1.0, True), (0.5, True), (0.0, True), (-0.5, False), (1.5, False)])
@pytest.mark.parametrize('growth', [0.2, -0.2])
def test_parts_come_apart_by_no_more_than_they_grow_and_not_the_other_way(
    growth: float, share: float, joined: bool,
) -> None:
    """Half of the growth is 8 px of 80; a pixel and 4 % of the way are 2."""
    grown, places = ends_of_a_van(growth, 0.0, (20.0, 5.0))
    alike, _ = ends_of_a_van(0.0, 0.0, (20.0, 5.0))
    whole, centres = parts_of(grown, places)
    rigid, _ = parts_of(alike, places)
    ways = [share * one + (1.0 - share) * other for one, other in zip(whole, rigid, strict=True)]
    assert moved_as_one_body(ways, inner_motion(grown, places, OWNER, 2), SECONDS, centres, ONE_PAIR)[0] == joined


def test_motion_within_parts() -> None:
    """Against what they were moved by; points that are too young do not count."""
    ways, places = ends_of_a_van(0.0, 0.0, (20.0, 5.0))
    still = inner_motion(ways, places, OWNER, 3)
    np.testing.assert_allclose(still[:, :, :2], 0.0, atol=1e-2)
    np.testing.assert_array_equal(still[:, 2], 0.0)
    for way in ways:
        way[:10] += 0.1 * places[:10]
        way[10:] += 0.2 * places[10:, ::-1] * [-1.0, 1.0]
    ways[0][[0, 13]] = np.nan
    ways[1][1:10] = np.nan
    inner = inner_motion(ways, places, OWNER, 2)
    np.testing.assert_allclose(inner[[0, 2, 3, 4], 0, :2] / inner[[0, 2, 3, 4], 0, 2:], [[0.1, 0.0]] * 4, atol=1e-4)
    np.testing.assert_allclose(inner[:, 1, :2] / inner[:, 1, 2:], [[0.0, 0.2]] * 5, atol=1e-4)
    np.testing.assert_array_equal(inner[1, 0], 0.0)
    squares = ((places[1:10] - places[1:10].mean(axis=0)) ** 2).sum()
    assert inner[0, 0, 2] == pytest.approx(squares, rel=1e-4)
