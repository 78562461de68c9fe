"""Clusters of points, and what they are linked over: scenes whose objects are known."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay
from still_camera import frames_of

from motion_detect_ros.core.trajectories.changes import changed_pixels
from motion_detect_ros.core.trajectories.clusters import ALONG, Cluster, _links, _on_changes, carried, find_clusters
from motion_detect_ros.core.trajectories.light import relit, shrunk
from motion_detect_ros.core.trajectories.linked_groups import linked_groups
from motion_detect_ros.core.trajectories.object_motion import PointMotion
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.recent_frames import MAX_FRAMES

PERIOD_NS = 50_000_000
HEIGHT, WIDTH = 240, 480
ROAD, ROOF = 90, 200


class Car:
    """A plain roof, points on its two ends only: that is all a tracker finds there. Edges at the newest frame."""

    def __init__(self, left: int, top: int, length: int, width: int, speed: float, gray: int = ROOF) -> None:
        """speed: pixels a frame, to the right."""
        self.left, self.top, self.length, self.width, self.speed, self.gray = left, top, length, width, speed, gray

    def draw(self, gray: np.ndarray, ago: int) -> None:
        left = round(self.left - self.speed * ago)
        gray[self.top:self.top + self.width, max(0, left):max(0, left + self.length)] = self.gray

    def points(self) -> np.ndarray:
        rows = self.top + np.arange(2, self.width, 4)
        columns = self.left + np.array([2, 6, self.length - 6, self.length - 2])
        return np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2).astype(np.float32)


class Paint(Car):
    """Plain and without points, on the ground."""

    def __init__(self, left: int, top: int, length: int, width: int, gray: int = ROOF) -> None:
        super().__init__(left, top, length, width, 0.0, gray)

    def points(self) -> np.ndarray:
        return np.zeros((0, 2), np.float32)


class Textured(Car):
    """Points all over it. On the picture in all frames."""

    def draw(self, gray: np.ndarray, ago: int) -> None:
        left = round(self.left - self.speed * ago)
        gray[self.top:self.top + self.width, left:left + self.length] = np.random.default_rng(1).integers(
            150, 250, (self.width // 6, self.length // 6)).repeat(6, axis=0).repeat(6, axis=1)

    def points(self) -> np.ndarray:
        rows, columns = self.top + np.arange(2, self.width, 8), self.left + np.arange(2, self.length, 8)
        return np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2).astype(np.float32)


def clusters_of(
    cars: list[Car], still: np.ndarray | None = None, history: int = 20, usual_area: float | None = None,
) -> list[tuple[int, int]]:
    """Left and right end of each cluster, pixels. cars: drawn in their order; history: frames before the newest."""
    pictures = []
    for ago in range(history, -1, -1):
        gray = np.full((HEIGHT, WIDTH), ROAD, np.uint8)
        for car in cars:
            car.draw(gray, ago)
        pictures.append(gray)
    frames = frames_of(pictures, PERIOD_NS)
    standing = np.zeros((0, 2), np.float32) if still is None else still
    places = np.concatenate([*(car.points() for car in cars), standing]).astype(np.float32)
    speed = np.concatenate([*(np.full(len(car.points()), car.speed) for car in cars), np.zeros(len(standing))])
    path = np.full((len(places), MAX_FRAMES, 2), np.nan, np.float32)
    path[:, 0] = places
    points = Points(path, np.full(len(places), history, np.int32), np.zeros((len(places), 2), np.float32),
                    np.arange(len(places)))
    own = np.stack([speed, np.zeros_like(speed)], axis=1)
    motion = replace(PointMotion.at_rest(len(places)), velocity=20.0 * own, sigmas=np.where(speed != 0.0, 20.0, 0.0),
                     displacements=(history * own, history / 2.0 * own), seconds=(history / 20.0, history / 40.0))
    found = find_clusters(points, motion, np.ones(len(places), bool), frames, usual_area)
    return sorted((round(each.low[0]), round(each.high[0])) for each in found)


class TestClusters:
    def test_front_and_rear_of_a_plain_roof_are_one(self) -> None:
        assert clusters_of([Car(100, 100, 50, 24, 4.0)]) == [(102, 148)]

    def test_what_is_near_is_large(self) -> None:
        """A third of the picture's width, as a vehicle that the camera follows closely."""
        assert clusters_of([Textured(190, 60, 162, 90, 9.0)]) == [(192, 344)]

    def test_two_that_follow_each_other_are_no_large_one(self) -> None:
        """What is between them, 30 pixels of road, differs from what was there 0.3 s ago, when the first one was."""
        ahead, behind = Textured(300, 60, 60, 42, 7.5), Textured(210, 60, 60, 42, 7.5)
        assert clusters_of([ahead, behind], history=6) == []

    def test_half_of_the_picture_is_the_scene(self) -> None:
        assert clusters_of([Textured(190, 60, 240, 90, 9.0)]) == []

    def test_neighbours_of_another_speed_are_two(self) -> None:
        """4 and 5 pixels a frame: 20 pixels in a second, side by side, 6 pixels apart."""
        assert clusters_of([Car(100, 100, 40, 20, 4.0), Car(120, 126, 40, 20, 5.0)]) == [(102, 138), (122, 158)]

    def test_road_between_neighbours_of_one_speed_keeps_them_apart(self) -> None:
        """Side by side, 12 pixels of road in between, which looks as it did before."""
        assert len(clusters_of([Car(100, 100, 40, 20, 4.0), Car(100, 132, 40, 20, 4.0)])) == 2

    def test_a_point_that_stands_between_them_keeps_them_apart(self) -> None:
        """The two ends of one roof were joined above; with a row of still points across it they are not."""
        across = np.stack([np.full(30, 125.0), np.linspace(90, 134, 30)], 1).astype(np.float32)
        assert clusters_of([Car(100, 100, 50, 24, 4.0)], across) == [(102, 106), (144, 148)]

    def test_ends_of_a_long_roof_that_goes_less_than_its_length_in_a_second_are_one(self) -> None:
        """Between its ends the picture looks as it did half a second and a second ago."""
        assert clusters_of([Car(100, 100, 70, 24, 1.0)]) == [(102, 168)]

    def test_they_are_one_among_small_ones_too(self) -> None:
        """The bounds of their points are three times the usual size, and the halves' leave most of them empty."""
        assert clusters_of([Car(100, 100, 70, 24, 1.0)], usual_area=700.0) == [(102, 168)]

    def test_neighbours_that_overlap_are_two_where_one_is_too_large(self) -> None:
        pair = [Textured(100, 100, 42, 24, 4.0), Textured(130, 118, 42, 24, 4.0)]
        assert len(clusters_of(pair)) == 1
        assert len(clusters_of(pair, usual_area=1000.0)) == 2

    def test_ends_that_go_at_two_speeds_are_two_whatever_is_between(self) -> None:
        """Two bars 60 pixels apart, and a plain patch of paint that reaches from one to the other."""
        ends = [Car(100, 100, 10, 24, 1.0), Car(160, 100, 10, 24, 3.0)]
        assert len(clusters_of([*ends, Paint(110, 102, 50, 20)])) == 2

    def test_plain_road_between_two_that_follow_each_other_does_not_join_them(self) -> None:
        """It goes on beside them."""
        assert len(clusters_of([Car(100, 100, 20, 24, 1.0), Car(145, 100, 20, 24, 1.0)])) == 2

    def test_nor_does_a_small_plain_place_that_reaches_beyond_them(self) -> None:
        place = Paint(98, 82, 68, 60, 140)
        assert len(clusters_of([place, Car(100, 100, 14, 24, 1.0), Car(150, 100, 14, 24, 1.0)])) == 2

    def test_a_patch_between_them_that_still_points_touch_is_a_part_of_the_scene(self) -> None:
        """Paint that two at one speed have just touched, with its own corners and what stands on it."""
        ends = [Car(100, 100, 10, 24, 1.0), Car(160, 100, 10, 24, 1.0)]
        across = np.stack([np.linspace(112, 158, 40), np.tile([102.0, 121.0], 20)], 1).astype(np.float32)
        painted = [*ends, Paint(110, 102, 50, 20)]
        assert len(clusters_of(painted)) == 1
        assert len(clusters_of(painted, across)) == 2

    def test_nothing_moves(self) -> None:
        still = Car(100, 100, 50, 24, 0.0)
        assert clusters_of([still]) == []


def _one_a_cell(places: np.ndarray) -> np.ndarray:
    """Those whose cell of 2 x 2 pixels has none before them."""
    _, first = np.unique(places.astype(int) // 2, axis=0, return_index=True)
    return places[np.sort(first)]


class TestLinks:
    def test_neighbours_are_those_of_the_triangulation_up_to_60_pixels(self) -> None:
        random = np.random.default_rng(0)
        places = _one_a_cell(random.uniform([0, 0], [WIDTH, HEIGHT], (180, 2)).astype(np.float32))
        moving, still = places[:100], places[100:]
        far = 1e5 * np.array([[-1.4, -1.1], [1.7, -1.0], [0.1, 1.9]])
        first, neighbours = Delaunay(np.concatenate([places, far])).vertex_neighbor_vertices
        expected = {(one, int(other)) for one in range(100) for other in neighbours[first[one]:first[one + 1]]
                    if one < other < 100 and np.linalg.norm(places[one] - places[other]) <= 60.0}
        found = _links(moving, still, WIDTH, HEIGHT).tolist()
        assert len(found) == len(expected) > 50
        assert {tuple(pair) for pair in found} == expected

    @pytest.mark.parametrize('step', [2, 7, 50])
    @pytest.mark.parametrize('shift', [0.0, 0.25])
    def test_points_on_a_lattice_are_linked_with_those_beside_them(self, step: int, shift: float) -> None:
        """Where many triangulations are right all have the sides of the squares, and one diagonal of each at most."""
        columns, rows = 40, 15
        lattice = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
        places = (lattice * np.array([min(step, 7), step]) + shift).astype(np.float32)
        found = lattice[_links(places, places[:0], 300, 800)]
        ways = np.abs(found[:, 0] - found[:, 1])
        sides = ways.sum(axis=1) == 1
        assert sides.sum() == columns * (rows - 1) + rows * (columns - 1)
        assert np.all(ways[~sides] == 1) and np.sum(~sides) <= (columns - 1) * (rows - 1)

    def test_points_on_a_line_are_linked_with_the_next_ones(self) -> None:
        places = np.stack([np.random.default_rng(0).permutation(50) * 4.0, np.full(50, 20.0)], 1).astype(np.float32)
        found = _links(places, places[:0], 300, 200)
        assert sorted(np.abs(places[found[:, 0], 0] - places[found[:, 1], 0])) == [4.0] * 49

    def test_points_in_the_corners_of_the_picture_are_linked_too(self) -> None:
        places = np.array([[0, 0], [39, 0], [0, 29], [39, 29], [20, 15]], np.float32)
        found = {tuple(pair) for pair in _links(places, places[:0], 40, 30).tolist()}
        assert {(0, 4), (1, 4), (2, 4), (3, 4), (0, 1), (0, 2), (1, 3), (2, 3)} == found

    def test_a_link_lies_on_what_changed(self) -> None:
        """By its length: up to 6 pixels anywhere, up to 20 with six of its nine places, beyond that with eight."""
        random = np.random.default_rng(1)
        changed = cv2.blur(random.random((HEIGHT // 2, WIDTH // 2)), (5, 5)) > 0.47
        places = random.uniform([40, 40], [WIDTH - 40, HEIGHT - 40], (1200, 2)).astype(np.float32)
        places[1::2] = places[::2] + random.uniform(-22, 22, (600, 2)).astype(np.float32)
        links = np.arange(1200).reshape(-1, 2)

        def lies(one: np.ndarray, other: np.ndarray) -> bool:
            length = float(np.linalg.norm(one - other))
            places = (np.rint((1.0 - share) * one + share * other) for share in np.arange(0.1, 0.95, 0.1))
            number = sum(bool(changed[int(row) // 2, int(column) // 2]) for column, row in places)
            return length < 6.0 or number >= (6 if length <= 20.0 else 8)

        expected = [lies(*places[link].astype(np.float64)) for link in links]
        covered = np.empty(len(links), np.bool_)
        _on_changes(places, links, changed, ALONG, covered)
        assert 100 < sum(expected) < 500
        assert covered.tolist() == expected


class TestCarried:
    """Points of which every fourth dies, and all from the 40th on."""

    RANDOM = np.random.default_rng(0)
    BEFORE, NOW = RANDOM.uniform(0, 200, (60, 2)), RANDOM.uniform(0, 200, (60, 2))

    def points(self, places: np.ndarray, number: np.ndarray) -> Points:
        path = np.full((len(places), MAX_FRAMES, 2), np.nan, np.float32)
        path[:, 0] = places
        return Points(path, np.full(len(places), 9, np.int32), np.zeros((len(places), 2), np.float32), number)

    def test_where_their_points_live_clusters_go_with_them(self) -> None:
        before = self.points(self.BEFORE, np.arange(60))
        lives = np.arange(60) % 4 != 0
        lives[40:] = False
        now = self.points(self.NOW[lives], np.flatnonzero(lives))
        few, dead = np.arange(11, 17), np.arange(40, 50)
        members = [np.array([2, 1, 4, 5, 30, 6, 7, 8, 9]), few, dead, np.arange(20, 28)]
        one, *gone, other = carried([Cluster(each, *np.zeros((2, 2), np.float32), np.ones(2), np.full(2, 3.0))
                                     for each in members], before, now)
        assert gone == [None, None]
        for (cluster, way), was in ((one, members[0]), (other, members[3])):
            alive = was[lives[was]]
            assert now.number[cluster.members].tolist() == alive.tolist()
            places = self.NOW[alive].astype(np.float32)
            np.testing.assert_array_equal(cluster.low, places.min(axis=0))
            np.testing.assert_array_equal(cluster.high, places.max(axis=0))
            np.testing.assert_allclose(way, np.median(self.NOW[alive] - self.BEFORE[alive], axis=0), atol=1e-4)
            assert cluster.velocity.tolist() == [1.0, 1.0]
            assert cluster.background.tolist() == [3.0, 3.0]
        assert carried([], before, now) == []
        assert carried([Cluster(dead, *np.zeros((4, 2)))], before, now) == [None]


class TestChanges:
    NOISE = cv2.GaussianBlur(np.random.default_rng(4).normal(size=(HEIGHT, WIDTH)), (0, 0), 2.0)
    TEXTURE = cv2.normalize(NOISE, None, 60, 180, cv2.NORM_MINMAX).astype(np.uint8)

    def test_light_that_changes_slowly_from_place_to_place_is_no_change(self) -> None:
        glow = np.linspace(-20, 20, WIDTH)[None, :].repeat(HEIGHT, 0)
        lit = np.clip(self.TEXTURE + glow, 0, 255).astype(np.uint8)
        assert (np.abs(lit.astype(int) - self.TEXTURE) > 8).mean() > 0.5
        assert changed_pixels(frames_of([self.TEXTURE, lit], PERIOD_NS), [1]).mean() < 0.02

    def test_a_thing_that_came_is_a_change_of_its_size(self) -> None:
        now = self.TEXTURE.copy()
        now[100:130, 200:240] = 250
        changed = changed_pixels(frames_of([self.TEXTURE, now], PERIOD_NS), [1])
        rows, columns = np.nonzero(changed)
        assert abs(rows.min() - 50) <= 1
        assert abs(rows.max() - 64) <= 1
        assert abs(columns.min() - 100) <= 1
        assert abs(columns.max() - 119) <= 1

    def test_only_what_differs_from_all_earlier_frames_is_changed(self) -> None:
        """A ghost: bright in one earlier frame only."""
        bright = self.TEXTURE.copy()
        bright[100:130, 200:240] = 250
        frames = frames_of([self.TEXTURE, bright, self.TEXTURE], PERIOD_NS)
        assert changed_pixels(frames, [1]).any()
        assert not changed_pixels(frames, [1, 2]).any()
        assert not changed_pixels(frames, []).any()

    @pytest.mark.parametrize('shape', [(270, 480), (120, 427), (271, 487), (160, 240)])
    def test_an_image_is_shrunk_to_the_means_of_its_areas(self, shape: tuple[int, int]) -> None:
        """Each an eighth of the sides, with whole ratios of the sizes and with others."""
        gray = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
        expected = cv2.resize(gray, (shape[1] // 8, shape[0] // 8), interpolation=cv2.INTER_AREA)
        np.testing.assert_array_equal(shrunk(gray), expected)

    @pytest.mark.parametrize('shape', [(20, 20), (79, 300), (81, 161)])
    def test_any_size(self, shape: tuple[int, int]) -> None:
        gray = np.full(shape, 100, np.uint8)
        assert (relit(gray, shrunk(gray)) == 100).all()


class TestLinkedGroups:
    def test_what_is_linked_over_others_too_is_one_group(self) -> None:
        groups = linked_groups(6, np.array([[4, 0], [4, 2], [5, 1]]))
        assert [group.tolist() for group in groups] == [[0, 2, 4], [1, 5], [3]]

    @pytest.mark.parametrize('links', [10, 60, 90, 200])
    @pytest.mark.parametrize('least', [1, 3])
    def test_many(self, links: int, least: int) -> None:
        """Against SciPy's."""
        pairs = np.random.default_rng(links).integers(0, 100, (links, 2))
        graph = coo_array((np.ones(links), tuple(pairs.T)), shape=(100, 100))
        count, labels = connected_components(graph, directed=False)
        expected = sorted(np.flatnonzero(labels == label).tolist() for label in range(count))
        found = [group.tolist() for group in linked_groups(100, pairs, least)]
        assert found == [group for group in expected if len(group) >= least]

    def test_without_links_everything_is_alone(self) -> None:
        assert [group.tolist() for group in linked_groups(2, np.zeros((0, 2), np.intp))] == [[0], [1]]
