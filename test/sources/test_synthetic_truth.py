"""The truth of a synthetic flight against formulas worked out here, from the pinhole camera alone."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from motion_detect_ros.core.errors import ConfigError, SourceError
from motion_detect_ros.core.types import TRUTH_DTYPE
from motion_detect_ros.sources.synthetic import FlightConfig, ObjectSpec, SyntheticFlight, SyntheticFrame

#: A small, empty, steady flight; each test adds what it is about.
STILL = FlightConfig(
    width=480, height=270, fps=10.0, frames=12, focal_px=360.0, altitude_m=50.0, speed_m_s=0.0, heading_deg=90.0,
    pitch_deg=90.0, turn_deg_s=0.0, climb_m_s=0.0, shake_deg=0.0, zoom_share=0.0, blur=0.0, noise_sigma=0.0,
    exposure_drift=0.0, ground='field', cars=0, parked_cars=0, people=0, buildings=0, trees=0)
CENTRE = (239.5, 134.5)


def flight(**changes: object) -> SyntheticFlight:
    return SyntheticFlight(dataclasses.replace(STILL, **changes))


def project(points: np.ndarray, camera: np.ndarray, heading: float, pitch: float, focal: float) -> np.ndarray:
    """Pixels of (n, 3) world points: the picture's right, down and forward directions written out by hand."""
    forward = np.array([math.cos(heading) * math.cos(pitch), math.sin(heading) * math.cos(pitch), -math.sin(pitch)])
    right = np.array([math.sin(heading), -math.cos(heading), 0.0])
    down = np.array([-math.cos(heading) * math.sin(pitch), -math.sin(heading) * math.sin(pitch), -math.cos(pitch)])
    offset = points - camera
    depth = offset @ forward
    return np.stack([focal * (offset @ right) / depth + CENTRE[0], focal * (offset @ down) / depth + CENTRE[1]], axis=1)


def corners(spec: ObjectSpec, time_s: float) -> np.ndarray:
    """The eight corners of an object's box at ``time_s``."""
    turn = math.radians(spec.heading_deg)
    ahead, left = np.array([math.cos(turn), math.sin(turn)]), np.array([-math.sin(turn), math.cos(turn)])
    middle = np.array([spec.x_m, spec.y_m]) + spec.speed_m_s * time_s * ahead
    return np.array([
        [*(middle + a * spec.length_m / 2 * ahead + b * spec.width_m / 2 * left), c * spec.height_m]
        for a in (-1, 1) for b in (-1, 1) for c in (0, 1)])


def record(frame: SyntheticFrame, ident: int) -> np.void:
    found = frame.truth[frame.truth['id'] == ident]
    assert len(found) == 1
    return found[0]


class TestBoxes:
    specs = (ObjectSpec('box', 4.0, 22.0, 35.0, 6.0, 5.0, 2.5, 2.0),
             ObjectSpec('box', -9.0, 34.0, 80.0, 0.0, 4.0, 3.0, 3.0))

    def test_box_holds_the_projected_corners_to_the_pixel(self) -> None:
        source = flight(pitch_deg=55.0, speed_m_s=8.0, objects=self.specs)
        for index in (0, 5, 11):
            time_s = index / 10.0
            camera = np.array([0.0, 8.0 * time_s, 50.0])
            frame = source.frame(index)
            for ident, spec in enumerate(self.specs, start=1):
                pixels = project(corners(spec, time_s), camera, math.pi / 2, math.radians(55), 360.0)
                box = record(frame, ident)
                # a pixel is the object's where half of its samples are: the outermost may be missed at a sharp corner
                assert np.abs([box['x'], box['y']] - (pixels.min(axis=0))).max() < 1.5
                assert np.abs([box['x'] + box['w'] - 1, box['y'] + box['h'] - 1] - pixels.max(axis=0)).max() < 1.5

    def test_box_is_the_extent_of_the_object_s_pixels(self) -> None:
        frame = flight(pitch_deg=55.0, objects=self.specs).frame(3)
        assert frame.truth.dtype == TRUTH_DTYPE
        for box in frame.truth:
            rows, columns = np.nonzero(frame.owner == box['id'])
            assert (box['x'], box['y']) == (columns.min(), rows.min())
            assert (box['w'], box['h']) == (np.ptp(columns) + 1, np.ptp(rows) + 1)

    def test_boxes_are_centred_to_a_tenth_of_a_pixel_on_average(self) -> None:
        # flat on the ground at 7.2 px/m from (-0.7 m, 0.4 m), 2.361 px a frame to the right and 1.237 px down:
        # steps that fall on every fraction of a pixel
        speed, heading = math.hypot(2.361, 1.237) / 7.2 * 10, -math.degrees(math.atan2(1.237, 2.361))
        source = flight(frames=40, objects=(ObjectSpec('box', -0.7, 0.4, heading, speed, 5.0, 5.0, 0.001),))
        offsets = []
        for index in range(40):
            box = record(source.frame(index), 1)
            offsets.append([box['x'] + (box['w'] - 1) / 2 - (CENTRE[0] - 0.7 * 7.2 + 2.361 * index),
                            box['y'] + (box['h'] - 1) / 2 - (CENTRE[1] - 0.4 * 7.2 + 1.237 * index)])
        assert np.abs(np.mean(offsets, axis=0)).max() < 0.1

    def test_moving_is_told_from_standing(self) -> None:
        frame = flight(pitch_deg=55.0, speed_m_s=8.0, objects=self.specs).frame(4)
        assert record(frame, 1)['moving'] == 1
        assert record(frame, 2)['moving'] == 0
        assert set(frame.truth['frame']) == {4}

    @pytest.mark.parametrize(('share_inside', 'moving'), [(0.8, 1), (0.2, -1)])
    def test_object_mostly_outside_the_picture_is_ignored(self, share_inside: float, moving: int) -> None:
        # 7.2 px/m at 50 m: the right border is 33.33 m to the east; the object is flat, 5 m long
        border = 240 / 7.2
        spec = ObjectSpec('box', border + 2.5 - 5 * share_inside, 0.0, 90.0, 0.01, 5.0, 5.0, 0.01)
        frame = flight(objects=(spec,)).frame(0)
        assert record(frame, 1)['moving'] == moving
        assert record(frame, 1)['w'] == pytest.approx(36 * share_inside, abs=1)

    def test_hidden_object_has_no_box_and_a_mostly_hidden_one_is_ignored(self) -> None:
        wall = ObjectSpec('box', 0.0, 30.0, 0.0, 0.0, 20.0, 1.0, 12.0)
        # the wall's east end is at (10, 30); lines of sight past it reach x = 10.3 to 11.7 on the box, which ends at 11
        behind, peeking = ObjectSpec('person', 0.0, 33.0), ObjectSpec('box', 9.0, 33.0, 0.0, 1.0, 4.0, 4.0, 1.5)
        hidden = flight(pitch_deg=50.0, objects=(wall, behind, peeking)).frame(0)
        assert set(hidden.truth['id']) == {1, 3}
        assert record(hidden, 3)['moving'] == -1
        free = flight(pitch_deg=50.0, objects=(behind, peeking)).frame(0)
        assert set(free.truth['id']) == {1, 2}
        assert record(free, 2)['moving'] == 1

    def test_tiny_object_is_ignored(self) -> None:
        frame = flight(objects=(ObjectSpec('box', 0.0, 0.0, 0.0, 1.0, 0.5, 0.5, 0.3),)).frame(0)  # 3.6 px
        assert record(frame, 1)['moving'] == -1


class TestFlow:
    def test_one_object_over_still_ground(self) -> None:
        # 7.2 px/m on the ground; a flat box 40 px long at the top moves 5 px a frame to the east = right
        metre_px = 360.0 / (50.0 - 0.02)
        spec = ObjectSpec('box', 0.0, 0.0, 0.0, 50.0 / metre_px, 40 / metre_px, 40 / metre_px, 0.02)
        frame = flight(objects=(spec,)).frame(2)
        thing = frame.owner == 1
        assert np.abs(frame.flow[thing] - [5.0, 0.0]).max() < 1e-3
        left, top = record(frame, 1)['x'], record(frame, 1)['y']
        uncovered = np.isnan(frame.flow[..., 0])
        rows, columns = np.nonzero(uncovered)
        assert (columns.min(), columns.max()) == (left - 5, left - 1)
        assert (rows.min(), rows.max()) == (top, top + 39)
        ground = ~thing & ~uncovered
        assert np.abs(frame.flow[ground]).max() < 1e-4

    def test_ground_flow_is_the_ground_homography(self) -> None:
        source = flight(pitch_deg=50.0, speed_m_s=12.0, turn_deg_s=20.0, climb_m_s=3.0, shake_deg=0.5, zoom_share=0.1)
        frame = source.frame(7)
        rows, columns = np.mgrid[:270, :480]
        back = np.linalg.inv(frame.ground_homography) @ np.stack(
            [columns.ravel(), rows.ravel(), np.ones(columns.size)])
        expected = np.stack([columns, rows], axis=2) - (back[:2] / back[2]).T.reshape(270, 480, 2)
        seen = np.isfinite(frame.flow[..., 0])
        assert seen.mean() > 0.9
        assert np.abs(frame.flow - expected)[seen].max() < 1e-3
        before_x, before_y = columns - expected[..., 0], rows - expected[..., 1]
        inside = (before_x >= 0) & (before_x <= 479) & (before_y >= 0) & (before_y <= 269)
        assert (seen == inside).mean() > 0.9999

    def test_scenery_obeys_the_epipolar_constraint(self) -> None:
        source = flight(pitch_deg=55.0, speed_m_s=15.0, turn_deg_s=15.0, shake_deg=0.3, zoom_share=0.1,
                        ground='town', buildings=60, trees=110, cars=40)
        before, frame = source.frame(4), source.frame(5)
        still = (frame.owner == 0) & np.isfinite(frame.flow[..., 0])
        rows, columns = np.nonzero(still)
        now = np.stack([columns, rows, np.ones(len(rows))], axis=1)
        then = now.copy()
        then[:, :2] -= frame.flow[still]
        x, y, z = frame.translation
        essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ frame.rotation
        lines = then @ (np.linalg.inv(frame.intrinsic).T @ essential @ np.linalg.inv(before.intrinsic)).T
        distance = np.abs((now * lines).sum(axis=1)) / np.hypot(lines[:, 0], lines[:, 1])
        assert distance.max() < 1e-3
        plane = now @ np.linalg.inv(frame.ground_homography).T
        parallax = np.linalg.norm(plane[:, :2] / plane[:, 2:] - then[:, :2], axis=1)
        assert (parallax > 0.5).mean() > 0.02  # houses and trees do stand up

    def test_first_frame_has_no_previous_one(self) -> None:
        frame = flight(speed_m_s=10.0).frame(0)
        assert np.isnan(frame.flow).all()
        assert np.array_equal(frame.ground_homography, np.eye(3))
        assert np.array_equal(frame.rotation, np.eye(3))
        assert not frame.translation.any()


class TestCamera:
    def test_straight_flight_moves_the_ground_by_speed_over_height(self) -> None:
        # 10 m/s at 10 frames/s = 1 m = 7.2 px, the image's top looks along the flight: the ground goes down
        frame = flight(speed_m_s=10.0).frame(3)
        assert frame.ground_homography == pytest.approx(np.array([[1, 0, 0], [0, 1, 7.2], [0, 0, 1]]), abs=1e-9)
        assert frame.translation == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)

    def test_zoom_changes_the_calibration_of_each_frame(self) -> None:
        source = flight(zoom_share=0.2, frames=25)
        assert source.camera.fx == 360.0
        frame = source.frame(22)  # 2.2 s of a 9 s wave
        assert frame.camera.fx == pytest.approx(360 * (1 + 0.2 * math.sin(2 * math.pi * 2.2 / 9)))
        assert frame.intrinsic[0, 0] == frame.camera.fx
        ratio = frame.camera.fx / source.frame(21).camera.fx
        assert frame.ground_homography[0, 0] == pytest.approx(ratio)

    def test_turn_rate(self) -> None:
        source = flight(turn_deg_s=30.0, frames=40)
        frame = source.frame(35)  # a quarter of the 14 s wave: the full rate, 3 degrees a frame
        assert math.degrees(math.acos((np.trace(frame.rotation) - 1) / 2)) == pytest.approx(3.0, abs=0.01)

    def test_descent_begins_at_the_given_rate(self) -> None:
        frame = flight(climb_m_s=2.0).frame(1)
        assert frame.translation == pytest.approx([0.0, 0.0, -0.2], abs=1e-3)

    def test_stamps_follow_the_rate(self) -> None:
        source = flight(fps=30.0, start_stamp_ns=5)
        assert [source.frame(i).stamp_ns for i in (0, 1, 3)] == [5, 33_333_338, 100_000_005]


class TestTimeToContact:
    def test_pure_approach(self) -> None:
        source = SyntheticFlight(dataclasses.replace(FlightConfig.approach(5.0), width=480, height=270, focal_px=360.0))
        for index in (0, 20, 59):
            frame = source.frame(index)
            assert len(frame.truth) == 4
            # 60 m up, cars 1.5 m high: their middle is 0.75 m over the ground
            assert frame.ttc == pytest.approx(np.full(4, (60 - 5 * index / 20 - 0.75) / 5))

    def test_object_and_camera_both_move(self) -> None:
        pitch = math.radians(50)
        coming = ObjectSpec('box', 0.0, 50.0, -90.0, 6.0, 4.0, 2.0, 2.0)
        leaving = dataclasses.replace(coming, x_m=8.0, heading_deg=90.0, speed_m_s=20.0)
        frame = flight(pitch_deg=50.0, speed_m_s=10.0, objects=(coming, leaving)).frame(5)
        ahead = (50 - 6 * 0.5) - 10 * 0.5
        depth = ahead * math.cos(pitch) + (50 - 1) * math.sin(pitch)
        assert frame.ttc[0] == pytest.approx(depth / ((10 + 6) * math.cos(pitch)))
        assert frame.ttc[1] == np.inf

    def test_turning_on_the_spot_is_no_approach(self) -> None:
        frame = flight(pitch_deg=50.0, turn_deg_s=60.0, objects=(ObjectSpec('car', 3.0, 45.0),)).frame(4)
        assert frame.ttc.tolist() == [np.inf]


class TestSingle:
    @pytest.mark.parametrize('direction', [0.0, 90.0, 225.0])
    def test_size_and_speed_are_those_asked_for(self, direction: float) -> None:
        source = SyntheticFlight(FlightConfig.single(24, 2.5, 3.0, direction_deg=direction, frames=21))
        middles = []
        for index in (0, 10, 20):
            box = record(source.frame(index), 1)
            middles.append([box['x'] + (box['w'] - 1) / 2, box['y'] + (box['h'] - 1) / 2])
            assert box['moving'] == 1
            if direction % 90 == 0:
                assert (box['w'], box['h']) == (pytest.approx(24, abs=1.5), pytest.approx(24, abs=1.5))
        turn = math.radians(direction)
        step = np.array([2.5 * math.cos(turn), 2.5 * math.sin(turn) + 3.0])
        assert middles[1] == pytest.approx([479.5, 269.5], abs=1.0)
        assert np.subtract(middles[2], middles[0]) == pytest.approx(20 * step, abs=2.0)

    def test_ground_without_contrast_is_one_grey(self) -> None:
        source = SyntheticFlight(FlightConfig.single(24, 2.5, frames=3, noise_sigma=0.0, ground_contrast=0.0))
        frame = source.frame(1)
        far = np.ones(frame.owner.shape, bool)
        far[230:310, 440:520] = False  # the object and its shadow
        assert np.ptp(frame.image[far], axis=0).max() == 0


class TestConfig:
    def test_range(self) -> None:
        with pytest.raises(ConfigError, match=r'altitude_m: expected 30.0 to 300.0, got 10.0'):
            FlightConfig(altitude_m=10.0)

    def test_type(self) -> None:
        with pytest.raises(ConfigError, match=r"width: expected int, got str '960'"):
            FlightConfig(width='960')  # type: ignore[arg-type]

    def test_choice(self) -> None:
        with pytest.raises(ConfigError, match=r"ground: expected one of town, field, got 'moon'"):
            FlightConfig(ground='moon')

    def test_kind(self) -> None:
        with pytest.raises(ConfigError, match=r"kind expected one of car, person, box, got 'bird'"):
            FlightConfig(objects=(ObjectSpec('bird', 0.0, 0.0),))

    def test_course_into_the_ground(self) -> None:
        with pytest.raises(ConfigError, match=r'flight path: expected at least 15 m over the ground, got 10.5 m'):
            SyntheticFlight(dataclasses.replace(FlightConfig.approach(5.0), frames=199))

    def test_frame_outside_the_flight(self) -> None:
        with pytest.raises(SourceError, match=r'frame 12: expected 0 to 11'):
            flight().frame(12)
