"""Limits: the flights by their rendered truth, the arithmetic and the pictures by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from motion_detect_ros.benchmarks import limits, limits_flights
from motion_detect_ros.benchmarks.limits import GRIDS, SIZES_PX, Axis, Grid, markdown, reach, shares
from motion_detect_ros.benchmarks.limits_flights import Cell, Found, fly, make_flight
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.sources.synthetic import SyntheticFlight


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small pictures and short flights."""
    for name, value in (('WIDTH_PX', 320), ('HEIGHT_PX', 240), ('FRAMES', 16), ('TURN_RADIUS_PX', 100.0)):
        monkeypatch.setattr(limits_flights, name, value)


class TestFlight:
    @pytest.mark.usefixtures('small')
    def test_objects_have_the_size_and_speed_of_the_cell(self) -> None:
        cell = Cell(24, 6, pan_px=10)
        flight = SyntheticFlight(make_flight(cell))
        before, after = (flight.frame(index).truth for index in (5, 6))
        both = set(before['id'].tolist()) & set(after['id'].tolist())
        whole = [ident for ident in both if (before['moving'][before['id'] == ident] == 1).all()]
        assert len(whole) >= 2
        steps = []
        for ident in whole:
            old, new = before[before['id'] == ident][0], after[after['id'] == ident][0]
            if new['y'] > 0 and new['y'] + new['h'] < 240 and old['y'] > 0 and old['y'] + old['h'] < 240:
                assert abs(new['w'] - 24) <= 1 and abs(new['h'] - 24) <= 1
                assert new['y'] - old['y'] == pytest.approx(10, abs=1.1)
                steps.append(float(new['x'] - old['x']))
        assert np.abs(steps) == pytest.approx(6, abs=1.1)
        assert min(steps) < 0 < max(steps), 'lanes go both ways'

    @pytest.mark.usefixtures('small')
    def test_camera_turns_by_the_degrees_of_the_cell(self) -> None:
        cell = Cell(24, 2, turn_deg=3)
        flight = SyntheticFlight(make_flight(cell))
        matrix = flight.frame(cell.frames()[8]).ground_homography
        assert abs(math.degrees(math.atan2(matrix[1, 0], matrix[0, 0]))) == pytest.approx(3, rel=0.05)

    def test_refuses_both(self) -> None:
        with pytest.raises(ConfigError, match='a camera that pans or turns expected, got 4 px and 2 degrees'):
            make_flight(Cell(24, 2, 4, 2))

    @pytest.mark.usefixtures('small')
    def test_easy_objects_are_found_and_not_by_a_blind_detector(self) -> None:
        cell = Cell(32, 4, 2)
        easy = fly(cell, PipelineConfig())
        assert easy.wanted >= 12 and easy.hits >= 0.75 * easy.wanted
        blind = fly(cell, with_settings(PipelineConfig(), {'objects.min_side_px': 300.0}))
        assert (blind.wanted, blind.hits, blind.false) == (easy.wanted, 0, 0)


class TestArithmetic:
    def test_shares_sum_over_seeds_before_dividing(self) -> None:
        grid = Grid('', Axis('speed_px', '', (1.0, 2.0), 1.0), Cell(8, 1))
        found = [Found(10, 1, 0), Found(30, 7, 0), Found(0, 0, 0), Found(0, 0, 0)]
        recall = shares(grid, (8.0,), 2, found)
        assert recall[0, 0] == 8 / 40
        assert np.isnan(recall[0, 1]), 'nothing in view is not nothing found'

    def test_cells_come_in_the_order_of_shares(self) -> None:
        grid = Grid('', Axis('pan_px', '', (0.0, 5.0), 0.0), Cell(8, 1))
        cells = grid.cells((8.0, 16.0), 2)
        assert [(cell.size_px, cell.pan_px, cell.seed) for cell in cells[:5]] == [
            (8, 0, 1), (8, 0, 2), (8, 5, 1), (8, 5, 2), (16, 0, 1)]

    @pytest.mark.parametrize(('recall', 'expected'), [
        ([1.0, 0.2, 0.9, 1.0, 0.95, 0.89], (3, 5)),  # what is found beyond a gap is out of reach
        ([0.9] * 6, (1, 6)),
        ([1.0, 1.0, 0.9, 0.89, 1.0, 1.0], None),
    ])
    def test_reach_goes_from_the_start_to_the_first_gap(
            self, recall: list[float], expected: tuple[float, float] | None) -> None:
        assert reach((1, 2, 3, 4, 5, 6), np.array(recall), 4) == expected

    def test_sentences(self) -> None:
        """All of 24 px and more found, up to 8 px/frame, pan 16, turn 1; slower than 1 px/frame nothing."""
        sizes = np.array(SIZES_PX)[:, None] >= 24
        speed, pan, turn = (np.array(grid.axis.values) for grid in GRIDS)
        recalls = [(sizes & (speed >= 1) & (speed <= 8)).astype(float), (sizes & (pan <= 16)).astype(float),
                   (sizes & (turn <= 1)).astype(float)]
        assert [line.split(': ')[1] for line in limits.limits(SIZES_PX, recalls)] == [
            '24 px', '1 px/frame', '8 px/frame', '16 px/frame', '1 degrees/frame']
        nothing = [np.zeros_like(recall) for recall in recalls]
        assert limits.limits(SIZES_PX, nothing)[0].endswith('none px')

    def test_table_is_in_percent(self) -> None:
        grid = Grid('', Axis('speed_px', 'speed', (0.5, 2.0), 2.0), Cell(8, 1))
        assert markdown(grid, (8.0,), np.array([[0.125, np.nan]])) == [
            '| size, px; speed: | 0.5 | 2 |', '|---|---|---|', '| 8 | 12 | - |']
