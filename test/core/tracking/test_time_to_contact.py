"""Time to contact on exact expansions and through the whole detector; bearings by hand."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import TracksConfig
from motion_detect_ros.core.detection.candidate import Candidate, Growth
from motion_detect_ros.core.detection.expansion import _similarity, with_growth
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.tracking.time_to_contact import Approach
from motion_detect_ros.core.tracking.tracker import Tracker
from motion_detect_ros.core.types import FlowField
from motion_detect_ros.sources.synthetic import FlightConfig, ObjectSpec, SyntheticFlight

CELL = 4


def seen_at(u: float, v: float, width: float, height: float, velocity=(0.0, 0.0)) -> Candidate:
    return Candidate(np.array([u, v]), np.array([width, height]), np.array(velocity, float), 100.0, 2.0, 1)


def field(rate: float, seconds: float, centre, shift=(6.0, 0.0), turn: float = 0.0) -> FlowField:
    """What is at distance 1 now and closes at ``rate``: pixels were at c + (p - c) * 1 / (1 + rate * seconds)."""
    y, x = np.mgrid[CELL / 2:360:CELL, CELL / 2:640:CELL]
    share = 1.0 - 1.0 / (1.0 + rate * seconds)
    dx, dy = x - centre[0], y - centre[1]
    flow = np.stack([shift[0] + share * dx - turn * dy, shift[1] + share * dy + turn * dx], axis=-1)
    return FlowField(flow.astype(np.float32), 640, 360, 0)


def growth(flow: FlowField, own: np.ndarray, seen: Candidate, seconds: float) -> Growth | None:
    return with_growth([seen], flow, own, seconds)[0].growth


class TestGrowth:
    @pytest.mark.parametrize('rate', [0.02, 0.1, 0.5, 2.0, -0.3])
    @pytest.mark.parametrize(('centre', 'size'), [((320, 180), (80, 60)), ((500, 90), (40, 24)), ((80, 300), (60, 90))])
    def test_exact_flow(self, rate, centre, size):
        flow = field(rate, 0.1, centre, turn=0.01)
        own = np.zeros_like(flow.flow)
        own[..., 0] = 6.0
        found = growth(flow, own, seen_at(*centre, *size, (60.0, 0.0)), 0.1)
        assert found.rate == pytest.approx(rate, rel=0.02)

    def test_exact_flow_of_rendered_objects_on_a_descent(self):
        cars = tuple(ObjectSpec('box', x, y, 30.0, 9.0, 9.0, 5.0, 0.3) for x, y in ((-9.0, 5.0), (9.0, -5.0)))
        config = dataclasses.replace(FlightConfig.approach(7.0, frames=4), width=640, height=360, focal_px=480.0,
                                     objects=cars)
        frame = SyntheticFlight(config).frame(3)
        flow = FlowField(np.ascontiguousarray(frame.flow[2::CELL, 2::CELL]), 640, 360, frame.stamp_ns)
        y, x = np.mgrid[2:360:CELL, 2:640:CELL]
        back = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(frame.ground_homography).T
        own = (flow.flow - (np.stack([x, y], axis=-1) - back[..., :2] / back[..., 2:])).astype(np.float32)
        for box, ttc in zip(frame.truth, frame.ttc, strict=True):
            u, v = box['x'] + box['w'] / 2, box['y'] + box['h'] / 2
            moving = np.nanmedian(own[frame.owner[2::CELL, 2::CELL] == box['id']], axis=0)
            found = growth(flow, own, seen_at(u, v, box['w'], box['h'], moving * 20.0), 0.05)
            assert 1.0 / found.rate == pytest.approx(ttc, rel=0.02)

    def test_cells_of_the_ground_and_outliers_do_not_count(self):
        random = np.random.default_rng(1)
        flow = field(0.4, 0.1, (320, 180))
        own = np.zeros_like(flow.flow)
        own[..., 0] = 6.0
        corner = np.add.outer(np.arange(90), np.arange(160)) < 45 + 80 - 6  # cuts the box
        own[corner], flow.flow[corner] = 0.0, 1.0
        wild = random.random(corner.shape) < 0.1
        flow.flow[wild] += random.normal(0, 8, (int(wild.sum()), 2)).astype(np.float32)
        flow.flow[::7, ::5] = np.nan
        own[::7, ::5] = np.nan
        found = growth(flow, own, seen_at(320, 180, 80, 60, (60.0, 0.0)), 0.1)
        assert found.rate == pytest.approx(0.4, rel=0.02)

    def test_the_variance_is_that_of_smooth_noise(self):
        errors, claims = [], []
        for seed in range(60):
            flow = field(0.2, 0.1, (320, 180))
            noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=flow.flow.shape), (0, 0), 1.2)
            flow.flow[:] += (0.3 * noise / noise.std()).astype(np.float32)
            own = np.full_like(flow.flow, 6.0)
            found = growth(flow, own, seen_at(320, 180, 80, 60, (60.0, 60.0)), 0.1)
            errors.append(found.rate - 0.2)
            claims.append(found.variance)
        assert 0.5 < np.sqrt(np.mean(np.square(errors)) / np.mean(claims)) < 1.5

    def test_too_few_cells_are_no_measurement(self):
        flow = field(0.2, 0.1, (320, 180))
        own = np.full_like(flow.flow, 6.0)
        small, unknown = seen_at(320, 180, 10, 10, (60, 60)), np.full_like(own, np.nan)
        assert growth(flow, own, small, 0.1) is None
        assert growth(flow, unknown, seen_at(320, 180, 80, 60, (60, 60)), 0.1) is None
        assert with_growth([], flow, own, 0.1) == []
        known = seen_at(320, 180, 80, 60, (60, 60))
        alone = growth(flow, own, known, 0.1)
        assert [each.growth for each in with_growth([small, known, small], flow, own, 0.1)] == [None, alone, None]

    @pytest.mark.parametrize(('inside', 'cut'), [
        ((45, 180), (43, 180)), ((320, 27), (320, 26)), ((595, 180), (597, 180)), ((320, 333), (320, 334)),
        ((320, 180), (600, 180)), ((100, 180), (100, 5))])
    def test_size_is_unknown_where_the_border_cuts_the_box(self, inside, cut):
        """Or is less than 4 px away: edges of the box are 40 and 22.5 px from its centre."""
        flow = field(0.2, 0.1, (320, 180))
        own = np.full_like(flow.flow, 6.0)
        whole, part = (growth(flow, own, seen_at(*each, 80, 45, (60, 60)), 0.1) for each in (inside, cut))
        assert whole.log_size == pytest.approx(math.log(60)) and math.isnan(part.log_size)

    @pytest.mark.parametrize('turn', [0.0, 0.1, -0.2])
    def test_a_turn_makes_exact_flow_no_less_certain(self, turn):
        """20 x 16 cells of 4 px: squares of the distances from their middle add up to 320 (532 + 340) px^2."""
        flow = field(0.5, 0.1, (320, 180), turn=turn)
        own = np.full_like(flow.flow, 6.0)
        found = growth(flow, own, seen_at(320, 180, 80, 60, (60, 60)), 0.1)
        per_rate = 0.1 / 1.05 ** 2  # the share 1 - 1 / (1 + 0.1 rate) grows by so much a unit of the rate, which is 0.5
        assert found.rate == pytest.approx(0.5, rel=1e-4)
        assert found.variance == pytest.approx(0.02 ** 2 * 16.0 / (320.0 * 872.0) / per_rate ** 2, rel=0.01)

    def test_turn_and_scale_are_told_apart(self):
        random = np.random.default_rng(3)
        x, y, weight = random.uniform(0, 60, 50), random.uniform(0, 30, 50), random.uniform(0.1, 1.0, 50)
        mean = [float(np.average(each, weights=weight)) for each in (x, y)]
        dx, dy = x - mean[0], y - mean[1]
        scale, turn, spread, means = _similarity(x, y, 3.0 + 0.1 * dx - 0.2 * dy, -2.0 + 0.1 * dy + 0.2 * dx, weight)
        assert (scale, turn) == (pytest.approx(0.1), pytest.approx(0.2))
        assert spread == pytest.approx((weight * (dx ** 2 + dy ** 2)).sum())
        assert means == pytest.approx((*mean, 3.0, -2.0))


def approached(rates, sizes, dt_s=0.05, sigma=0.05) -> list[float]:
    approach, times = Approach(), []
    for index, (rate, size) in enumerate(zip(rates, sizes, strict=True)):
        if index:
            approach.predict(dt_s)
        approach.update(Growth(rate, sigma ** 2, 0.1, math.log(size)))
        times.append(approach.time_to_contact_s)
    return times


class TestApproach:
    @pytest.mark.parametrize('first_s', [3.0, 8.0, 20.0])
    def test_exact_measurements(self, first_s):
        left = first_s - 0.05 * np.arange(40)
        times = approached(1.0 / left, 400.0 / left, sigma=0.01)
        assert np.isnan(times[:3]).all()  # too young
        assert np.array(times[5:]) == pytest.approx(left[5:], rel=0.02)

    def test_either_measurement_is_enough(self):
        left = 4.0 - 0.05 * np.arange(50)
        by_flow = approached(1.0 / left, np.full(50, np.nan))
        by_size = approached(np.zeros(50), 400.0 / left, sigma=1e3)
        assert by_flow[-1] == pytest.approx(left[-1], rel=0.05)
        assert by_size[-1] == pytest.approx(left[-1], rel=0.1)

    def test_what_recedes_never_arrives(self):
        left = 4.0 + 0.05 * np.arange(40)
        assert approached(-1.0 / left, 400.0 / left)[-1] == math.inf

    def test_what_neither_comes_nor_goes_is_unknown(self):
        random, unknown = np.random.default_rng(4), []
        for _ in range(40):
            times = approached(random.normal(0, 0.05, 40), 60 * np.exp(random.normal(0, 0.03, 40)))
            unknown.append(math.isnan(times[-1]))
        assert np.mean(unknown) > 0.9

    def test_time_runs_on_between_measurements(self):
        left = 4.0 - 0.05 * np.arange(40)
        approach = Approach()
        for time_left in left:
            approach.predict(0.05)
            approach.update(Growth(1.0 / time_left, 1e-4, 0.1, math.log(400.0 / time_left)))
        before = approach.time_to_contact_s
        approach.predict(0.25)
        assert before - approach.time_to_contact_s == pytest.approx(0.25, abs=0.01)

    def test_tracks_report_it(self):
        tracker = Tracker(TracksConfig())
        for index in range(12):
            left = 4.0 - 0.05 * index
            seen = dataclasses.replace(seen_at(200, 150, 200 / left, 160 / left),
                                       growth=Growth(1.0 / left, 1e-4, 0.1, math.log(178.9 / left)))
            records = tracker.step([seen], np.eye(3), 0.05, 640, 480)
        assert records['ttc'][0] == pytest.approx(left, rel=0.02)


def rendered(closing_m_s: float, things, altitude_m: float = 60.0, frames: int = 32) -> FlightConfig:
    objects = tuple(
        ObjectSpec('box', x, y, heading, 8.0, length, width, 0.5) for x, y, heading, length, width in things)
    return dataclasses.replace(FlightConfig.approach(closing_m_s, frames=frames), objects=objects,
                               altitude_m=altitude_m, width=640, height=360, focal_px=480.0)


#: Descents of 5 to 12 m/s on boxes of 60 to 100 px that drive, in the middle and off it.
APPROACHES = {
    'slow, large': rendered(7.0, [(-10.0, 4.0, -20.0, 11.0, 8.0), (9.0, -3.0, 170.0, 10.0, 8.0)]),
    'fast, off to one side': rendered(10.0, [(-19.0, 8.0, 10.0, 9.0, 7.0)], 55.0),
    'faster, middle': rendered(12.0, [(-8.0, 1.0, 0.0, 8.0, 8.0)], 65.0),
}


def times_of(config: FlightConfig) -> np.ndarray:
    """(n, 2) reported and true time to contact of every report on an object."""
    pipeline, found = MotionPipeline(), []
    for frame in SyntheticFlight(config):
        for record in pipeline.process(frame.image, frame.stamp_ns).detections:
            middle = np.array([record['u'], record['v']])
            truth = frame.truth
            boxes = np.stack([truth['x'] + truth['w'] / 2, truth['y'] + truth['h'] / 2], axis=-1)
            distance = np.hypot(*(boxes - middle).T)
            if distance.min() < 10.0:
                found.append((record['ttc'], frame.ttc[distance.argmin()]))
    return np.array(found)


@pytest.mark.parametrize('config', APPROACHES.values(), ids=APPROACHES.keys())
def test_whole_detector_on_an_exact_approach(config):
    reported, true = times_of(config).T
    known = np.isfinite(reported)
    assert len(known) > 15 and known.mean() > 0.5
    assert np.median(np.abs(reported / true - 1.0)[known]) < 0.1
    assert not np.isinf(reported).any()


def test_whole_detector_on_what_flies_away():
    reported, true = times_of(rendered(-8.0, [(-10.0, 2.0, 0.0, 9.0, 8.0)], 45.0)).T
    assert np.isinf(true).all()
    assert not np.isfinite(reported).any() and np.isinf(reported).mean() > 0.5
