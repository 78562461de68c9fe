"""What the examples did beside the real nodes, against the truth of the flights and numbers worked by hand."""

from __future__ import annotations

import ast
import importlib.util
import math
import re
import subprocess
import sys
from itertools import groupby, pairwise
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from flights import DESCENT, EXAMPLES, GAIN, HORIZON_S, LOST_S, RANGE_M, RUN, TOWN, Flown, truth_rays
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, RegionOfInterest

from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.records import read_detections, records_from_msg
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.types import RecordArray, empty_detections
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.bags import BagReader, BagWriter
from motion_detect_ros.sources.messages import IMAGE, deserialize
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight
from motion_detect_ros.sources.synthetic.camera_path import CameraPath

WIDTH_PX = 960
#: A box is a few pixels off its object: at 720 px focal length 10 px are 0.8 degrees.
AIM_DEG = 1.0
LAST = TOWN.frames - 1


def example(name: str) -> ModuleType:
    """An example as a module; its ``main`` does not run."""
    spec = importlib.util.spec_from_file_location(f'example_{name}', EXAMPLES / f'{name}.py')
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def seen(*objects: dict[str, float]) -> RecordArray:
    """Detections with these fields, ids from 1."""
    records = empty_detections(len(objects))
    records['id'] = range(1, len(objects) + 1)
    for record, fields in zip(records, objects, strict=True):
        for name, value in fields.items():
            record[name] = value
    return records


def angle_deg(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angle between unit vectors, degrees."""
    return np.degrees(np.arccos(np.clip((one * other).sum(axis=-1), -1, 1)))


@pytest.mark.parametrize('name', sorted(path.stem for path in EXAMPLES.glob('*.py')))
def test_every_example_is_run_here(name: str) -> None:
    elsewhere = {'watchdog', 'analyse_flight'}  # test/nodes/test_watchdog.py, test_analyse_flight.py
    assert name in {*RUN, 'vision_boxes', 'read_detections_mcap', *elsewhere}
    assert name in (EXAMPLES / 'README.md').read_text(encoding='utf-8')


@pytest.mark.messages
class TestPlanner:
    """The image is 960 px wide, from edge 0 to edge 960: its middle is 480, the corridor goes from 240 to 720."""

    @pytest.mark.parametrize(('objects', 'suggestion'), [
        ((), 'go'),
        (({'u': 480, 'ttc': 1.0},), 'stop'),
        (({'u': 480, 'ttc': 5.0},), 'go'),
        (({'u': 480, 'ttc': math.nan},), 'go'),
        (({'u': 480, 'ttc': math.inf},), 'go'),
        (({'u': 719.8, 'ttc': 1.0},), 'left'),
        (({'u': 240.2, 'ttc': 1.0},), 'right'),
        (({'u': 720.2, 'ttc': 1.0},), 'go'),
        (({'u': 239.8, 'ttc': 1.0},), 'go'),
        (({'u': 900, 'ttc': 1.0},), 'go'),                                    # beside the corridor, and stays there
        (({'u': 900, 'vel_u': -300, 'ttc': 1.0},), 'left'),                   # will be at 600
        (({'u': 600, 'ttc': 1.0},), 'left'),
        (({'u': 360, 'ttc': 1.0},), 'right'),
        (({'u': 600, 'vel_u': -240, 'ttc': 1.0},), 'right'),                  # on the right, going to the left
        (({'u': 300, 'ttc': 1.0}, {'u': 660, 'ttc': 1.0}), 'stop'),
        (({'u': 300, 'ttc': 1.0}, {'u': 660, 'ttc': 9.0}), 'right'),
        (({'u': 100, 'vel_u': 800, 'ttc': 1.0},), 'left'),                    # crosses the corridor: pass behind it
    ])
    def test_suggestion(self, objects: tuple[dict[str, float], ...], suggestion: str) -> None:
        assert example('planner').suggest(seen(*objects), WIDTH_PX, horizon_s=3.0) == suggestion

    @pytest.mark.parametrize(('roi_px', 'binning', 'width_px'), [
        (0, 0, 1920), (0, 2, 960), (800, 0, 800), (800, 2, 400)])
    def test_the_corridor_is_of_the_images_and_not_of_the_sensor(
        self, roi_px: int, binning: int, width_px: int,
    ) -> None:
        planner = SimpleNamespace(width_px=0)
        info = CameraInfo(width=1920, binning_x=binning, roi=RegionOfInterest(width=roi_px))
        example('planner').Planner.on_camera_info(planner, info)
        assert planner.width_px == width_px

    def test_goes_then_passes_behind_the_square_that_drives_to_the_right(self, flown: dict[str, Flown]) -> None:
        """Its contact is nearer than the horizon from about frame 26 of 45 on; estimates may be 0.3 s off."""
        suggestions = [message.data for message in flown['descent'].answers['avoidance/suggestion']]
        true_ttc_s = np.array([frame.ttc[0] for frame in SyntheticFlight(DESCENT)])
        assert len(suggestions) > DESCENT.frames / 2
        assert set(suggestions[:5]) == {'go'}
        assert set(suggestions[-5:]) == {'left'}
        assert suggestions.count('go') <= (true_ttc_s > HORIZON_S - 0.3).sum()
        assert suggestions.count('left') <= (true_ttc_s < HORIZON_S + 0.3).sum()

    def test_mostly_goes_on_over_the_town(self, flown: dict[str, Flown]) -> None:
        """No true time to contact is under 3.9 s, more than the horizon, but times to contact are estimates."""
        suggestions = [message.data for message in flown['town'].answers['avoidance/suggestion']]
        assert len(suggestions) > TOWN.frames / 2
        assert suggestions.count('go') > 0.7 * len(suggestions)

    def test_tells_how_often_it_suggests_for_nothing(self) -> None:
        """Over the whole built-in flight, two images more or less: another OpenCV may see a little differently."""
        module, flight = example('planner'), SyntheticFlight(FlightConfig())
        lowest_s, preset = re.search(r'no true one is under (\S+) s', module.__doc__), load_preset('default')
        told = re.search(r'(\d+) of the (\d+) images suggest', module.__doc__)
        pipeline, suggestions, true_ttc_s = MotionPipeline(preset), [], []
        for index, frame in enumerate(flight):
            detections = pipeline.process(frame.image, flight.stamp_ns(index)).detections
            suggestions.append(module.suggest(detections, frame.image.shape[1]))
            true_ttc_s += frame.ttc.tolist()
        assert told and lowest_s
        assert len(suggestions) == int(told[2])
        assert len(suggestions) - suggestions.count('go') == pytest.approx(int(told[1]), abs=2)
        assert set(suggestions) <= {'go', 'left', 'right'}
        assert float(lowest_s[1]) < np.nanmin(true_ttc_s) < float(lowest_s[1]) + 0.1


@pytest.mark.messages
class TestFollow:
    def test_target_stays_until_it_is_lost(self) -> None:
        target = example('follow').Target(lost_s=1.0)
        both = seen({'age': 3, 'score': 0.9}, {'age': 7, 'score': 0.5})
        assert target.update(both, 10.0)['id'].tolist() == [2]
        both['age'] = 99, 8
        assert target.update(both, 10.1)['id'].tolist() == [2], 'another is older now'
        assert target.update(both[:1], 10.9)['id'].tolist() == [], 'out of sight'
        assert target.update(both, 11.0)['id'].tolist() == [2], 'back in time'
        assert target.update(both[:1], 12.1)['id'].tolist() == [1], 'gone for more than a second'

    def test_stays_on_one_object_over_the_town(self, flown: dict[str, Flown]) -> None:
        """Another target only where the one before has been out of sight for ``LOST_S``."""
        present = {message.stamp_ns: set(message.records['id'].tolist()) for message in flown['town'].detections}
        targets = {stamp_ns(message.header): read_detections(message)['id'].tolist()
                   for message in flown['town'].answers['follower/target']}
        named = [(stamp, ids[0]) for stamp, ids in sorted(targets.items()) if ids]
        assert len(named) > TOWN.frames / 3
        for (_, before), (now_ns, target) in pairwise(named):
            since_ns = now_ns - LOST_S * 1e9
            visible = [stamp for stamp, ids in present.items() if before in ids and since_ns < stamp < now_ns]
            assert target == before or visible == []
        longest = max(len(list(group)) for _, group in groupby(target for _, target in named))
        assert longest > TOWN.frames / 3

    def test_turns_to_its_target(self, flown: dict[str, Flown]) -> None:
        """By the true camera; left of the axis is a turn to the left, above it a climb, both positive.

        The corner of a box is that of its first pixel, half a pixel before the pixel's centre.
        """
        flight, path, checked = SyntheticFlight(TOWN), CameraPath(TOWN), 0
        commands = {stamp_ns(message.header): message for message in flown['town'].answers['cmd_vel']}
        index_of = {flight.stamp_ns(index): index for index in range(TOWN.frames)}
        for target in flown['town'].answers['follower/target']:
            stamp = stamp_ns(target.header)
            for one in read_detections(target) if stamp in commands else ():
                twist, camera = commands[stamp].twist, path.pose(index_of[stamp]).model(TOWN.width, TOWN.height)
                x, y = (one['u'] - 0.5 - camera.cx) / camera.fx, (one['v'] - 0.5 - camera.cy) / camera.fy
                assert twist.angular.z == pytest.approx(-GAIN * math.atan(x), abs=1e-3)
                assert twist.linear.z == pytest.approx(-GAIN * math.atan(y / math.hypot(x, 1)), abs=1e-3)
                assert commands[stamp].header.frame_id == 'base_link'
                checked += 1
        assert checked > TOWN.frames / 3


def image_frame(bag: Path) -> str:
    """frame_id of the first image."""
    with BagReader(bag) as reader:
        message = next(iter(reader.messages(['/image_raw'])))
    return str(deserialize(message.data, IMAGE).header.frame_id)


def frame_of(flow: Flown, message) -> int:
    return round((stamp_ns(message.header) - flow.config.start_stamp_ns) * flow.config.fps / 1e9)


@pytest.mark.messages
class TestBearingsToPoints:
    def test_points_stand_in_the_true_directions_at_the_assumed_range(self, flown: dict[str, Flown]) -> None:
        dtype = example('bearings_to_points').POINT
        clouds = {frame_of(flown['town'], message): message for message in flown['town'].answers['points']}
        known = {message.stamp_ns: len(message.records) for message in flown['town'].detections}
        assert [len(records_from_msg(message, dtype)) == known[stamp_ns(message.header)] for message in clouds.values()
                ].count(False) == 0, 'a point for each object'
        assert {message.header.frame_id for message in clouds.values()} == {image_frame(flown['town'].bag)}
        hits, aimed = 0, 0
        for index in [frame for frame in (20, 30, 40, 50, LAST) if frame in clouds]:
            points = records_from_msg(clouds[index], dtype)
            places = np.stack([points[axis] for axis in 'xyz'], axis=-1).astype(float)
            np.testing.assert_allclose(np.linalg.norm(places, axis=1), RANGE_M, rtol=1e-5)
            boxes, rays, _ = truth_rays(TOWN, index)
            for ray in rays[boxes['w'] * boxes['h'] > 900]:  # cars; smaller ones are not found every time
                aimed += 1
                hits += bool((angle_deg(places / RANGE_M, ray) < AIM_DEG).any())
        assert aimed > 10
        assert hits / aimed > 0.6

    def test_uncalibrated_camera_gives_no_points(self) -> None:
        assert len(example('bearings_to_points').points_of(seen({'u': 5}), RANGE_M)) == 0


class TestAutopilotFrames:
    def test_optical_to_frd(self) -> None:
        """Ahead, right and below of a level camera; ahead of one that looks straight down is below the body."""
        module = example('autopilot_frames')
        np.testing.assert_allclose(module.optical_to_frd([(0, 0, 1), (1, 0, 0), (0, 1, 0)]), np.eye(3), atol=1e-12)
        np.testing.assert_allclose(module.optical_to_frd([(0, 0, 1), (0, 1, 0)], 90.0), [(0, 0, 1), (-1, 0, 0)],
                                   atol=1e-12)
        half = math.sqrt(0.5)
        np.testing.assert_allclose(module.optical_to_frd([(0, 0, 1)], 45.0), [(half, 0, half)], atol=1e-12)

    @pytest.mark.parametrize(('yaw_deg', 'pitch_deg', 'roll_deg', 'frd', 'ned'), [
        (0, 0, 0, (1, 0, 0), (1, 0, 0)),
        (90, 0, 0, (1, 0, 0), (0, 1, 0)),      # nose to the east
        (90, 0, 0, (0, 1, 0), (-1, 0, 0)),     # its right is south
        (0, 90, 0, (1, 0, 0), (0, 0, -1)),     # nose up
        (0, 0, 90, (0, 1, 0), (0, 0, 1)),      # right wing down
    ])
    def test_frd_to_ned(self, yaw_deg, pitch_deg, roll_deg, frd, ned) -> None:
        """The angles as on a compass and an artificial horizon; the quaternion is SciPy's."""
        attitude = Rotation.from_euler('ZYX', [yaw_deg, pitch_deg, roll_deg], degrees=True)
        x, y, z, w = attitude.as_quat()
        np.testing.assert_allclose(example('autopilot_frames').frd_to_ned([frd], (w, x, y, z)), [ned], atol=1e-12)

    def test_both_conventions_agree(self) -> None:
        """ENU <- FLU is NED <- FRD between the two constant exchanges of axes, for any attitude (REP 103, 147)."""
        module = example('autopilot_frames')
        ned_of_enu = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
        flu_of_frd = np.diag([1, -1, -1])
        rays = np.random.default_rng(1).normal(size=(20, 3))
        for attitude in Rotation.random(20, random_state=2):
            x, y, z, w = attitude.as_quat()
            u, v, t, s = Rotation.from_matrix(ned_of_enu.T @ attitude.as_matrix() @ flu_of_frd).as_quat()
            np.testing.assert_allclose(
                module.frd_to_ned_by_ros(rays, (s, u, v, t)), module.frd_to_ned(rays, (w, x, y, z)), atol=1e-12)

    def test_attitudes_that_are_none_are_not_kept(self) -> None:
        """sensor_msgs/Imu: -1 as first element of a covariance says that there is no estimate, as of an IMU alone."""
        from sensor_msgs.msg import Imu
        node = SimpleNamespace(attitudes=[])
        for first in (-1.0, 0.0):
            message = Imu(orientation_covariance=[first] + [0.0] * 8)
            message.header.stamp.sec = int(first) + 5
            example('autopilot_frames').AutopilotFrames.on_imu(node, message)
        assert node.attitudes == [(5.0, (1.0, 0.0, 0.0, 0.0))]

    def test_why_there_is_no_attitude(self) -> None:
        attitude_at = example('autopilot_frames').attitude_at
        old, new = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)
        assert attitude_at([(5.0, old), (5.2, new)], 5.14) == (new, '')
        assert attitude_at([], 5.0) == (None, 'no attitude on imu/data so far')
        assert attitude_at([(5.0, old), (5.2, new)], 5.5) == (
            None, 'no attitude within 0.1 s of the image: the nearest is 0.3 s away')

    def test_sectors_go_clockwise_from_the_nose(self) -> None:
        rays = np.array([(1, 0, 0), (0, 1, 0), (math.cos(0.3), -math.sin(0.3), 0)])  # ahead, right, 17 degrees left
        ranges = example('autopilot_frames').sectors_of(rays, 4.0)
        assert np.flatnonzero(np.isfinite(ranges)).tolist() == [0, 18, 69]
        assert set(ranges[[0, 18, 69]]) == {4.0}

    def test_sectors_hold_horizontal_distances(self) -> None:
        sectors_of, down = example('autopilot_frames').sectors_of, math.sqrt(0.5)
        assert not np.isfinite(sectors_of(np.array([(0.0, 0.0, 1.0)]), 4.0)).any(), 'below the vehicle, beside no path'
        ranges = sectors_of(np.array([(0.0, down, down), (0.0, 1.0, 0.0), (-0.8, 0.0, 0.6)]), 4.0)
        assert np.flatnonzero(np.isfinite(ranges)).tolist() == [18, 36]
        assert ranges[[18, 36]] == pytest.approx([4.0 * down, 3.2]), 'of two the nearer'

    @pytest.mark.messages
    def test_points_at_the_true_objects_in_the_world(self, flown: dict[str, Flown]) -> None:
        """The truth comes from the scene: pixel and true pose of the camera, no attitude, no body frame."""
        dtype, hits, aimed = example('autopilot_frames').NED, 0, 0
        for message in flown['town'].answers['autopilot_frames/bearings_ned']:
            index = frame_of(flown['town'], message)
            if index < 20 or index % 10:
                continue
            records = records_from_msg(message, dtype)
            found = np.stack([records[axis] for axis in ('north', 'east', 'down')], axis=-1)
            boxes, _, world = truth_rays(TOWN, index)
            east, north, up = world.T
            for ray in np.stack([north, east, -up], axis=-1)[boxes['w'] * boxes['h'] > 900]:
                aimed += 1
                hits += bool((angle_deg(found, ray) < AIM_DEG).any())
        assert aimed > 5
        assert hits / aimed > 0.6

    @pytest.mark.messages
    def test_scan_marks_the_sectors_of_the_objects_only(self, flown: dict[str, Flown]) -> None:
        scans = flown['town'].answers['obstacles']
        counts = {message.stamp_ns: len(message.records) for message in flown['town'].detections}
        assert len(scans) > TOWN.frames / 2
        for scan in scans:
            known = np.isfinite(scan.ranges)
            assert len(scan.ranges) == 72
            assert scan.header.frame_id == 'base_link_frd'
            near, far = RANGE_M * math.cos(math.radians(60)), RANGE_M
            assert all(near < each <= far for each in np.array(scan.ranges)[known])
            assert (known.sum() > 0) == (counts[stamp_ns(scan.header)] > 0)


@pytest.mark.messages
class TestReadDetectionsMcap:
    def test_prints_what_the_csv_of_the_replay_holds(self, flown: dict[str, Flown], tmp_path: Path) -> None:
        replay = [sys.executable, '-m', 'motion_detect_ros', 'replay', flown['town'].bag, '-o', tmp_path]
        subprocess.run(replay, check=True, capture_output=True, timeout=600)
        printed = subprocess.run(
            [sys.executable, EXAMPLES / 'read_detections_mcap.py', tmp_path / 'detections.mcap'], check=True,
            capture_output=True, text=True, timeout=600).stdout.splitlines()
        header, *rows = [line.split(',') for line in (tmp_path / 'detections.csv').read_text().splitlines()]
        columns = [header.index(name) for name in printed[0].split(',')]
        assert len(rows) > 100
        assert len(printed) == len(rows) + 1
        for line, row in zip(printed[1:], rows, strict=True):
            stamp, ident, *numbers = line.split(',')
            assert [stamp, ident] == [row[column] for column in columns[:2]]
            np.testing.assert_allclose([float(n) for n in numbers], [float(row[c]) for c in columns[2:]], atol=0.0051)

    def test_a_reader_that_goes_ends_it_quietly(self, tmp_path: Path) -> None:
        with BagWriter(tmp_path / 'detections.mcap') as bag:
            for index in range(20):
                bag.write_detections(empty_detections(400), index * 40_000_000, 'detections', 'camera')
        with subprocess.Popen([sys.executable, EXAMPLES / 'read_detections_mcap.py', tmp_path / 'detections.mcap'],
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None and process.stderr is not None
            assert process.stdout.readline().startswith('stamp_ns,')
            process.stdout.close()
            assert process.stderr.read() == ''
            assert process.wait(600) == 0

    def test_needs_neither_ros_nor_the_package(self) -> None:
        tree = ast.parse((EXAMPLES / 'read_detections_mcap.py').read_text(encoding='utf-8'))
        names = {alias.name if isinstance(node, ast.Import) else node.module for node in ast.walk(tree)
                 if isinstance(node, ast.Import | ast.ImportFrom) for alias in node.names}
        assert {name.split('.')[0] for name in names} - sys.stdlib_module_names == {'numpy', 'rosbags'}


class TestVisionBoxes:
    def test_lines(self) -> None:
        """Fields as vision_msgs 4 (Jazzy) defines them: center is a vision_msgs/Pose2D with a Point2D in it."""
        centre = SimpleNamespace(position=SimpleNamespace(x=12.0, y=34.5), theta=0.0)
        result = SimpleNamespace(hypothesis=SimpleNamespace(class_id='moving', score=0.875))
        box = SimpleNamespace(center=centre, size_x=20.0, size_y=10.0)
        message = SimpleNamespace(detections=[SimpleNamespace(id='7', results=[result], bbox=box)])
        assert list(example('vision_boxes').lines_of(message)) == ['7: moving 0.88 at (12.0, 34.5), 20.0 x 10.0 px']

    def test_lines_of_real_messages(self) -> None:
        pytest.importorskip('vision_msgs', reason='vision_msgs is not installed: its wheels do not exist')
        from std_msgs.msg import Header

        from motion_detect_ros.bridge.topics import _as_boxes, _vision_messages
        message = _as_boxes(_vision_messages(), seen({'u': 12, 'v': 34.5, 'width': 20, 'height': 10, 'score': 0.75}),
                            Header())
        assert list(example('vision_boxes').lines_of(message)) == ['1: moving 0.75 at (12.0, 34.5), 20.0 x 10.0 px']
