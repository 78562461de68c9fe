"""What is searched on and what is held out, so that the gain that is reported was not chosen for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from motion_detect_ros.core.types import BoolArray

#: From so many recordings on whole ones are held out, every third, and thus four or more, as fewer say nothing of
#: others; else every third block of frames of each.
MIN_RECORDINGS, EVERY = 12, 3
#: Contiguous blocks that a recording is cut into.
BLOCKS = 6
#: Frames beside a held-out block that are not searched on: tracks reach across. At most this share of a block.
GUARD_FRAMES, GUARD_SHARE = 10, 0.25


@dataclass(frozen=True)
class Split:
    """(F,) bool each: frames of a recording that are searched on, and frames held out; none is both."""

    searched: BoolArray
    held_out: BoolArray


def split_frames(counts: Sequence[int], seed: int) -> list[Split]:
    """The split of each recording of so many frames; which third is held out follows from the seed."""
    rng = np.random.default_rng(seed)
    if len(counts) >= MIN_RECORDINGS:
        held = set(rng.permutation(len(counts))[:len(counts) // EVERY].tolist())
        return [Split(np.full(frames, number not in held), np.full(frames, number in held))
                for number, frames in enumerate(counts)]
    return [_blocks(frames, int(rng.integers(EVERY))) for frames in counts]


def describe(splits: Sequence[Split]) -> str:
    """What is held out, for people."""
    whole = [split for split in splits if split.held_out.all()]
    frames = sum(int(split.held_out.sum()) for split in splits)
    if whole:
        return f'{len(whole)} of {len(splits)} recordings ({frames} frames)'
    return f'every third of {BLOCKS} blocks of each recording ({frames} frames)'


def _blocks(frames: int, which: int) -> Split:
    edges = np.linspace(0, frames, BLOCKS + 1).round().astype(int)
    held = np.zeros(frames, bool)
    for first, last in list(pairwise(edges.tolist()))[which::EVERY]:
        held[first:last] = True
    guard = min(GUARD_FRAMES, int(GUARD_SHARE * frames / BLOCKS))
    near = np.convolve(held, np.ones(2 * guard + 1), mode='same') > 0
    return Split(~near, held)
