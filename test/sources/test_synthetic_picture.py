"""The pictures of a synthetic flight: they move as the truth says, look as configured, and never differ."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight, SyntheticFrame

CLEAN = FlightConfig(blur=0.0, noise_sigma=0.0, exposure_drift=0.0)
SMALL = FlightConfig(width=320, height=180, focal_px=240.0, frames=8)


@pytest.fixture(scope='module')
def pair() -> tuple[SyntheticFrame, SyntheticFrame]:
    flight = SyntheticFlight(CLEAN)
    return flight.frame(29), flight.frame(30)


def grey(frame: SyntheticFrame) -> np.ndarray:
    return frame.image.astype(np.float32).mean(axis=2)


def warped(image: np.ndarray, flow: np.ndarray, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    rows, columns = np.mgrid[:image.shape[0], :image.shape[1]].astype(np.float32)
    flow = np.nan_to_num(flow) + np.float32(shift)
    return cv2.remap(image, columns - flow[..., 0], rows - flow[..., 1], cv2.INTER_CUBIC)


def textured(frame: SyntheticFrame) -> tuple[np.ndarray, np.ndarray]:
    """Where the frame has texture and exact flow, (H, W) bool, and its gradient there, (n, 2) per pixel."""
    gradient = np.stack([cv2.Sobel(grey(frame), cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1))], axis=2)
    where = (np.hypot(*np.moveaxis(gradient, 2, 0)) > 4) & np.isfinite(frame.flow[..., 0])
    return where, gradient[where]


class TestPictureMovesWithTheFlow:
    def test_previous_picture_warped_by_the_flow_is_this_picture(
        self, pair: tuple[SyntheticFrame, SyntheticFrame],
    ) -> None:
        before, now = pair
        where, _ = textured(now)
        assert where.sum() > 100_000

        def error(*shift: float) -> float:
            return float(np.median(np.abs(grey(now) - warped(grey(before), now.flow, (shift[0], shift[1])))[where]))

        exact = error(0, 0)
        assert exact < 1.5
        for shift in ((0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5)):
            assert error(*shift) > 2.2 * exact

    @pytest.mark.parametrize('kind', ['scenery', 'cars and people'])
    def test_remaining_shift_is_under_a_twentieth_of_a_pixel(
        self, pair: tuple[SyntheticFrame, SyntheticFrame], kind: str,
    ) -> None:
        """Lucas & Kanade 1981: the error against the gradient, solved for the shift that explains it."""
        before, now = pair
        where, gradient = textured(now)
        chosen = (now.owner[where] > 0) == (kind != 'scenery')
        assert chosen.sum() > 2000
        error = np.clip((grey(now) - warped(grey(before), now.flow))[where], -20, 20)
        shift, *_ = np.linalg.lstsq(gradient[chosen], error[chosen], rcond=None)
        assert np.abs(shift).max() < 0.05
        moved = np.clip((grey(now) - warped(grey(before), now.flow, (0.2, 0.0)))[where], -20, 20)
        shift, *_ = np.linalg.lstsq(gradient[chosen], moved[chosen], rcond=None)
        assert shift[0] == pytest.approx(0.2, abs=0.07)  # the measurement does see a shift

    def test_tracked_corners_follow_the_ground_homography(self) -> None:
        flight = SyntheticFlight(dataclasses.replace(
            CLEAN, ground='field', cars=0, parked_cars=0, people=0, buildings=0, trees=0))
        before, now = flight.frame(20), flight.frame(21)
        first, second = (cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY) for frame in (before, now))
        points = cv2.goodFeaturesToTrack(first, 500, 0.01, 10)
        expected = cv2.perspectiveTransform(points, now.ground_homography)
        tracked, found, _ = cv2.calcOpticalFlowPyrLK(first, second, points, None, winSize=(21, 21))
        offset = (tracked - expected)[found[:, 0] == 1][:, 0]
        assert len(offset) > 300
        assert np.abs(np.median(offset, axis=0)).max() < 0.02
        assert np.median(np.linalg.norm(offset, axis=1)) < 0.05


class TestScene:
    def test_sizes_and_numbers_are_those_of_an_aerial_clip(self) -> None:
        flight = SyntheticFlight(FlightConfig())
        records = np.concatenate([flight.frame(index).truth for index in (0, 40, 80)])
        clear = records[records['moving'] >= 0]
        cars = clear[np.maximum(clear['w'], clear['h']) >= 30]
        people = clear[np.maximum(clear['w'], clear['h']) < 30]
        assert len(cars) >= 9
        assert len(people) >= 15
        assert 25 <= np.median(np.maximum(cars['w'], cars['h'])) <= 80
        assert 8 <= np.median(people['h']) <= 25
        assert (clear['moving'] == 1).sum() > (clear['moving'] == 0).sum() > 0

    def test_an_object_keeps_its_id(self) -> None:
        flight = SyntheticFlight(FlightConfig())
        first, second = flight.frame(50), flight.frame(51)
        shared = set(first.truth['id']) & set(second.truth['id'])
        assert len(shared) >= 10
        for ident in shared:
            inside = second.flow[(second.owner == ident) & np.isfinite(second.flow[..., 0])]
            if len(inside) > 30:
                rows, columns = np.nonzero(second.owner == ident)
                was = np.array([columns.mean(), rows.mean()]) - inside.mean(axis=0)
                box = first.truth[first.truth['id'] == ident][0]
                assert box['x'] - 1 <= was[0] <= box['x'] + box['w'] + 1
                assert box['y'] - 1 <= was[1] <= box['y'] + box['h'] + 1

    def test_speeds_are_those_of_traffic_and_walkers(self) -> None:
        scene = SyntheticFlight(SMALL).scene
        known = scene.ident > 0
        cars, people = known & (scene.size[:, 0] > 3), known & (scene.size[:, 0] < 1)
        driving, walking = scene.speed[cars & (scene.speed > 0)], scene.speed[people & (scene.speed > 0)]
        assert len(driving) >= 30
        assert len(walking) >= 80
        assert 5 <= driving.min() <= driving.max() <= 15
        assert 1 <= walking.min() <= walking.max() <= 2

    def test_no_two_movers_run_into_each_other(self) -> None:
        flight = SyntheticFlight(dataclasses.replace(SMALL, frames=200))
        scene = flight.scene
        driving = (scene.ident > 0) & (scene.speed > 2.5)
        for time_s in np.arange(0, 10, 0.5):
            place = scene.positions(float(time_s))[driving]
            apart = place[:, None] - place[None]
            apart -= 256 * np.rint(apart / 256)  # the town repeats
            distance = np.hypot(apart[..., 0], apart[..., 1]) + np.eye(len(place)) * 1e3
            assert distance.min() > 3.0


class TestSensor:
    def test_noise_has_the_configured_sigma(self) -> None:
        quiet = dataclasses.replace(SMALL, noise_sigma=0.0)
        noisy = dataclasses.replace(SMALL, noise_sigma=5.0)
        clean, rough = SyntheticFlight(quiet).frame(2).image, SyntheticFlight(noisy).frame(2).image
        middle = (clean > 30) & (clean < 225)  # where clipping does not narrow it
        assert (rough.astype(float) - clean)[middle].std() == pytest.approx(5.0, rel=0.03)

    def test_exposure_drifts_by_its_amplitude(self) -> None:
        drift = dataclasses.replace(SMALL, exposure_drift=0.2, noise_sigma=0.0, frames=101)
        steady, drifting = SyntheticFlight(dataclasses.replace(drift, exposure_drift=0.0)), SyntheticFlight(drift)
        ratios = []
        for index in range(0, 100, 10):  # one period: 5 s
            plain, image = steady.frame(index).image, drifting.frame(index).image
            inside = (plain > 60) & (plain < 200)
            ratios.append(float(np.median(image[inside] / plain[inside].astype(float))))
        assert max(ratios) == pytest.approx(1.2, abs=0.02)
        assert min(ratios) == pytest.approx(0.8, abs=0.02)

    def test_blur_smears_along_the_motion_only(self) -> None:
        # straight down, flying to the picture's top at 12 px a frame: rows blur, columns stay sharp
        config = FlightConfig.single(20, 0.0, 12.0, frames=3, noise_sigma=0.0)
        sharp, blurred = (
            grey(SyntheticFlight(dataclasses.replace(config, blur=share)).frame(1)) for share in (0.0, 0.5))

        def roughness(image: np.ndarray, axis: int) -> float:
            return float(np.abs(np.diff(image, axis=axis)).mean())

        along, across = (roughness(blurred, axis) / roughness(sharp, axis) for axis in (0, 1))
        assert along < 0.35
        assert across > along + 0.15
        expected = np.mean([np.roll(sharp, k, axis=0) for k in range(-3, 4)], axis=0)  # 6 px long, centred
        assert np.abs(blurred - expected)[10:-10].mean() < 1.0


class TestSameBytes:
    def test_two_flights_of_one_config(self) -> None:
        first, second = SyntheticFlight(SMALL), SyntheticFlight(SMALL)
        for a, b in zip(first, second, strict=True):
            assert a.image.tobytes() == b.image.tobytes()
            assert a.flow.tobytes() == b.flow.tobytes()
            assert a.truth.tobytes() == b.truth.tobytes()

    def test_any_order(self) -> None:
        in_order = list(SyntheticFlight(SMALL))
        assert len(in_order) == 8
        other = SyntheticFlight(SMALL)
        for index in (6, 0, 3, 7, 3):
            frame = other.frame(index)
            assert frame.image.tobytes() == in_order[index].image.tobytes()
            assert frame.flow.tobytes() == in_order[index].flow.tobytes()

    def test_any_number_of_opencv_threads(self) -> None:
        from motion_detect_ros.sources.synthetic import flight as module
        before = cv2.getNumThreads()
        if before == 1:
            pytest.skip('OpenCV has one thread here: nothing to compare')
        usual = SyntheticFlight(SMALL).frame(3).image.tobytes()
        try:
            cv2.setNumThreads(1)
            module._atlas.cache_clear()  # else the second flight would share the first one's textures
            single = SyntheticFlight(SMALL).frame(3).image.tobytes()
        finally:
            cv2.setNumThreads(before)
        assert single == usual

    def test_another_seed_is_another_town(self) -> None:
        image = SyntheticFlight(SMALL).frame(3).image
        other = SyntheticFlight(dataclasses.replace(SMALL, seed=2)).frame(3).image
        assert np.abs(image.astype(int) - other).mean() > 10
