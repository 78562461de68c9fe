"""Agreement of a run forwards with one backwards, by hand."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.results.bootstrap import f1_of
from motion_detect_ros.results.found import Found
from motion_detect_ros.tuning.agreement import against_each_other, agreement

FRAMES = range(10)


def found(*objects: tuple[range, float, int]) -> Found:
    """Squares of 10 px: (frames in which it is found, x, id)."""
    boxes = {frame: np.array([(x, 0, 10, 10) for frames, x, _ in objects if frame in frames], float).reshape(-1, 4)
             for frame in FRAMES}
    return Found(boxes, {frame: [ident for frames, _, ident in objects if frame in frames] for frame in FRAMES})


def total(forward: Found, backward: Found) -> list[int]:
    return agreement(forward, backward, FRAMES, 0.3).sum(axis=0).tolist()


def test_the_same_in_both_directions() -> None:
    assert total(found((FRAMES, 0, 1), (FRAMES, 50, 2)), found((FRAMES, 0, 9), (FRAMES, 50, 8))) == [20, 0]


def test_noise_of_one_direction_agrees_with_nothing() -> None:
    assert total(found((FRAMES, 0, 1), (range(4), 80, 2)), found((FRAMES, 0, 9), (range(4), 120, 8))) == [10, 8]


def test_a_broken_track_keeps_its_longer_piece_only() -> None:
    """Six frames of ten agree; in four frames both runs have a box of a track that is matched with none, or another."""
    assert total(found((range(6), 0, 1), (range(6, 10), 0, 2)), found((FRAMES, 0, 9))) == [6, 8]


def test_nothing_anywhere() -> None:
    assert total(found(), found()) == [0, 0]


def test_finding_less_is_no_gain() -> None:
    """A start that agrees on two objects, a candidate on one of them: the other one becomes a miss."""
    both, one = found((FRAMES, 0, 1), (FRAMES, 50, 2)), found((FRAMES, 0, 1))
    counts = against_each_other(agreement(both, both, FRAMES, 0.3), agreement(one, one, FRAMES, 0.3))
    assert f1_of(counts.sum(axis=1)).tolist() == [1.0, 2 / 3]  # of 2 wanted 1 hit, none false: 2 / (1 + 2)
