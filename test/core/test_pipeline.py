"""The whole detector, and flow and evidence, on rendered scenes with exact truth."""

from __future__ import annotations

import itertools
import subprocess
import sys
import threading
import time
from collections import deque

import cv2
import numpy as np
import pytest

from motion_detect_ros.core import deferred
from motion_detect_ros.core.background.selection import BackgroundSelector
from motion_detect_ros.core.clustering_stage import ClusteringStage
from motion_detect_ros.core.config import PipelineConfig, PreprocessingConfig, TracksConfig
from motion_detect_ros.core.detection.detector import MotionDetector
from motion_detect_ros.core.detection.image_pair import ImagePair
from motion_detect_ros.core.detection.photometric import Place, photometric_tests_apart
from motion_detect_ros.core.ego_motion import feature_based
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage, no_estimate
from motion_detect_ros.core.errors import ConfigError, FrameError
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.geometry.frame_history import FrameHistory
from motion_detect_ros.core.optical_flow.conversion import residual_flow
from motion_detect_ros.core.optical_flow.stage import OpticalFlowStage
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.settings import settings, with_settings
from motion_detect_ros.core.threads import limited
from motion_detect_ros.core.tracking.tracker import Tracker
from motion_detect_ros.core.trajectories.finder import TrajectoryFinder
from motion_detect_ros.core.trajectories.follower import PointFollower
from motion_detect_ros.core.trajectories.point_evidence import PointEvidence
from motion_detect_ros.core.types import CameraModel, EgoMotion, EgoStatus
from motion_detect_ros.presets import load_preset

PERIOD_NS = 40_000_000
SIDE, SPEED, PAN = 48, 4, 3


def texture(seed: int, height: int, width: int, sigma: float = 1.5) -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(height, width)), (0, 0), sigma)
    return cv2.normalize(noise, None, 20, 235, cv2.NORM_MINMAX).astype(np.uint8)


GROUND, THING = texture(1, 360, 800), texture(2, SIDE, SIDE)


def scene(index: int, thing: bool = True) -> np.ndarray:
    """The camera pans 3 px a frame, a textured square crosses the picture at 4 px a frame."""
    picture = GROUND[:, PAN * index:PAN * index + 480].copy()
    if thing:
        left, top = box_of(index)
        picture[top:top + SIDE, left:left + SIDE] = THING
    return picture


def box_of(index: int) -> tuple[int, int]:
    return 60 + SPEED * index, 150


def run(frames, config=None):
    pipeline = MotionPipeline(config)
    return [pipeline.process(image, (index + 1) * PERIOD_NS) for index, image in enumerate(frames)]


def iou(record, index: int) -> float:
    left, top = box_of(index)
    x0, y0 = record['u'] - record['width'] / 2 + 0.0, record['v'] - record['height'] / 2
    w = min(x0 + record['width'], left + SIDE) - max(x0, left)
    h = min(y0 + record['height'], top + SIDE) - max(y0, top)
    inter = max(w, 0) * max(h, 0)
    return inter / (record['width'] * record['height'] + SIDE * SIDE - inter)


def test_the_mover_is_found_and_nothing_else():
    results = run([scene(index) for index in range(30)])
    late = results[8:]
    assert [len(result.detections) for result in late] == [1] * len(late)
    overlaps = [iou(result.detections[0], index) for index, result in enumerate(results) if index >= 8]
    assert np.mean(np.array(overlaps) >= 0.5) >= 0.95
    velocity = late[-1].detections[0]
    # 4 px a frame in the picture while the ground goes 3 px the other way: 7 px in 0.04 s
    assert velocity['vel_u'] == pytest.approx(175.0, rel=0.1)
    assert abs(velocity['vel_v']) < 10.0


def test_between_two_flows_the_mover_is_reported_where_it_is():
    config = with_settings(PipelineConfig(), {'optical_flow.every_s': 0.12})
    results = run([scene(index) for index in range(30)], config)
    measured = [index for index, result in enumerate(results) if np.isfinite(result.flow.flow).any()]
    assert measured == [1, 2, 3, *range(4, 30, 3)]
    late = [(index, result.detections) for index, result in enumerate(results) if index >= 10]
    assert all(len(found) == 1 for _, found in late)
    assert min(iou(found[0], index) for index, found in late) >= 0.5
    assert {int(found[0]['id']) for _, found in late} == {1}
    assert late[-1][1][0]['vel_u'] == pytest.approx(175.0, rel=0.1)


@pytest.mark.parametrize('cut', [None, 15])
def test_a_mover_is_reported_in_the_third_frame_with_motion_though_flow_is_rare(cut):
    """At the start, and after a gap in the stamps."""
    config = with_settings(PipelineConfig(), {'optical_flow.every_s': 0.12, 'tracks.confirm_s': 0.08})
    pipeline, first = MotionPipeline(config), None
    for index in range(24):
        gap_ns = 0 if cut is None or index < cut else 10 ** 10
        result = pipeline.process(scene(index), (index + 1) * PERIOD_NS + gap_ns)
        if index >= (cut or 0) and first is None and len(result.detections):
            first = index
    assert first == (cut or 0) + 2


def watch_detectors(monkeypatch, before):
    """``before()`` is called in the thread that looks for objects in a flow; points find nothing."""
    monkeypatch.setattr(TrajectoryFinder, 'candidates', lambda *_: [])
    monkeypatch.setattr(PointEvidence, 'without_standing', lambda _, found: found)
    monkeypatch.setattr(PointEvidence, 'without_shadows', lambda _, found: found)
    candidates = MotionDetector.candidates
    monkeypatch.setattr(MotionDetector, 'candidates', lambda *given: (before(), candidates(*given))[1])


def test_what_is_found_behind_the_answer_is_reported_where_it_is_by_then(monkeypatch):
    monkeypatch.setattr(deferred, 'threads', lambda: 2)
    behind = []
    watch_detectors(monkeypatch, lambda: behind.append(threading.current_thread() is not threading.main_thread()))
    late = run([scene(index) for index in range(40)], load_preset('visdrone'))[12:]
    assert behind.count(True) >= 8
    assert [len(result.detections) for result in late] == [1] * len(late)
    assert min(iou(result.detections[0], index) for index, result in enumerate(late, 12)) >= 0.5
    assert {int(result.detections[0]['id']) for result in late} == {1}
    assert late[-1].detections[0]['vel_u'] == pytest.approx(175.0, rel=0.1)


@pytest.mark.parametrize('part', ['flow', 'objects'])
def test_no_answer_waits_for_a_flow_and_its_objects_but_at_the_start_and_at_low_rates(monkeypatch, part):
    monkeypatch.setattr(deferred, 'threads', lambda: 2)
    may_go_on, waited, at_once = threading.Event(), [], []

    def before():
        own = threading.current_thread() is threading.main_thread()
        (at_once if own else waited).append(own or may_go_on.wait(60.0))

    if part == 'objects':
        watch_detectors(monkeypatch, before)
    else:
        between = OpticalFlowStage._between
        monkeypatch.setattr(OpticalFlowStage, '_between', lambda *given: (before(), between(*given))[1])
    pipeline = MotionPipeline(load_preset('visdrone'))
    for index in range(30):
        may_go_on.set()  # what the last frame has left over must end for this one
        pipeline.wait()
        may_go_on.clear()
        pipeline.process(scene(index), (index + 1) * PERIOD_NS)
    may_go_on.set()
    pipeline.reset()
    assert len(at_once) >= 1
    assert len(waited) >= 6
    assert all(waited), 'process() waited for the thread'
    waited.clear()
    for index in range(12):
        pipeline.process(scene(index), (index + 1) * 2 * PERIOD_NS)
    assert not waited


@pytest.mark.parametrize('threads', [1, 2])
def test_a_flow_of_which_nothing_is_known_is_as_if_there_were_none(monkeypatch, threads):
    """However late that is found out; the objects of the one before are carried on."""
    calls, between = [0], OpticalFlowStage._between

    def blind(self, reference, frame, ego):
        calls[0] += frame.stamp_ns > 15 * PERIOD_NS
        shift = between(self, reference, frame, ego)
        return np.full_like(shift, np.nan) if frame.stamp_ns > 15 * PERIOD_NS else shift

    watch_detectors(monkeypatch, lambda: None)
    monkeypatch.setattr(OpticalFlowStage, '_between', blind)
    with limited(threads):
        results = run([scene(index) for index in range(21)], load_preset('visdrone'))
        assert calls[0] >= 2
    assert [len(result.detections) for result in results[12:]] == [1] * 9


@pytest.mark.parametrize(('preset', 'threads'), [('default', 2), ('default', 1), ('visdrone', 1)])
def test_the_time_of_a_flow_that_the_answer_waits_for_is_the_flow_s_and_not_the_clustering_s(
    monkeypatch, preset, threads,
):
    between, pipeline, times, slept = OpticalFlowStage._between, MotionPipeline(load_preset(preset)), [], set[int]()
    took_ms = []

    def sleepy(self, reference, frame, ego):
        slept.add(frame.stamp_ns)
        time.sleep(0.2)
        return between(self, reference, frame, ego)

    with limited(threads):
        run([scene(index) for index in range(24)], load_preset(preset))  # kernels are compiled by then
        monkeypatch.setattr(OpticalFlowStage, '_between', sleepy)
        for index in range(24):
            began = time.perf_counter()
            times.append(pipeline.process(scene(index), (index + 1) * PERIOD_NS).times_ms)
            took_ms.append(1e3 * (time.perf_counter() - began))
    slow = [index for index in range(12, 24) if times[index].optical_flow >= 200.0]
    assert len(slow) >= (4 if preset == 'visdrone' else 12)
    assert slow == [index for index in range(12, 24) if (index + 1) * PERIOD_NS in slept]
    # nothing is counted twice, however busy the machine is
    assert all(each.optical_flow + each.clustering <= all_ms for each, all_ms in zip(times, took_ms, strict=True))


def test_with_one_thread_the_features_of_a_frame_are_in_its_time(monkeypatch):
    """Or else a robot with one core would not notice that it has too much to do."""
    find = feature_based.find_features
    monkeypatch.setattr(feature_based, 'find_features', lambda *given: (time.sleep(0.2), find(*given))[1])
    with limited(1):
        times = [each.times_ms.ego_motion for each in run([scene(index) for index in range(5)])]
    assert min(times[1:]) >= 200.0


def test_a_first_half_for_another_thread_brings_its_flow_along():
    pipeline = MotionPipeline()
    assert [pipeline.measure(scene(index), (index + 1) * PERIOD_NS).flow.pending for index in range(3)] == [False] * 3


@pytest.mark.parametrize('threads', [1, 2])
def test_the_calibration_of_a_flow_is_that_of_its_frame(monkeypatch, threads):
    """However late its objects are looked for."""
    seen, fit = [], BackgroundSelector.fit
    monkeypatch.setattr(BackgroundSelector, 'fit', lambda self, flow, residual, camera, dt_s: (
        seen.append(camera.fx), fit(self, flow, residual, camera, dt_s))[1])
    pipeline, expected = MotionPipeline(load_preset('visdrone')), []
    with limited(threads):
        for index in range(30):
            focal_px = 300.0 + index
            pipeline.use_camera(CameraModel(480, 360, focal_px, focal_px, 240.0, 180.0))
            result = pipeline.process(scene(index), (index + 1) * PERIOD_NS)
            expected += [focal_px] * bool(np.isfinite(result.flow.flow).any())
            if threads == 2:
                pipeline.use_camera(CameraModel(480, 360, 9.0, 9.0, 240.0, 180.0))
        pipeline.wait()
    assert len(seen) >= 10
    assert seen == expected


@pytest.mark.parametrize('threads', [1, 2])
@pytest.mark.parametrize(
    'broken', [(ClusteringStage, '_found'), (PointFollower, '_go_on'), (TrajectoryFinder, '_look')],
    ids=['flow', 'points', 'objects'])
def test_a_frame_is_what_an_error_behind_the_answer_before_it_costs(monkeypatch, threads, broken):
    """The object is found again, by the same detector, while the camera pans."""
    ground, (place, name) = texture(1, 360, 1040), broken
    whole, failing = getattr(place, name), [False]

    def sometimes(self, *given):
        if failing[0]:
            raise RuntimeError('broken')
        return whole(self, *given)

    monkeypatch.setattr(place, name, sometimes)
    lost, ids, pipeline = [], [], MotionPipeline(load_preset('visdrone'))
    with limited(threads):
        for index in range(45):
            failing[0] = 25 <= index < 28  # there is one of each in any three frames
            picture = ground[:, 12 * index:12 * index + 480].copy()
            picture[150:150 + SIDE, 30 + 4 * index:30 + 4 * index + SIDE] = THING
            try:
                ids.append(pipeline.process(picture, (index + 1) * PERIOD_NS).detections['id'].tolist())
            except RuntimeError:
                lost.append(index)
            pipeline.wait()
    assert 1 <= len(lost) <= 2
    assert all(24 <= index <= 28 for index in lost)
    assert [len(each) for each in ids[-4:]] == [1] * 4


def test_a_mover_that_is_gone_is_not_carried_past_the_next_flow():
    config = with_settings(PipelineConfig(), {'optical_flow.every_s': 0.12, 'tracks.coast_s': 0.0})
    results = run([scene(index, index < 20) for index in range(30)], config)
    assert len(results[19].detections) == 1
    assert [len(result.detections) for result in results[23:]] == [0] * 7


def behind_a_lossy_link(config, frames, lost=None):
    """What the last stage finds in each frame but the one that gets lost before it. frames: (picture, stamp, ns)."""
    prepare, egos, flows = Preprocessor(config.preprocessing), EgoMotionStage(config), OpticalFlowStage(config)
    clustering, found = ClusteringStage(config), {}
    upstream, history = (FrameHistory(config.optical_flow.baseline_s) for _ in range(2))
    for index, (image, stamp_ns) in enumerate(frames):
        frame = prepare.process(image, stamp_ns)
        ego = egos.process(frame)
        flow = flows.process(frame, ego, upstream.step(frame, ego))
        if index != lost:
            found[index] = clustering.process(frame, ego, history.step(frame, ego), flow)
    return found


def test_objects_of_the_last_flow_are_not_carried_over_a_frame_whose_motion_is_unknown(monkeypatch):
    offered, step = [], Tracker.step
    monkeypatch.setattr(Tracker, 'step', lambda self, candidates, *rest: (
        offered.append(len(candidates)), step(self, candidates, *rest))[1])
    config = with_settings(PipelineConfig(), {'optical_flow.every_s': 0.12})
    frames = [(scene(index), (index + 1) * PERIOD_NS) for index in range(24)]
    behind_a_lossy_link(config, frames)
    assert offered[-6:] == [1] * 6
    offered.clear()
    found = behind_a_lossy_link(config, frames, lost=19)  # where flow was due; next in 22; 20 has no reference frame
    assert offered[-4:] == [1, 0, 1, 1]
    assert found[18]['id'].tolist() == found[22]['id'].tolist() == [1]


@pytest.mark.parametrize('preset', ['default', 'visdrone', 'kitti'])
@pytest.mark.parametrize('damaged', [[20], [20, 21]], ids=['one', 'two'])
def test_the_mover_is_found_in_the_first_picture_after_damaged_ones(preset: str, damaged: list[int]):
    pictures = [np.full_like(GROUND[:, :480], 128) if index in damaged else scene(index) for index in range(28)]
    config = with_settings(load_preset(preset), {'preprocessing.min_width_px': 0})  # 7 px a frame, 21 over a gap
    found = [result.detections for result in run(pictures, config)]
    for index in [19, *range(damaged[-1] + 1, 28)]:
        assert found[index]['id'].tolist() == found[19]['id'].tolist(), index
        assert iou(found[index][0], index) > 0.4, index
    assert all(len(found[index]) == 0 for index in damaged)


@pytest.mark.parametrize('preset', ['visdrone', 'kitti'])
def test_boxes_and_velocities_are_those_of_the_image_however_large_it_is_worked_on(preset: str):
    """480 px wide, worked on at 960; the square goes 4 px a frame in a picture that goes 3 px the other way."""
    pipeline = MotionPipeline(load_preset(preset))
    for index in range(26):
        result = pipeline.process(scene(index), (index + 1) * PERIOD_NS)
        pipeline.wait()
        np.testing.assert_allclose(result.ego.matrix[:2, 2], [-PAN, 0.0] if index else 0.0, atol=0.3)
    assert len(result.detections) == 1
    found = result.detections[0]
    assert iou(found, 25) > 0.6
    assert [found['vel_u'], found['vel_v']] == pytest.approx([7 / 0.04, 0.0], abs=15.0)


def test_a_live_change_of_a_threshold_leaves_the_rhythm_of_the_flow():
    pipeline = MotionPipeline(with_settings(PipelineConfig(), {'optical_flow.every_s': 0.12}))
    measured = []
    for index in range(9):
        result = pipeline.process(scene(index), (index + 1) * PERIOD_NS)
        if np.isfinite(result.flow.flow).any():
            measured.append(index)
        pipeline.use_config(with_settings(pipeline.config, {'art2.vigilance': 0.9 + index / 1000}))
    assert measured == [1, 2, 3, 4, 7]


def test_a_still_world_gives_nothing():
    assert sum(len(result.detections) for result in run([scene(index, False) for index in range(25)])) == 0


def test_a_refused_frame_leaves_no_trace():
    frames = [scene(index) for index in range(15)]
    clean = run(frames)
    pipeline, after = MotionPipeline(), []
    for index, image in enumerate(frames):
        if index == 7:
            with pytest.raises(FrameError, match='expected a uint8 array, got float64'):
                pipeline.process(image.astype(float), (index + 1) * PERIOD_NS)
        after.append(pipeline.process(image, (index + 1) * PERIOD_NS))
    assert [r.detections.tobytes() for r in after] == [r.detections.tobytes() for r in clean]


@pytest.mark.parametrize(('preset', 'count'), [('default', 12), ('visdrone', 30)])
def test_same_frames_same_bytes_with_any_number_of_threads(preset, count):
    frames = [scene(index) for index in range(count)]
    answers = []
    for threads in (1, 2, 4):
        with limited(threads):
            answers.append([(r.detections.tobytes(), r.flow.flow.tobytes(), r.ego.matrix.tobytes())
                            for r in run(frames, load_preset(preset))])
    assert answers[0] == answers[1] == answers[2]


@pytest.mark.parametrize('threads', [1, 2])
@pytest.mark.parametrize(('preset', 'count'), [('default', 12), ('visdrone', 30)])
def test_same_bytes_where_parts_are_done_some_frames_ahead(preset, count, threads):
    """Flow and points of three frames before the objects of the first of them are looked for."""
    config, frames = load_preset(preset), [scene(index) for index in range(count)]
    with limited(threads):
        expected = [(each.detections.tobytes(), each.flow.flow.tobytes()) for each in run(frames, config)]
        pipeline, waiting, got = MotionPipeline(config), deque(), []
        for index in range(count + 2):
            if index < count:
                measured = pipeline.measure(frames[index], (index + 1) * PERIOD_NS, later=True)
                waiting.append(pipeline.follow(pipeline.settle(measured)))
            if index >= 2:
                result = pipeline.detect(waiting.popleft())
                got.append((result.detections.tobytes(), result.flow.flow.tobytes()))
    assert got == expected
    assert sum(len(detections) for detections, _ in got) > 0


def test_times_are_those_of_the_clock_that_was_given():
    """One second from one look at it to the next."""
    seconds = itertools.count()
    pipeline = MotionPipeline(clock=lambda: float(next(seconds)))
    with limited(2):
        times = pipeline.process(scene(0), PERIOD_NS).times_ms
        assert (times.preprocessing, times.ego_motion, times.optical_flow, times.clustering) == (1e3, 1e3, 1e3, 1e3)
        ahead = pipeline.follow(pipeline.settle(pipeline.measure(scene(1), 2 * PERIOD_NS)))
        assert ahead.times_ms.optical_flow == 2000.0
        assert pipeline.detect(ahead).times_ms.clustering == 2000.0
        times = pipeline.process(scene(2), 3 * PERIOD_NS).times_ms  # its flow is computed within the clustering
        assert (times.optical_flow, times.clustering) == (2000.0, 2000.0)


def test_reset_starts_anew_but_ids_go_on():
    pipeline = MotionPipeline()
    first = [pipeline.process(scene(index), (index + 1) * PERIOD_NS) for index in range(12)]
    pipeline.reset()
    second = [pipeline.process(scene(index), (index + 1) * PERIOD_NS) for index in range(12)]
    assert second[0].ego.status == EgoStatus.FIRST_FRAME
    ids = [{int(number) for r in results for number in r.detections['id']} for results in (first, second)]
    assert ids[0] and ids[1] and not ids[0] & ids[1]


def test_input_is_not_changed():
    image = cv2.cvtColor(scene(3), cv2.COLOR_GRAY2BGR)
    copy = image.copy()
    MotionPipeline().process(image, PERIOD_NS)
    np.testing.assert_array_equal(image, copy)


def test_a_buffer_that_the_caller_fills_anew_is_as_good_as_fresh_pictures():
    buffer, pipeline, found = np.empty((360, 480), np.uint8), MotionPipeline(), []
    for index in range(12):
        buffer[:] = scene(index)
        found.append(pipeline.process(buffer, (index + 1) * PERIOD_NS))
    fresh = run([scene(index) for index in range(12)])
    assert [r.detections.tobytes() for r in found] == [r.detections.tobytes() for r in fresh]
    np.testing.assert_array_equal(found[-1].ego.matrix, fresh[-1].ego.matrix)


def test_bearings_are_those_of_the_picture_whatever_size_was_calibrated():
    calibrations = [CameraModel(480, 360, 400.0, 400.0, 239.5, 179.5),
                    CameraModel(960, 720, 800.0, 800.0, 479.5, 359.5),
                    CameraModel(0, 0, 400.0, 400.0, 239.5, 179.5)]
    rays = []
    for camera in calibrations:
        pipeline = MotionPipeline(camera=camera)
        for index in range(12):
            records = pipeline.process(scene(index), (index + 1) * PERIOD_NS).detections
        x = (records[0]['u'] - 240.0) / 400.0  # the middle of the picture, from its edge
        assert records[0]['bearing_x'] / records[0]['bearing_z'] == pytest.approx(x, abs=1e-5)
        rays.append([records[0][f'bearing_{axis}'] for axis in 'xyz'])
    np.testing.assert_allclose(rays[1:], [rays[0], rays[0]], atol=1e-5)


@pytest.mark.parametrize('jump', ['clock', 'size'])
def test_tracks_end_at_a_jump_whose_own_frame_never_came(jump):
    """As behind an overloaded node: the frame whose status tells of the jump is the one that got lost."""
    frames = []
    for index in range(24):
        late, image = index >= 12, scene(index)
        frames.append((image[:300, :400].copy() if late and jump == 'size' else image,
                       (index + 1 - (12 if late and jump == 'clock' else 0)) * PERIOD_NS))
    found = behind_a_lossy_link(PipelineConfig(), frames, lost=12)
    before, after = ({int(each) for index, records in found.items() if (index < 12) == early for each in records['id']}
                     for early in (True, False))
    assert before and after and not before & after


def test_a_long_time_before_a_track_is_reported_does_not_lengthen_the_warm_up():
    tracks = TracksConfig(confirm_s=50.0, confirm_window_s=60.0)
    warm_up(PipelineConfig(tracks=tracks, preprocessing=PreprocessingConfig(max_width_px=320)))


def test_a_width_that_no_camera_has_does_not_lengthen_the_warm_up(monkeypatch):
    """Kernels are the same for pictures of any size."""
    widths, real = [], MotionPipeline.measure
    monkeypatch.setattr(MotionPipeline, 'measure',
                        lambda self, image, stamp_ns: widths.append(image.shape[1]) or real(self, image, stamp_ns))
    warm_up(PipelineConfig(preprocessing=PreprocessingConfig(max_width_px=8192)))
    assert widths and max(widths) <= 1920


FIRST_HALF = """
import numpy as np
from motion_detect_ros.core.clustering import art2
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from numba.core.dispatcher import Dispatcher
import gc
def ready():
    return {each.__qualname__ + str(kind) for each in gc.get_objects() if isinstance(each, Dispatcher)
            for kind in each.signatures}
warm_up(PipelineConfig(), detection=False)
warm, pipeline = ready(), MotionPipeline()
ground = np.random.default_rng(3).integers(0, 255, (400, 640), np.uint8)
for index in range(5):
    pipeline.measure(ground[:360, 3 * index:3 * index + 600], (index + 1) * 40_000_000)
assert warm and ready() == warm, ready() ^ warm
assert not art2._compete.signatures
warm_up(PipelineConfig())
assert art2._compete.signatures and len(ready()) > 3 * len(warm), (len(ready()), len(warm))
"""


def test_the_stages_before_the_clustering_load_no_kernels_of_it():
    """In a process of its own, as other tests have loaded them here."""
    done = subprocess.run([sys.executable, '-c', FIRST_HALF], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr


LATE = """
import sys
from numba.core import event
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight
class Noted(event.Listener):
    def on_start(self, begun):
        print(begun.data['dispatcher'])
    def on_end(self, _):
        pass
config = load_preset(sys.argv[1])
frames = list(SyntheticFlight(FlightConfig(width=640, height=360, focal_px=480.0, frames=45, fps=25.0)))
warm_up(config)
event.register('numba:compile', Noted())
pipeline, found = MotionPipeline(config), 0
for frame in frames:
    found += len(pipeline.process(frame.image, frame.stamp_ns).detections)
assert found > 20, found
"""


@pytest.mark.parametrize('preset', ['default', 'visdrone'])
def test_all_kernels_are_ready_after_the_warm_up(preset):
    """In a process of its own, as other tests have loaded them here. What comes late stops one for a second."""
    words = [sys.executable, '-c', LATE, preset]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stdout) == (0, ''), done.stderr


def test_of_frames_whose_times_come_again_the_new_ones_are_kept():
    """A recording of 18 frames plays in a loop, one is lost in the first round, and the reference is 16 frames back."""
    config, history, found = PipelineConfig(), FrameHistory(0.64), []
    prepare = Preprocessor(config.preprocessing)
    picture = GROUND[:, :480].copy()
    for number in (each for round_number in range(3) for each in range(18) if (round_number, each) != (0, 5)):
        stamp_ns = (number + 1) * PERIOD_NS
        status = EgoStatus.OK if found and number else EgoStatus.TIME_JUMP
        ego = (EgoMotion(np.eye(3), np.eye(6), status, stamp_ns, stamp_ns - PERIOD_NS) if status == EgoStatus.OK
               else no_estimate(status, stamp_ns, stamp_ns))
        found.append(history.step(prepare.process(picture, stamp_ns), ego) is not None)
    assert found[-17:] == [True] * 17 and found[-35:-18] == [True] * 17


class TestFlow:
    def between(self, matrix: np.ndarray, current: np.ndarray, earlier: np.ndarray):
        config = PipelineConfig()
        stage, prepare = OpticalFlowStage(config), Preprocessor(config.preprocessing)
        history = FrameHistory(config.optical_flow.baseline_s)
        history.step(prepare.process(earlier, PERIOD_NS), no_estimate(EgoStatus.FIRST_FRAME, PERIOD_NS, PERIOD_NS))
        ego = EgoMotion(matrix, np.eye(6), EgoStatus.OK, 2 * PERIOD_NS, PERIOD_NS)
        frame = prepare.process(current, 2 * PERIOD_NS)
        return stage.process(frame, ego, history.step(frame, ego)).flow

    def test_total_displacement_points_from_earlier_to_later(self):
        pan = np.array([[1, 0, -PAN], [0, 1, 0], [0, 0, 1]], float)
        thing = texture(7, 120, 120, sigma=4.0)
        pair = []
        for index in (0, 1):
            picture = GROUND[:, PAN * index:PAN * index + 480].copy()
            picture[100:220, 100 + SPEED * index:220 + SPEED * index] = thing
            pair.append(picture)
        flow = self.between(pan, pair[1], pair[0])
        inside = flow[33:47, 33:47]
        np.testing.assert_allclose(np.nanmedian(inside, axis=(0, 1)), [SPEED, 0], atol=0.15)
        np.testing.assert_allclose(np.nanmedian(flow[:20], axis=(0, 1)), [-PAN, 0], atol=0.05)

    def test_what_enters_the_picture_has_no_flow(self):
        pan = np.array([[1, 0, -40], [0, 1, 0], [0, 0, 1]], float)
        flow = self.between(pan, GROUND[:, 40:520], GROUND[:, :480])
        assert np.isnan(flow[:, -9:]).all()
        assert np.isfinite(flow[:, 5:-15]).mean() > 0.97

    def test_residual_of_a_known_flow(self):
        matrix = np.array([[1.02, 0, -5], [0, 1.02, 3], [0, 0, 1]])
        rows, columns, width, height = 5, 8, 80, 50
        x = (np.arange(columns) + 0.5) * 10 - 0.5
        y = (np.arange(rows) + 0.5) * 10 - 0.5
        later = np.stack(np.meshgrid(x, y), axis=-1)
        # the point was at p before; the background took p to M p; the object went (7, -2) further
        moved_by = np.array([7.0, -2.0])
        before = (later - moved_by - matrix[:2, 2]) / 1.02
        residual = residual_flow((later - before).astype(np.float32), matrix, width, height)
        np.testing.assert_allclose(residual, np.broadcast_to(moved_by, residual.shape), atol=1e-3)


class TestPhotometricTest:
    NOISE = 2.0

    def seen(self, ground: np.ndarray, shift_px: int = 10, shadow: bool = False):
        """A textured square that moved right by ``shift_px`` over ground that stands still."""
        pair = []
        for left in (60, 60 + shift_px):
            image = ground.copy()
            image[40:40 + SIDE, left:left + SIDE] = THING
            pair.append(image)
        return self.found(ImagePair(pair[1], pair[0], np.eye(3)), np.float32([shift_px, 0]))

    def found(self, pair: ImagePair, motion: np.ndarray):
        place, still = Place(Box(20, 10, 180, 120), 20, motion), np.zeros(2, np.float32)
        return photometric_tests_apart(pair, [still], [place], self.NOISE, 3.0)[0]

    @pytest.mark.parametrize('ground', [texture(5, 130, 200), np.full((130, 200), 120, np.uint8)],
                             ids=['texture', 'plain'])
    def test_foreground_is_the_object_and_not_its_ghost(self, ground):
        y, x = np.nonzero(self.seen(ground).foreground)
        box = Box(x.min() + 20, y.min() + 10, x.max() + 21, y.max() + 11)
        true = Box(70, 40, 70 + SIDE, 40 + SIDE)
        inter = (min(box.right, true.right) - max(box.left, true.left)) * (
            min(box.bottom, true.bottom) - max(box.top, true.top))
        assert inter / (box.area + true.area - inter) >= 0.8, box

    def test_no_foreground_where_nothing_moved(self):
        image = texture(5, 130, 200)
        assert not self.found(ImagePair(image, image, np.eye(3)), np.float32([6, 0])).foreground.any()


class TestSettings:
    def test_every_setting_is_explained_and_has_a_range(self):
        for name, value, metadata in settings(PipelineConfig()):
            assert len(metadata['doc']) > 10, name
            if type(value) in (bool, str) and not metadata['choices']:
                continue
            assert metadata['choices'] or (metadata['low'] is not None and metadata['high'] is not None), name

    @pytest.mark.parametrize('name', ['objects.min_side_px', 'objects.closing_px'])
    def test_pixels_that_are_not_those_of_the_image_are_said_to_be_others(self, name):
        units = {each: metadata['unit'] for each, _, metadata in settings(PipelineConfig())}
        assert units[name] == 'working px'

    @pytest.mark.parametrize(('name', 'value', 'message'), [
        ('art2.vigilance', 1.5, r'art2.vigilance: expected 0.0 to 1.0, got 1.5'),
        ('art2.vigilance', 'high', r"art2.vigilance: expected float, got str 'high'"),
        ('art2.max_neurons', 2.5, r'art2.max_neurons: expected int, got float 2.5'),
        ('art2.max_neurons', True, r'art2.max_neurons: expected int, got bool True'),
        ('ego_motion.smoothing', 'magic',
         r"ego_motion.smoothing: expected one of kalman, autoregressive, none, got 'magic'"),
        ('art2.vigilanse', 0.5, r"unknown setting 'art2.vigilanse'; known: .*art2.vigilance"),
        ('art2.vigilance', float('nan'), r'art2.vigilance: expected 0.0 to 1.0, got nan'),
    ])
    def test_wrong_settings_are_named(self, name, value, message):
        with pytest.raises(ConfigError, match=message):
            with_settings(PipelineConfig(), {name: value})

    def test_whole_numbers_serve_as_floats(self):
        assert with_settings(PipelineConfig(), {'art2.vigilance': 1}).art2.vigilance == 1.0


class TestPreprocessing:
    @pytest.mark.parametrize('shape', [(1, 4000), (2, 4000), (4000, 1)])
    def test_slivers_are_refused(self, shape):
        with pytest.raises(FrameError, match='expected at least 32 px a side at working resolution'):
            Preprocessor(PreprocessingConfig()).process(np.zeros(shape, np.uint8), 0)

    def test_grey_weights_and_scale(self):
        image = np.zeros((200, 400, 3), np.uint8)
        image[..., 1] = 100  # green alone: 0.587 of it (ITU-R BT.601)
        frame = Preprocessor(PreprocessingConfig(max_width_px=200)).process(image, 7)
        assert frame.gray.shape == (100, 200) and frame.scale == 0.5
        assert (frame.width, frame.height, frame.stamp_ns) == (400, 200, 7)
        assert abs(int(frame.gray[50, 50]) - 59) <= 1

    def test_median_takes_single_pixels_away(self):
        image = np.full((100, 100), 80, np.uint8)
        image[50, 50] = 255
        assert Preprocessor(PreprocessingConfig(median_kernel_px=3)).process(image, 0).gray[50, 50] == 80

    @pytest.mark.parametrize(('image', 'message'), [
        (np.zeros((100, 100), np.float32), 'expected a uint8 array, got float32'),
        (np.zeros((100, 100, 4), np.uint8), r'expected shape \(H, W\) or \(H, W, 3\), got \(100, 100, 4\)'),
        (np.zeros((0, 100), np.uint8), 'expected at least one pixel'),
        (np.zeros((20, 100), np.uint8), 'expected at least 32 px a side at working resolution, got 100x20'),
        ('picture', 'expected a uint8 array, got str'),
    ])
    def test_unusable_images_are_refused(self, image, message):
        with pytest.raises(FrameError, match=message):
            Preprocessor(PreprocessingConfig()).process(image, 0)


def test_after_a_jump_of_the_stamps_the_clusters_of_before_are_not_told_any_more():
    pipeline, anew = MotionPipeline(), MotionPipeline()
    for index in range(5):
        pipeline.process(scene(index), (index + 1) * PERIOD_NS)
    assert pipeline.neurons > 0
    pipeline.process(scene(5), 3600 * 10**9)
    anew.process(scene(5), 3600 * 10**9)
    assert (pipeline.neurons, pipeline.tuned) == (anew.neurons, anew.tuned)
