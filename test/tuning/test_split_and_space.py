"""What is held out, and what is searched."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.settings import settings, with_settings
from motion_detect_ros.tuning.space import FOLLOWS, SEARCHED, changed, dimensions
from motion_detect_ros.tuning.split import GUARD_FRAMES, describe, split_frames


@pytest.mark.parametrize('seed', range(6))
def test_blocks_of_one_recording(seed: int) -> None:
    (split,) = split_frames([600], seed)
    assert split.held_out.sum() == 200, 'two of six blocks'
    assert not (split.searched & split.held_out).any()
    searched, held = np.flatnonzero(split.searched), np.flatnonzero(split.held_out)
    assert np.abs(searched[:, None] - held).min() == GUARD_FRAMES + 1, 'tracks reach across the edges'
    assert np.count_nonzero(np.diff(held) > 1) == 1, 'two contiguous blocks'


@pytest.mark.parametrize('seed', range(6))
def test_of_twelve_recordings_and_more_whole_ones_are_held_out(seed: int) -> None:
    splits = split_frames([60] * 12, seed)
    assert sum(split.held_out.all() for split in splits) == 4
    assert all(split.held_out.all() != split.searched.all() for split in splits)
    assert describe(splits).startswith('4 of 12 recordings')


@pytest.mark.parametrize('recordings', [1, 3, 9, 11])
def test_of_fewer_a_part_of_every_one(recordings: int) -> None:
    splits = split_frames([600] * recordings, 0)
    assert [(split.held_out.sum(), split.searched.any()) for split in splits] == [(200, True)] * recordings
    assert describe(splits).startswith('every third of 6 blocks of each recording')


def test_seeds_hold_out_different_parts() -> None:
    assert len({split_frames([600], seed)[0].held_out.tobytes() for seed in range(20)}) == 3


def test_ranges_lie_within_those_of_the_settings() -> None:
    known = {name: (value, metadata) for name, value, metadata in settings(PipelineConfig())}
    for one in SEARCHED:
        value, metadata = known[one.name]
        assert metadata['low'] <= one.low < one.high <= metadata['high'], one.name
        assert one.low <= value <= one.high, f'{one.name}: the default is outside'
    assert {*FOLLOWS, *FOLLOWS.values()} <= set(known)


def test_what_follows_keeps_its_distance() -> None:
    start = with_settings(PipelineConfig(), {'tracks.confirm_log_odds': -1.0, 'tracks.show_log_odds': -2.5})
    moved = changed(start, {'tracks.confirm_log_odds': 2.0})
    assert (moved.tracks.confirm_log_odds, moved.tracks.show_log_odds) == (2.0, 0.5)


def test_named_settings() -> None:
    chosen = dimensions(['objects.peak_share', 'objects.min_side_px'])
    assert [one.name for one in chosen] == ['objects.peak_share', 'objects.min_side_px']
    assert (chosen[1].low, chosen[1].high) == (1.0, 1000.0)
    with pytest.raises(ConfigError, match="unknown setting 'peak'"):
        dimensions(['peak'])
    with pytest.raises(ConfigError, match=r'art2.max_neurons: expected a setting with a range of floats, got 25'):
        dimensions(['art2.max_neurons'])
