"""Intervals: coverage over made worlds whose truth is known, and cases worked by hand."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from motion_detect_ros.results.bootstrap import Bootstrap, f1_of, resampled_f1

#: Frames whose luck holds together, in the made worlds.
RUN_FRAMES = 10


def world(rng: np.random.Generator, rate: float, frames: int = 400) -> np.ndarray:
    """(1, F, 3) counts: ten objects a frame, of which all or none are found, for runs of frames; nothing false."""
    found = np.repeat(rng.random(-(-frames // RUN_FRAMES)) < rate, RUN_FRAMES)[:frames]
    return np.stack([10 * found, np.zeros(frames), np.full(frames, 10)], axis=-1)[None].astype(np.int64)


def test_f1_by_hand() -> None:
    assert f1_of(np.array([[6, 2, 10], [0, 0, 0]])).tolist() == [pytest.approx(2 * 6 / 18), 0.0]


def test_intervals_of_blocks_hold_the_truth_as_often_as_they_say() -> None:
    """Recall 0.6 and precision 1 give F1 0.75. Single frames would give intervals a third as wide."""
    rng, held, widths = np.random.default_rng(1), 0, {10: 0.0, 1: 0.0}
    for trial in range(100):
        counts = world(rng, 0.6)
        for block in widths:
            plan = Bootstrap(300, block, seed=trial)
            low, high = plan.interval(resampled_f1([counts], plan)[:, 0])
            widths[block] += high - low
            held += block == 10 and low <= 0.75 <= high
    assert 85 <= held <= 100
    assert widths[10] > 2.5 * widths[1]


def test_clips_that_differ_widen_the_interval_of_their_mean() -> None:
    rng = np.random.default_rng(2)
    alike, unlike = ([world(rng, rate, 2000) for rate in rates] for rates in ([0.5] * 6, [0.1, 0.9] * 3))
    plan = Bootstrap(500)
    narrow, wide = (np.ptp(plan.interval(resampled_f1(clips, plan)[:, 0])) for clips in (alike, unlike))
    assert wide > 3 * narrow


def test_runs_share_their_draws() -> None:
    """A run that is better by the same in every frame: the difference has no spread, each run alone has much."""
    counts = world(np.random.default_rng(3), 0.5)
    equal = np.concatenate([counts, counts])
    drawn = resampled_f1([equal, equal], Bootstrap(200))
    assert drawn.shape == (200, 2)
    assert (drawn[:, 0] == drawn[:, 1]).all()
    assert np.ptp(drawn[:, 0]) > 0.05


def test_a_seed_gives_the_same_interval_and_another_one_another() -> None:
    counts = world(np.random.default_rng(4), 0.5)
    same, again, other = (resampled_f1([counts], Bootstrap(50, seed=seed)) for seed in (5, 5, 6))
    assert (same == again).all()
    assert (same != other).any()


def test_few_frames_are_said() -> None:
    plan = Bootstrap(block_frames=20)
    assert plan.caution([99]).startswith('99 frames are few: with under 100, blocks are cut short')
    assert plan.caution([900, 99]).startswith('99 frames of the shortest clip are few: with under 100')
    assert plan.caution([399]).startswith('19 blocks are few: with under 20')
    assert plan.caution([400]) == ''
    assert plan.caution([400] * 19).startswith('19 clips are few: with under 20')
    assert plan.caution([100] * 20) == ''
    assert Bootstrap(block_frames=20, draws_clips=False).caution([100] * 4) == ''


def test_few_blocks_are_stretched_as_by_student() -> None:
    """Of 8 blocks: t = 2.3646 with 7 degrees of freedom, z = 1.9600 (tables), sqrt(8 / 7) = 1.0690."""
    assert Bootstrap().stretch(8, 7) == pytest.approx(2.3646 / 1.9600 * 1.0690, abs=1e-3)
    assert Bootstrap().stretch(100_000, 99_999) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize('frames', [125, 200])
def test_intervals_of_few_blocks_hold_the_truth_nearly_as_often_as_they_say(frames: int) -> None:
    """The plain percentile interval does in 85 of 100 and fewer."""
    rng, held = np.random.default_rng(7), 0
    for trial in range(300):
        low, high = Bootstrap().interval(resampled_f1([world(rng, 0.6, frames)], Bootstrap(300, seed=trial))[:, 0])
        held += low <= 0.75 <= high
    assert held >= 0.9 * 300


def test_clips_that_are_not_drawn_do_not_widen_the_interval() -> None:
    rng = np.random.default_rng(8)
    unlike = [world(rng, rate, 2000) for rate in [0.1, 0.9] * 3]
    drawn, fixed = (np.ptp(resampled_f1(unlike, Bootstrap(500, draws_clips=draws))) for draws in (True, False))
    assert drawn > 3 * fixed


def test_many_draws_of_a_long_clip_take_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """An hour of 30 Hz is 4320 blocks: their numbers alone are 173 MB of 5000 draws. Same draws, a few at once."""
    counts, plan = world(np.random.default_rng(9), 0.6, 108_000), Bootstrap(5000, draws_clips=False)
    tracemalloc.start()
    try:
        few_at_once = resampled_f1([counts], plan)
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()
    monkeypatch.setattr('motion_detect_ros.results.bootstrap.AT_ONCE', 10 ** 9)
    np.testing.assert_array_equal(few_at_once, resampled_f1([counts], plan))


@pytest.mark.parametrize('frames', [0, 1, 3])
def test_clips_of_hardly_any_frames(frames: int) -> None:
    counts = np.tile(np.array([1, 0, 1]), (1, frames, 1))
    assert resampled_f1([counts], Bootstrap(20))[:, 0].tolist() == [float(frames > 0)] * 20
