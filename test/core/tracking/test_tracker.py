"""Tracks of exact motions under an exact camera motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from motion_detect_ros.core.clustering_stage import ClusteringStage
from motion_detect_ros.core.config import PipelineConfig, TracksConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.scoring import log_odds, probability
from motion_detect_ros.core.ego_motion.stage import no_estimate
from motion_detect_ros.core.tracking.tracker import Tracker
from motion_detect_ros.core.types import EgoMotion, EgoStatus, FlowField, PreparedFrame

DT_S = 0.05
CONFIG = TracksConfig(confirm_s=3 * DT_S, confirm_window_s=5 * DT_S, coast_s=2 * DT_S)


def candidate(u: float, v: float, velocity=(0.0, 0.0), size=(30.0, 20.0), log_odds=2.0) -> Candidate:
    return Candidate(np.array([u, v]), np.array(size), np.array(velocity, float), 300.0, log_odds, 1)


def test_confirmed_after_enough_hits_and_never_by_flicker():
    tracker = Tracker(CONFIG)
    counts = [len(tracker.step([candidate(100, 100)], np.eye(3), DT_S, 640, 480)) for _ in range(4)]
    assert counts == [0, 0, 1, 1]
    tracker = Tracker(CONFIG)
    for index in range(20):  # seen every third frame: two hits in five
        seen = [candidate(100, 100)] if index % 3 == 0 else []
        assert len(tracker.step(seen, np.eye(3), DT_S, 640, 480)) == 0


@pytest.mark.parametrize('window_s', [5 * DT_S, 25 * DT_S])
def test_a_window_that_changes_counts_for_the_tracks_that_there_are(window_s: float):
    """Of an object seen in every second frame 5 of 9 frames show it, and never 5 of 5."""
    tracker = Tracker(replace(CONFIG, confirm_s=5 * DT_S, confirm_window_s=30 * DT_S - window_s))
    tracker.step([candidate(100, 100)], np.eye(3), DT_S, 640, 480)
    tracker.use_config(replace(CONFIG, confirm_s=5 * DT_S, confirm_window_s=window_s, coast_s=5 * DT_S))
    counts = [len(tracker.step([candidate(100, 100)] if index % 2 else [], np.eye(3), DT_S, 640, 480))
              for index in range(40)]
    assert any(counts) == (window_s == 25 * DT_S)


@pytest.mark.parametrize('gap_s', [2 * DT_S, 4 * DT_S, 20 * DT_S])
def test_time_before_an_object_was_seen_does_not_speak_for_it(gap_s: float):
    tracker = Tracker(CONFIG)
    tracker.step([], np.eye(3), DT_S, 640, 480)
    counts = [len(tracker.step([candidate(100, 100)], np.eye(3), dt_s, 640, 480)) for dt_s in (gap_s, DT_S, DT_S)]
    assert counts == [0, 0, 1]


def first_report(step_px: float, pan_px: float = 0.0, others: tuple[Candidate, ...] = (), top: float = 100.0,
                 ) -> int | None:
    """Frame that first reports more than ``others``.

    An object of 24 px, too faint to be reported for what any frame shows of it, goes so far a frame of 50 ms over the
    ground, and the ground in the picture with the camera.
    """
    tracker, matrix, counts = Tracker(CONFIG), np.array([[1, 0, pan_px], [0, 1, 0], [0, 0, 1]], float), []
    for index in range(60):
        faint = candidate(100 + (step_px + pan_px) * index, top, (step_px / DT_S, 0.0), (30.0, 19.2), log_odds=-0.3)
        counts.append(len(tracker.step([*others, faint], matrix, DT_S, 640, 480)))
    return next((index for index, count in enumerate(counts) if count > len(others)), None)


def test_a_faint_object_is_reported_once_it_has_gone_its_own_size():
    assert first_report(0.0) is None
    assert first_report(0.35) is None  # 21 px in 3 s
    assert first_report(2.0) == 20  # 24 px after 12 frames, a second after 20
    assert first_report(0.75) == 32  # 24 px
    assert first_report(0.0, pan_px=5.0) is None  # it stands on the ground
    assert first_report(2.0, pan_px=3.0) == 20


def test_a_faint_object_beside_a_larger_one_is_taken_for_a_part_of_it():
    large = candidate(240.0, 100.0, size=(80.0, 60.0))
    assert first_report(2.0, others=(large,), top=150.0) is None
    assert first_report(2.0, others=(large,), top=300.0) == 20
    # it is near up to half the height and the geometric mean of the sides: 30 + 69.3 px below its centre
    assert first_report(2.0, others=(large,), top=195.0) is None
    assert first_report(2.0, others=(large,), top=205.0) == 20


def two_views(offset=(4.0, 0.0), size=(14.0, 14.0), velocity=(20.0, 0.0)) -> list[int]:
    """Objects reported in each frame: one of 30 x 20 px that goes 20 px/s, and from frame 5 on a second one at an
    offset from it.
    """
    tracker, counts = Tracker(CONFIG), []
    for index in range(12):
        whole = candidate(100.0 + 1.0 * index, 100.0, (20.0, 0.0))
        place = whole.centre + offset + np.array(velocity) * DT_S * (index - 9) - np.array([1.0, 0.0]) * (index - 9)
        second = [candidate(*place, velocity, size)] if index >= 5 else []
        counts.append(len(tracker.step([whole, *second], np.eye(3), DT_S, 640, 480)))
    return counts


def test_a_part_of_a_tracked_object_is_no_second_one():
    assert two_views()[-1] == 1
    assert two_views(size=(44.0, 30.0))[-1] == 1  # nor is what holds it and its surroundings


def test_neighbours_and_what_crosses_an_object_are_objects_of_their_own():
    assert two_views(offset=(26.0, 0.0))[-1] == 2
    assert two_views(offset=(12.0, 8.0))[-1] == 2  # they share less than most of the smaller one
    assert two_views(velocity=(-20.0, 0.0))[9] == 2


def test_of_two_views_of_an_object_the_one_known_longer_is_reported():
    tracker = Tracker(CONFIG)
    for index in range(12):
        second = [candidate(102.0, 100.0, size=(12.0, 12.0), log_odds=9.0)] if index >= 4 else []
        records = tracker.step([candidate(100.0, 100.0), *second], np.eye(3), DT_S, 640, 480)
    assert records['width'].tolist() == [30.0]
    for _ in range(3):  # the whole is not found any more, so it ends, and the part is all that is known
        records = tracker.step([candidate(102.0, 100.0, size=(12.0, 12.0))], np.eye(3), DT_S, 640, 480)
    assert records['id'].tolist() == [2]


def test_a_box_that_shows_something_else_for_a_frame_hardly_changes_the_size():
    def after(wrong: tuple[float, float], right: tuple[float, float] = (30.0, 20.0)) -> float:
        tracker = Tracker(CONFIG)
        for index in range(12):
            records = tracker.step([candidate(100.0, 100.0, size=wrong if index == 11 else right)], np.eye(3), DT_S,
                                   640, 480)
        return float(records['width'][0])

    assert 31.0 < after((36.0, 20.0)) < 34.0  # noise is averaged
    assert after((90.0, 20.0)) - 30.0 < 0.15 * 60.0  # a merge with a neighbour counts less
    assert 30.0 - after((10.0, 20.0)) < 0.15 * 20.0  # as a fragment does


def test_the_size_follows_an_object_that_grows():
    tracker = Tracker(CONFIG)
    for index in range(40):
        records = tracker.step([candidate(200.0, 200.0, size=(30.0 * 1.03 ** index, 20.0))], np.eye(3), DT_S, 640, 480)
    assert records['width'][0] == pytest.approx(30.0 * 1.03 ** 39, rel=0.12)


def test_velocity_is_that_over_ground_however_the_camera_zooms_and_pans():
    zoom = np.array([[1.01, 0, -4.0], [0, 1.01, 2.0], [0, 0, 1]])
    tracker, position, velocity = Tracker(CONFIG), np.array([200.0, 150.0]), np.array([80.0, -40.0])
    for _ in range(40):
        velocity = velocity * 1.01
        position = (zoom @ [*position, 1.0])[:2] + velocity * DT_S
        records = tracker.step([candidate(*position, velocity)], zoom, DT_S, 640, 480)
    assert records['vel_u'][0] == pytest.approx(velocity[0], rel=0.02)
    assert records['vel_v'][0] == pytest.approx(velocity[1], rel=0.02)
    assert records['u'][0] == pytest.approx(position[0], abs=0.5)
    assert records['age'][0] == 40


def test_crossing_objects_keep_their_ids():
    tracker = Tracker(CONFIG)
    for index in range(30):
        a, b = candidate(100 + 6 * index, 100, (120, 0)), candidate(280 - 6 * index, 130, (-120, 0))
        records = tracker.step([a, b] if index % 2 else [b, a], np.eye(3), DT_S, 640, 480)
        by_id = {int(r['id']): r for r in records}
        if index == 5:
            right = next(number for number, r in by_id.items() if r['vel_u'] > 0)
    assert by_id[right]['vel_u'] > 100 and len(by_id) == 2


def labelled(places: np.ndarray, labels: list[int], size=(30.0, 30.0)) -> list[Candidate]:
    """Standing objects whose records can be told apart by their ``cluster``."""
    return [replace(candidate(*place, size=size), cluster=label) for place, label in zip(places, labels, strict=True)]


def joined(before: list[Candidate], after: list[Candidate], without_ego_motion: int = 0) -> dict[int, int]:
    """Label before -> label after, for the tracks of objects that stood still for a while; frames in between."""
    tracker = Tracker(CONFIG)
    for _ in range(4):
        first = tracker.step(before, np.eye(3), DT_S, 640, 480)
    assert len(first) == len(before)
    for _ in range(without_ego_motion):
        tracker.coast_without_frame(DT_S, 640)
    second = {int(record['id']): int(record['cluster']) for record in tracker.step(after, np.eye(3), DT_S, 640, 480)}
    return {int(record['cluster']): second[int(record['id'])] for record in first}


def apart(random: np.random.Generator) -> np.ndarray:
    """(4, 2) places of boxes of 30 x 30 px that share less than 60 % of their area."""
    while True:
        places = random.uniform(100.0, 124.0, (4, 2))
        shared = np.clip(30.0 - np.abs(places[:, None] - places), 0.0, None).prod(axis=2) / 900.0
        if (shared - np.eye(4)).max() < 0.6:
            return places


@pytest.mark.parametrize('seed', range(20))
def test_of_all_pairings_the_one_with_the_least_sum_of_distances_is_taken(seed: int):
    random = np.random.default_rng(seed)
    before, after = apart(random), apart(random)
    best = min(permutations(range(4)), key=lambda order: np.hypot(*(after[list(order)] - before).T).sum())
    # Frames without ego-motion open the gate, 21 px, to all pairs.
    assert joined(labelled(before, [1, 2, 3, 4]), labelled(after, [11, 12, 13, 14]), without_ego_motion=1) == {
        index + 1: other + 11 for index, other in enumerate(best)}


@pytest.mark.parametrize(('offset', 'size', 'kept'), [
    # 30 % of both widths and 3 px: 21 px; of both heights: 15 px
    ((20, 0), (30, 20), True), ((22, 0), (30, 20), False), ((0, 14), (30, 20), True), ((0, 16), (30, 20), False),
    ((15, 11), (30, 20), False),  # hypot(15 / 21, 11 / 15) = 1.02
    ((0, 0), (60, 45), True), ((0, 0), (60, 55), False),  # 4.5 and 5.5 times the area, about e^1.6 = 4.95
])
def test_gate_grows_with_the_objects(offset: tuple[int, int], size: tuple[int, int], kept: bool):
    found = joined(labelled([(200, 150)], [1], (30, 20)), labelled([(200 + offset[0], 150 + offset[1])], [2], size))
    assert found == {1: 2 if kept else 1}


def test_coasts_along_its_prediction_and_then_ends():
    tracker = Tracker(CONFIG)
    for index in range(10):
        seen = tracker.step([candidate(100 + 5 * index, 100, (100, 0))], np.eye(3), DT_S, 640, 480)
    first = tracker.step([], np.eye(3), DT_S, 640, 480)
    assert first['u'][0] == pytest.approx(150, abs=1.0)
    assert 0.0 < first['score'][0] < seen['score'][0] <= 1.0
    assert [len(tracker.step([], np.eye(3), DT_S, 640, 480)) for _ in range(3)] == [1, 0, 0]


def test_ids_are_never_used_twice():
    tracker, seen = Tracker(CONFIG), set()
    for _ in range(3):
        for _ in range(4):
            records = tracker.step([candidate(50, 50)], np.eye(3), DT_S, 640, 480)
        assert int(records['id'][0]) not in seen
        seen.add(int(records['id'][0]))
        tracker.reset()


class TestMissingEgoMotion:
    def steady(self, tracker: Tracker, frames: int = 12):
        for index in range(frames):
            records = tracker.step([candidate(100 + 5 * index, 100, (100, 0))], np.eye(3), DT_S, 640, 480)
        return records

    def test_the_same_object_is_found_again_where_the_camera_put_it(self):
        tracker = Tracker(CONFIG)
        before = self.steady(tracker)  # at 155
        tracker.coast_without_frame(DT_S, 640)
        # own motion two frames further, the camera jumped 26 px in the frame without ego-motion
        after = tracker.step([candidate(165 + 26, 100, (100, 0))], np.eye(3), DT_S, 640, 480)
        assert after['id'].tolist() == before['id'].tolist()
        assert after['age'][0] == before['age'][0] + 1
        assert after['u'][0] == pytest.approx(191, abs=4.0)  # the jump is believed
        assert after['vel_u'][0] == pytest.approx(100.0, abs=4.0)  # and is not taken for speed

    def test_without_the_missing_frame_a_jump_is_another_object(self):
        tracker = Tracker(CONFIG)
        before = self.steady(tracker)
        for index in range(4):
            after = tracker.step([candidate(160 + 5 * index + 26, 100, (100, 0))], np.eye(3), DT_S, 640, 480)
        assert after['id'].tolist() != before['id'].tolist()

    def test_own_motion_goes_on_for_the_time_that_passed(self):
        tracker = Tracker(replace(CONFIG, coast_s=0.5, show_log_odds=-10.0))
        self.steady(tracker)  # at 155
        tracker.coast_without_frame(0.4, 640)
        records = tracker.step([], np.eye(3), DT_S, 640, 480)
        assert records['u'][0] == pytest.approx(155 + 100 * 0.45, abs=1.0)

    @pytest.mark.parametrize(('missing_s', 'longest'), [(0.9, 0), (DT_S, 2), (0.0, 3)])
    def test_time_without_frames_is_time_undetected(self, missing_s: float, longest: int):
        """An object lives for ``coast_s``, three frames; nothing says that it is there still."""
        tracker = Tracker(replace(CONFIG, coast_s=3 * DT_S, show_log_odds=-10.0))
        self.steady(tracker)
        if missing_s:
            tracker.coast_without_frame(missing_s, 640)
        counts = [len(tracker.step([], np.eye(3), DT_S, 640, 480)) for _ in range(6)]
        assert counts == [1] * longest + [0] * (6 - longest)

    def test_what_was_believed_is_forgotten_meanwhile(self):
        """As over frames in which nothing could be looked for."""
        scores = []
        for gap in (Tracker.coast_without_frame, lambda tracker, s, width: tracker.coast(np.eye(3), s, width, 480)):
            tracker = Tracker(replace(CONFIG, coast_s=2.0, show_log_odds=-10.0))
            self.steady(tracker)
            gap(tracker, 0.3, 640)
            scores.append(float(tracker.step([], np.eye(3), DT_S, 640, 480)['score'][0]))
        assert scores[0] == pytest.approx(scores[1])

    @pytest.mark.parametrize('missing', [False, True])
    def test_a_first_detection_before_a_gap_confirms_nothing(self, missing: bool):
        """Three detections within 0.25 s confirm; the first one is 0.4 s before the others."""
        tracker = Tracker(CONFIG)
        tracker.step([candidate(100, 100)], np.eye(3), DT_S, 640, 480)
        if missing:
            for _ in range(8):
                tracker.coast_without_frame(DT_S, 640)
        counts = [len(tracker.step([candidate(100, 100)], np.eye(3), DT_S, 640, 480)) for _ in range(2)]
        assert counts == ([0, 0] if missing else [0, 1])

    @pytest.mark.parametrize(('step_px', 'reported'), [(0.0, False), (2.0, True)])
    def test_the_way_of_the_camera_is_not_that_of_a_faint_object(self, step_px: float, reported: bool):
        """Every third frame is missing while the camera pans by 3 px a frame: 120 px in all, 5 sizes of the object."""
        tracker, pan, counts = Tracker(CONFIG), np.array([[1, 0, 3.0], [0, 1, 0], [0, 0, 1]]), []
        for index in range(120):
            if index % 3 == 2:
                tracker.coast_without_frame(DT_S, 640)
                continue
            faint = candidate(50 + (step_px + 3.0) * index, 100, (step_px / DT_S, 0.0), (30.0, 19.2), log_odds=-0.3)
            counts.append(len(tracker.step([faint], pan, DT_S, 640, 480)))
        assert any(counts) == reported

    def test_known_motion_of_the_camera_is_used_even_when_nothing_was_looked_for(self):
        tracker, pan = Tracker(CONFIG), np.array([[1, 0, 60.0], [0, 1, 0], [0, 0, 1]])
        self.steady(tracker)
        tracker.coast(pan, DT_S, 640, 480)
        records = tracker.step([], np.eye(3), DT_S, 640, 480)
        assert records['u'][0] == pytest.approx(155 + 60 + 10, abs=1.0)

    def test_ends_as_after_misses(self):
        tracker = Tracker(CONFIG)
        self.steady(tracker)
        for _ in range(3):
            tracker.coast(np.eye(3), DT_S, 640, 480)
        assert len(tracker.step([], np.eye(3), DT_S, 640, 480)) == 0


def test_the_stage_tells_missing_estimates_and_missing_frames_from_known_ones(monkeypatch):
    """Frames without an estimate are as if they had never come; without frames for over a second tracks end."""
    calls = []
    monkeypatch.setattr(Tracker, 'coast', lambda self, matrix, dt_s, width, height: calls.append(
        ('coast', matrix[0, 2], round(dt_s, 3), width, height)))
    monkeypatch.setattr(Tracker, 'coast_without_frame', lambda self, dt_s, width: calls.append(
        ('no frame', round(dt_s, 3), width)))
    monkeypatch.setattr(Tracker, 'reset', lambda self: calls.append(('reset',)))
    stage, gray = ClusteringStage(PipelineConfig()), np.zeros((48, 64), np.uint8)
    calls.clear()

    def frame(status: EgoStatus, stamp_ms: int, since_ms: int):
        pan = np.array([[1, 0, 3.0], [0, 1, 0], [0, 0, 1]])
        estimate = EgoMotion(pan, np.eye(6), status, 10 ** 6 * stamp_ms, 10 ** 6 * since_ms)
        ego = estimate if estimate.ok else no_estimate(status, estimate.stamp_ns, estimate.prev_stamp_ns)
        flow = FlowField(np.full((12, 16, 2), np.nan, np.float32), 64, 48, ego.stamp_ns)
        stage.process(PreparedFrame(gray, 1.0, 64, 48, ego.stamp_ns), ego, None, flow)
    frame(EgoStatus.FIRST_FRAME, 0, 0)
    frame(EgoStatus.LOW_TEXTURE, 50, 0)
    frame(EgoStatus.OK, 100, 0)
    frame(EgoStatus.DEGENERATE, 150, 100)
    # this stage never got the frame of 200 ms
    frame(EgoStatus.OK, 250, 200)
    frame(EgoStatus.OK, 1400, 1350)
    assert calls == [('reset',), ('coast', 0.0, 0.0, 64, 48), ('coast', 3.0, 0.1, 64, 48),
                     ('no frame', 0.1, 64), ('coast', 3.0, 0.05, 64, 48), ('reset',), ('coast', 3.0, 0.05, 64, 48)]


#: Noise of the centre and of the velocity (shares of the side), acceleration (sides/s^2), share of the speed that the
#: flow misses, correlation of the centre's error from frame to frame.
NOISES = {
    'as assumed': (0.12, 0.72, 2.0, 0.0, 0.0),
    'steady and clean': (0.03, 0.1, 0.0, 0.0, 0.0),
    'manoeuvring and clean': (0.02, 0.05, 5.0, 0.0, 0.0),
    'noisy': (0.2, 1.5, 1.0, 0.0, 0.0),
    'flow too short, boxes that wander': (0.06, 0.09, 1.0, 0.1, 0.8),
    'flow much too short': (0.03, 0.05, 1.0, 0.35, 0.5),
}


@pytest.mark.parametrize('noise', NOISES.values(), ids=NOISES.keys())
def test_true_velocity_lies_within_the_reported_interval(noise):
    """Sixty objects for each kind of noise; the intervals are neither too narrow nor idle."""
    centre, flow, acceleration, missing, memory = noise
    random, side, inside, errors, variances = np.random.default_rng(5), 40.0, [], [], []
    for _ in range(60):
        tracker, position, velocity = Tracker(CONFIG), np.array([2000.0, 2000.0]), random.normal(0, 60, 2)
        wander = random.normal(size=2)
        for index in range(30):
            push = random.normal(0, acceleration * side, 2)
            position, velocity = position + velocity * DT_S + push * DT_S ** 2 / 2, velocity + push * DT_S
            wander = memory * wander + np.sqrt(1 - memory ** 2) * random.normal(size=2)
            seen = candidate(*(position + centre * side * wander),
                             (1 - missing) * velocity + random.normal(0, flow * side, 2), (side, side))
            records = tracker.step([seen], np.eye(3), DT_S, 4000, 4000)
            if index >= 8 and len(records):
                error = np.array([records['vel_u'][0], records['vel_v'][0]]) - velocity
                variance = np.array([records['var_u'][0], records['var_v'][0]])
                inside.extend(error ** 2 < 1.96 ** 2 * variance)
                errors.extend(error ** 2)
                variances.extend(variance)
    assert len(inside) > 2000
    assert np.mean(inside) >= 0.9
    assert np.sqrt(np.mean(variances) / np.mean(errors)) < (5.5 if noise == NOISES['steady and clean'] else 3.0)


def test_boxes_are_cut_at_the_border_and_end_outside():
    tracker = Tracker(CONFIG)
    for index in range(12):
        records = tracker.step([candidate(570 + 5 * index, 100, (100, 0))], np.eye(3), DT_S, 640, 480)
    # centre at 625, 30 px wide: 610 .. 640
    assert records['u'][0] + records['width'][0] / 2 == pytest.approx(640.0, abs=1e-3)
    assert records['u'][0] - records['width'][0] / 2 == pytest.approx(610.0, abs=2.0)
    counts = [len(tracker.step([], np.array([[1, 0, 10.0], [0, 1, 0], [0, 0, 1]]), DT_S, 640, 480)) for _ in range(2)]
    assert counts == [0, 0]


@pytest.mark.parametrize(('centre', 'shown'), [
    ((5.0, 100.0), [10.0, 100.0, 20.0, 20.0]),     # columns -10 to 20
    ((100.0, 4.0), [100.0, 7.0, 30.0, 14.0]),      # rows -6 to 14
    ((100.0, 478.0), [100.0, 474.0, 30.0, 12.0]),  # rows 468 to 488
    ((637.0, 100.0), [631.0, 100.0, 18.0, 20.0]),  # columns 622 to 652
], ids=['left', 'top', 'bottom', 'right'])
def test_a_box_over_any_border_is_the_part_in_the_picture(centre: tuple[float, float], shown: list[float]):
    tracker = Tracker(CONFIG)
    for _ in range(4):
        records = tracker.step([candidate(*centre)], np.eye(3), DT_S, 640, 480)
    assert [float(records[name][0]) for name in ('u', 'v', 'width', 'height')] == pytest.approx(shown)


@pytest.mark.parametrize(('first', 'step_px'), [((100, 423), (0, 5)), ((100, 57), (0, -5)), ((57, 100), (-5, 0))],
                         ids=['bottom', 'top', 'left'])
def test_an_object_that_leaves_over_any_border_ends_there(first: tuple[int, int], step_px: tuple[int, int]):
    """It is last seen 2 px inside, at 100 px/s, so that 50 ms later its centre is 3 px outside."""
    tracker, velocity = Tracker(CONFIG), np.array(step_px) / DT_S
    for index in range(12):
        place = np.array(first) + index * np.array(step_px)
        records = tracker.step([candidate(*place, velocity)], np.eye(3), DT_S, 640, 480)
    assert len(records) == 1
    assert len(tracker.step([], np.eye(3), DT_S, 640, 480)) == 0


def test_weak_candidates_need_more_of_them_and_doubtful_ones_are_never_reported():
    def first_report(log_odds: float) -> int | None:
        tracker = Tracker(TracksConfig(confirm_s=3 * DT_S, confirm_window_s=5 * DT_S, confirm_log_odds=1.0))
        for index in range(30):
            if len(tracker.step([candidate(100, 100, log_odds=log_odds)], np.eye(3), DT_S, 640, 480)):
                return index
        return None
    # in a frame of 0.05 s 0.3 counts as 0.3 (1 - e^(-0.05/0.18)) / (1 - e^(-0.04/0.18)) = 0.3 * 0.2425 / 0.1993 = 0.365
    # the sum keeps e^(-0.05/0.18) = 0.7575 of itself: 0.365, 0.642, 0.851, 1.010
    assert (first_report(2.0), first_report(0.3), first_report(-0.5)) == (2, 3, None)


def test_score_is_the_probability_of_the_summed_log_odds():
    assert probability(0.0) == 0.5
    assert probability(np.log(3.0)) == pytest.approx(0.75)
    # -25.4 + 1.9 ln 1000 + 1.25 ln 20 + 5.5 * 0.8 + 6.9 * 0.5 = -25.4 + 13.1247 + 3.7447 + 4.4 + 3.45
    assert log_odds(1000 / 960 ** 2, 20.0, 0.8, 0.5) == pytest.approx(-0.6806, abs=1e-3)
    tracker = Tracker(CONFIG)
    for _ in range(3):
        records = tracker.step([candidate(50, 50, log_odds=1.0)], np.eye(3), DT_S, 640, 480)
    # 1.217 each, see above: 1.217 * (1 + 0.7575 + 0.7575^2) = 2.837
    assert records['score'][0] == pytest.approx(1.0 / (1.0 + np.exp(-2.837)), abs=1e-4)


@pytest.mark.parametrize('rate_hz', [10.0, 20.0, 40.0, 60.0])
def test_confirmation_coasting_and_log_odds_last_as_long_at_every_rate(rate_hz: float):
    dt_s, tracker = 1.0 / rate_hz, Tracker(TracksConfig(coast_s=0.3))
    seen = [candidate(100, 100, log_odds=0.5)]
    shown = [len(tracker.step(seen, np.eye(3), dt_s, 640, 480)) for _ in range(round(2 * rate_hz))]
    first_s = (shown.index(1) + 1) * dt_s
    assert 0.12 - dt_s / 2 - 1e-6 <= first_s <= 0.2 + 1e-6 and all(shown[shown.index(1):])
    # 0.5 / (1 - e^(-0.04/0.18)) = 2.51 is what the sum tends to
    assert tracker.step(seen, np.eye(3), dt_s, 640, 480)['score'][0] == pytest.approx(probability(2.51), abs=0.002)
    gone = [len(tracker.step([], np.eye(3), dt_s, 640, 480)) for _ in range(round(rate_hz))]
    assert sum(gone) * dt_s <= 0.3 + dt_s / 2 + 1e-6


@pytest.mark.parametrize(('coast_s', 'misses', 'lives'), [(0.3, 1, True), (0.3, 2, False), (0.0, 1, False)])
def test_a_confirmed_track_outlives_one_miss_of_a_longer_period_unless_none_is_allowed(
    coast_s: float, misses: int, lives: bool,
):
    """At 2 Hz a frame is 0.5 s; where the track has ended, one detection is not enough for the next one."""
    tracker = Tracker(TracksConfig(coast_s=coast_s))
    for _ in range(3):
        records = tracker.step([candidate(100, 100)], np.eye(3), 0.5, 640, 480)
    assert records['id'].tolist() == [1]
    for _ in range(misses):
        tracker.step([], np.eye(3), 0.5, 640, 480)
    after = tracker.step([candidate(100, 100)], np.eye(3), 0.5, 640, 480)
    assert after['id'].tolist() == ([1] if lives else [])


@pytest.mark.parametrize(('misses', 'lives'), [(3, True), (4, False)])
def test_a_tentative_track_outlives_three_misses_of_a_longer_period(misses: int, lives: bool):
    """The second detection confirms it, at 2 Hz, where it has not ended."""
    tracker = Tracker(TracksConfig())
    for seen in [[candidate(100, 100)], *[[]] * misses]:
        assert len(tracker.step(seen, np.eye(3), 0.5, 640, 480)) == 0
    assert len(tracker.step([candidate(100, 100)], np.eye(3), 0.5, 640, 480)) == lives


@pytest.mark.parametrize('jitter_s', [0.0, 0.002])
def test_jitter_of_the_frame_period_changes_no_decision(jitter_s: float):
    """At 25 Hz three detections make the default's 0.12 s, and three misses end a track; not four or two."""
    random = np.random.default_rng(4)
    for _ in range(50):
        tracker, seen = Tracker(TracksConfig()), [candidate(100, 100, log_odds=5.0)]
        periods = iter(0.04 + random.uniform(-jitter_s, jitter_s, 20))
        shown = [len(tracker.step(seen, np.eye(3), next(periods), 640, 480)) for _ in range(8)]
        assert shown == [0, 0, 1, 1, 1, 1, 1, 1]
        gone = [len(tracker.step([], np.eye(3), next(periods), 640, 480)) for _ in range(6)]
        assert gone == [1, 1, 1, 0, 0, 0]


def test_what_is_carried_on_from_one_detection_does_not_confirm_it():
    tracker = Tracker(TracksConfig(confirm_s=0.12, confirm_log_odds=-5.0))
    once = candidate(100.0, 100.0)
    shown = [len(tracker.step([one], np.eye(3), 0.04, 640, 480))
             for one in (once, *[replace(once, measured=False)] * 4)]
    assert shown == [0] * 5
    assert len(tracker.step([once], np.eye(3), 0.04, 640, 480)) == 1
