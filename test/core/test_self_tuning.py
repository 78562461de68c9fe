"""Settings that follow the scene: numbers worked by hand, and scenes of known noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_pipeline import PERIOD_NS, scene

from motion_detect_ros.core.background.noise_floor import NoiseFloor
from motion_detect_ros.core.clustering.neuron_counts import NeuronCounts
from motion_detect_ros.core.config import Art2Config, BackgroundConfig, PipelineConfig
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.self_tuning import MEMORY_S, Follower, SelfTuningConfig, Tuned
from motion_detect_ros.core.settings import with_settings

ON = SelfTuningConfig(noise_floor=True, neurons=True)
GIVEN = Tuned(0.2, 15, 25)


def test_a_step_is_followed_by_its_share_of_the_time_constant() -> None:
    slow = Follower()
    slow.follow(0.1, 0.04)
    assert slow.value == pytest.approx(0.1)
    slow.follow(0.4, MEMORY_S)
    assert slow.value == pytest.approx(0.1 * 4 ** (1 - 1 / math.e))


def test_following_does_not_depend_on_the_frame_rate() -> None:
    fast, slow = Follower(), Follower()
    for each, steps in ((fast, 100), (slow, 10)):
        each.follow(1.0, 1.0)
        for _ in range(steps):
            each.follow(3.0, 2.0 / steps)
    assert fast.value == pytest.approx(slow.value)


@pytest.mark.parametrize('nothing', [0.0, -1.0, math.nan, math.inf])
def test_what_was_not_measured_changes_nothing(nothing: float) -> None:
    follower = Follower()
    follower.follow(nothing, 0.04)
    assert follower.value is None
    follower.follow(2.0, 0.04)
    follower.follow(nothing, 60.0)
    assert follower.value == pytest.approx(2.0)


def test_noise_floor_is_a_multiple_of_the_noise_at_every_scale() -> None:
    small, large = (NoiseFloor(BackgroundConfig(noise_floor_px=0.2 * scale), ON) for scale in (1, 2))
    small.follow(0.1, 0.04)
    large.follow(0.2, 0.04)
    assert small.config.noise_floor_px == pytest.approx(0.16)
    assert large.config.noise_floor_px == pytest.approx(0.32)


def test_noise_floor_stays_near_what_the_user_set_and_comes_back() -> None:
    floor = NoiseFloor(BackgroundConfig(), ON)
    for spread_px, expected in ((1e-4, 0.05), (50.0, 0.8)):
        floor.reset()
        assert floor.config.noise_floor_px == 0.2
        floor.follow(spread_px, 0.04)
        assert floor.config.noise_floor_px == pytest.approx(expected)


def test_settings_keep_their_own_range() -> None:
    floor = NoiseFloor(BackgroundConfig(noise_floor_px=0.02), ON)
    floor.follow(1e-4, 0.04)
    assert floor.config.noise_floor_px == 0.01
    counts = NeuronCounts(Art2Config(initial_neurons=150, max_neurons=200), ON)
    counts.follow(won_by(190), 0.04)
    assert (counts.config.initial_neurons, counts.config.max_neurons) == (200, 200)


def won_by(neurons: int) -> np.ndarray:
    """Labels of cells of which so many neurons, the background first, won two each; one was not presented."""
    return np.array([-1, *range(neurons), *range(neurons)], np.int32)


@pytest.mark.parametrize(('used', 'initial', 'most'), [
    (8, 12, 20),     # 1.5 times 8, and 5/3 of that
    (1, 4, 7),       # not under a quarter of 15 and 25
    (25, 38, 64),    # a full network gets room
    (100, 60, 100),  # not over four times 15 and 25
])
def test_neurons_follow_those_in_use(used: int, initial: int, most: int) -> None:
    counts = NeuronCounts(Art2Config(), ON)
    counts.follow(won_by(used), 0.04)
    assert (counts.config.initial_neurons, counts.config.max_neurons) == (initial, most)
    counts.reset()
    assert (counts.config.initial_neurons, counts.config.max_neurons) == (15, 25)


def test_nothing_follows_unless_it_is_told_to() -> None:
    floor, counts = NoiseFloor(BackgroundConfig(), SelfTuningConfig()), NeuronCounts(Art2Config(), SelfTuningConfig())
    floor.follow(5.0, 0.04)
    counts.follow(won_by(100), 0.04)
    assert floor.config == BackgroundConfig()
    assert counts.config == Art2Config()


def tuned_after(config: PipelineConfig, noise_gray: float, frames: int = 12) -> tuple[MotionPipeline, Tuned]:
    pipeline, rng = MotionPipeline(config), np.random.default_rng(0)
    for index in range(frames):
        image = np.clip(scene(index) + rng.normal(0.0, noise_gray, scene(index).shape), 0, 255).astype(np.uint8)
        pipeline.process(image, (index + 1) * PERIOD_NS)
    return pipeline, pipeline.tuned


def test_a_noisy_scene_gets_a_higher_floor_and_one_mover_few_neurons() -> None:
    config = with_settings(PipelineConfig(), {'self_tuning.noise_floor': True, 'self_tuning.neurons': True})
    _, clean = tuned_after(config, 0.5)
    pipeline, noisy = tuned_after(config, 25.0)
    assert clean.noise_floor_px < GIVEN.noise_floor_px
    assert noisy.noise_floor_px > 1.5 * clean.noise_floor_px
    assert clean.initial_neurons < GIVEN.initial_neurons
    pipeline.reset()
    assert pipeline.tuned == GIVEN


def test_off_the_settings_in_use_are_those_given() -> None:
    assert tuned_after(PipelineConfig(), 25.0, 4)[1] == GIVEN
