"""Objects that stop are held by their looks, and let go where they are no longer."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import PipelineConfig, TracksConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.tracking.alternatives.appearance import APPEARANCE_MODELS, GrayHistogram, Template
from motion_detect_ros.core.tracking.tracker import Tracker

PERIOD_NS, SIDE, TOP = 40_000_000, 48, 150
STOP, ON = 22, 47  # one second at 25 frames/s


def texture(seed: int, height: int, width: int, low: int = 20, high: int = 235) -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(height, width)), (0, 0), 1.5)
    return cv2.normalize(noise, None, low, high, cv2.NORM_MINMAX).astype(np.uint8)


#: The thing is brighter than most of the ground, for the sake of its histogram.
GROUND, THING = texture(1, 360, 800, 10, 170), texture(2, SIDE, SIDE, 120, 250)


def left_of(index: int) -> int:
    """On the picture: 5 px a frame while the ground goes 2 px back; still on the ground from STOP to ON."""
    moving = min(index, STOP) + max(0, index - ON)
    return 60 + 7 * moving - 2 * index


def scene(index: int, gone_from: int = 10 ** 6) -> np.ndarray:
    picture = GROUND[:, 2 * index:2 * index + 480].copy()
    if index < gone_from:
        left = left_of(index)
        picture[TOP:TOP + SIDE, left:left + SIDE] = THING
    return picture


def run(memory: str, frames: int, appearance_hold_s: float = 2.0, gone_from: int = 10 ** 6):
    config = with_settings(PipelineConfig(), {
        'tracks.appearance': memory, 'tracks.appearance_hold_s': appearance_hold_s})
    pipeline = MotionPipeline(config)
    return [pipeline.process(scene(index, gone_from), (index + 1) * PERIOD_NS).detections for index in range(frames)]


@pytest.mark.parametrize('memory', ['template', 'camshift'])
def test_one_id_through_a_stop_of_a_second(memory):
    found = run(memory, 62)
    assert [len(records) for records in found[8:]] == [1] * (62 - 8)
    assert len({int(records['id'][0]) for records in found[8:]}) == 1
    for index in range(STOP + 3, ON):
        record = found[index][0]
        assert abs(record['u'] - (left_of(index) + SIDE / 2)) < 3.0
        assert abs(record['v'] - (TOP + SIDE / 2)) < 3.0
    assert np.hypot(found[ON - 1]['vel_u'][0], found[ON - 1]['vel_v'][0]) < 2.0  # 175 while it moves
    scores = [float(records['score'][0]) for records in found[STOP + 8:ON]]
    assert scores == sorted(scores, reverse=True) and scores[-1] < 0.999 * scores[0]
    assert found[-1]['vel_u'][0] == pytest.approx(175.0, rel=0.2)


@pytest.mark.parametrize(('memory', 'appearance_hold_s'), [('none', 2.0), ('template', 0.0)])
def test_without_memory_it_is_forgotten(memory, appearance_hold_s):
    found = run(memory, STOP + 14, appearance_hold_s)
    assert all(len(records) == 0 for records in found[STOP + 9:])


def test_no_longer_than_told():
    found = run('template', ON, appearance_hold_s=0.5)
    counts = [len(records) for records in found]
    assert counts[STOP + 10] == 1
    assert sum(counts[STOP + 20:]) == 0


@pytest.mark.parametrize('memory', ['template', 'camshift'])
def test_dropped_where_the_ground_is_seen_again(memory):
    gone = STOP + 10
    found = run(memory, ON, gone_from=gone)
    assert len(found[gone - 1]) == 1
    assert sum(len(records) for records in found[gone + 6:]) == 0


def test_dropped_outside_the_picture():
    tracker = Tracker(TracksConfig(appearance='template', appearance_hold_s=5.0))
    pan = np.array([[1, 0, -12.0], [0, 1, 0], [0, 0, 1]])
    counts = []
    for index in range(30):
        picture = texture(1, 120, 200)
        left = 120 - 12 * max(0, index - 10)
        if left > -40:
            picture[40:80, max(0, left):left + 40] = texture(2, 40, 40)[:, max(0, -left):]
        seen = [Candidate(np.array([140.0, 60.0]), np.array([40.0, 40.0]), np.zeros(2), 1600.0, 2.0, 1)]
        still = index <= 10
        records = tracker.step(seen if still else [], np.eye(3) if still else pan, 0.04, 200, 120, picture)
        counts.append(len(records))
    assert counts[10:17] == [1] * 7 and sum(counts[22:]) == 0


@pytest.mark.parametrize('log_odds', [2.0, -0.3])
def test_the_score_of_what_is_held_falls_also_where_it_was_low(log_odds: float):
    tracker = Tracker(TracksConfig(appearance='template', confirm_log_odds=-9.0, show_log_odds=-9.0))
    picture, scores = texture(1, 120, 200), []
    picture[40:80, 120:160] = texture(2, 40, 40)
    one = Candidate(np.array([140.0, 60.0]), np.array([40.0, 40.0]), np.zeros(2), 1600.0, log_odds, 1)
    for index in range(40):
        records = tracker.step([one] if index < 10 else [], np.eye(3), 0.04, 200, 120, picture)
        scores.extend(records['score'].tolist())
    held = scores[-30:]
    assert len(scores) > 35 and (np.diff(held) <= 0.0).all() and held[-1] < held[0] - 0.02


@pytest.mark.parametrize(('away', 'held'), [((300.0, 0.0), True), ((0.0, 200.0), True), ((60.0, 0.0), False)],
                         ids=['in its row', 'in its column', 'on top'])
def test_held_unless_another_object_is_detected_on_top(away: tuple[float, float], held: bool):
    """The other one is of 140 x 80 px: too large to be taken for the one of 40 x 40 px that stops."""
    tracker, picture = Tracker(TracksConfig(appearance='template', appearance_hold_s=5.0)), texture(1, 360, 600)
    place = np.array([140.0, 60.0])
    picture[40:80, 120:160] = texture(2, 40, 40)
    one = Candidate(place, np.array([40.0, 40.0]), np.zeros(2), 1600.0, 2.0, 1)
    other = Candidate(place + away, np.array([140.0, 80.0]), np.zeros(2), 11200.0, 2.0, 2)
    for index in range(20):
        records = tracker.step([one, other] if index < 10 else [other], np.eye(3), 0.04, 600, 360, picture)
    assert (1 in records['id']) == held
    assert held == (records['width'] == 40.0).any()


class TestLooks:
    CENTRE, SIZE = np.array([100.0, 80.0]), np.array([40.0, 30.0])

    def picture(self, left: int, top: int, scale: float = 1.0) -> np.ndarray:
        picture, thing = texture(5, 160, 240, 10, 150), texture(6, 30, 40, 130, 250)
        thing = cv2.resize(thing, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
        picture[top:top + thing.shape[0], left:left + thing.shape[1]] = thing
        return picture

    @pytest.mark.parametrize('kind', ['template', 'camshift'])
    def test_found_where_it_went(self, kind):
        looks = APPEARANCE_MODELS[kind](self.picture(80, 65), self.CENTRE, self.SIZE)
        found = looks.find(self.picture(87, 60), self.CENTRE, self.SIZE)
        assert found == pytest.approx([107.0, 75.0], abs=0.01 if kind == 'template' else 2.0)
        assert looks.find(texture(5, 160, 240, 10, 150), self.CENTRE, self.SIZE) is None

    def test_boxes_between_pixels_keep_their_place(self):
        centre = self.CENTRE + np.array([0.4, -0.3])
        looks = Template.learn(self.picture(80, 65), centre, self.SIZE)
        assert looks.find(self.picture(83, 65), centre, self.SIZE) == pytest.approx(centre + np.array([3.0, 0.0]))

    def test_found_at_the_size_that_it_has_now(self):
        looks = Template.learn(self.picture(80, 65), self.CENTRE, self.SIZE)
        found = looks.find(self.picture(75, 62, 1.3), np.array([100.0, 80.0]), 1.3 * self.SIZE)
        assert found == pytest.approx([75 + 26.0, 62 + 19.5], abs=1.0)

    def test_what_looks_like_nothing_is_not_learnt(self):
        flat = np.full((160, 240), 90, np.uint8)
        assert Template.learn(flat, self.CENTRE, self.SIZE) is None
        assert GrayHistogram.learn(flat, self.CENTRE, self.SIZE) is None
        small = np.array([3.0, 3.0])
        assert all(learn(self.picture(80, 65), self.CENTRE, small) is None for learn in APPEARANCE_MODELS.values())
        assert all(learn(flat, np.array([-50.0, -50.0]), self.SIZE) is None for learn in APPEARANCE_MODELS.values())

    def test_nothing_is_found_beside_the_picture(self):
        for learn in APPEARANCE_MODELS.values():
            looks = learn(self.picture(80, 65), self.CENTRE, self.SIZE)
            assert looks.find(self.picture(80, 65), np.array([-60.0, 80.0]), self.SIZE) is None


def test_unknown_memory_is_refused():
    with pytest.raises(ConfigError, match='tracks.appearance'):
        with_settings(PipelineConfig(), {'tracks.appearance': 'photo'})
