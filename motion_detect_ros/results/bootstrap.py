"""How far a figure depends on the frames and clips it was measured on: intervals by the bootstrap.

Errors come in runs, so that not frames but blocks of consecutive frames are drawn, with replacement (block bootstrap,
Künsch 1989); for a mean over clips, clips are drawn first and then blocks within each (two-stage bootstrap, Davison and
Hinkley 1997, section 3.8). Several runs over the same clips share every draw, so that their difference is a paired one.

Of few blocks or clips the plain percentile interval is too narrow. Draws are therefore stretched about the estimate, as
Student's t stretches the interval of a mean of n: by t / z * sqrt(n / (n - 1)) (expanded percentile
interval, Hesterberg 2015).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.types import DoubleArray
from motion_detect_ros.results.metrics import CountArray

#: A clip is cut into at least so many blocks, where it has as many frames.
MIN_BLOCKS = 5
#: Of fewer blocks, or clips where clips are drawn, even the stretched interval is a rough one.
ENOUGH = 20
#: Blocks that are drawn at once, of all the draws of a long clip.
AT_ONCE = 10 ** 6


@dataclass(frozen=True)
class Bootstrap:
    """``resamples``: draws; ``block_frames``: frames of a block, fewer in short clips; ``confidence``: 0 .. 1;
    ``draws_clips``: whether the interval is to hold for other clips of the kind too, or for these only.
    """

    resamples: int = 1000
    block_frames: int = 25
    seed: int = 0
    confidence: float = 0.95
    draws_clips: bool = True

    def meaning(self, clips: int) -> str:
        """What the interval says, for people."""
        drawn = f'blocks of {self.block_frames} frames'
        if clips > 1:
            drawn = f'clips and, in them, {drawn}' if self.draws_clips else f'{drawn} in each clip'
        beyond = 'scenes' if self.draws_clips else 'recordings'
        return (f'[low, high]: {self.confidence:.0%} interval of F1 over {self.resamples} draws of {drawn} (seed '
                f'{self.seed}): how far it depends on what was recorded; it says nothing of other {beyond}')

    def caution(self, frames: Sequence[int]) -> str:
        """What is to be said where there is too little for a sound interval; empty where there is enough.

        frames: of each clip.
        """
        shortest, whole = min(frames, default=0), MIN_BLOCKS * self.block_frames
        if shortest < whole:
            return (f'{shortest} frames{" of the shortest clip" if len(frames) > 1 else ""} are few: with under '
                    f'{whole}, blocks are cut short, and the interval is narrower than it should be')
        clips = self.draws_clips and len(frames) > 1
        number = len(frames) if clips else sum(map(self.blocks, frames))
        return '' if number >= ENOUGH else (
            f'{number} {"clips" if clips else "blocks"} are few: with under {ENOUGH} the interval is a rough one')

    def blocks(self, frames: int) -> int:
        """How many a clip of so many frames is cut into."""
        return max(1, min(MIN_BLOCKS, frames), frames // self.block_frames)

    def stretch(self, number: int, freedom: int) -> float:
        """By how much draws of ``number`` equal parts are to be stretched, with so many degrees of freedom."""
        if number < 2:
            return 1.0
        upper = (1 + self.confidence) / 2
        from scipy.special import ndtri, stdtrit  # 0.2 s, which only who asks for it shall wait
        return float(stdtrit(freedom, upper) / ndtri(upper) * np.sqrt(number / (number - 1)))

    def interval(self, values: DoubleArray) -> tuple[float, float]:
        """The percentile interval of (n,) resampled values."""
        low, high = np.quantile(values, [(1 - self.confidence) / 2, (1 + self.confidence) / 2])
        return float(low), float(high)


def f1_of(counts: DoubleArray | CountArray) -> DoubleArray:
    """F1 of (..., 3) hits, false predictions and wanted boxes; 0 where there are none."""
    hits, false, wanted = np.moveaxis(np.asarray(counts, np.float64), -1, 0)
    f1: DoubleArray = 2.0 * hits / np.maximum(hits + false + wanted, 1.0)
    return f1


def resampled_f1(clips: Sequence[CountArray], plan: Bootstrap) -> DoubleArray:
    """(n, R) mean F1 over the clips, of R runs, for each of n draws, stretched about the mean that was measured.

    clips: of each one (R, F, 3) counts of its F frames (``metrics.frame_counts``), the same frames for every run.
    Stretched values may lie outside of 0 .. 1.
    """
    rng = np.random.default_rng(plan.seed)
    within = np.stack([_within(counts, plan, rng) for counts in clips])
    measured = np.stack([f1_of(counts.sum(axis=1)) for counts in clips])
    if len(clips) > 1 and plan.draws_clips:
        drawn = rng.integers(0, len(clips), (len(clips), plan.resamples))
        inner = rng.integers(0, plan.resamples, (len(clips), plan.resamples))
        off = (within[drawn, inner].mean(axis=0) - measured.mean(axis=0)) * plan.stretch(len(clips), len(clips) - 1)
    else:
        numbers = [plan.blocks(counts.shape[1]) for counts in clips]
        freedom = sum(numbers) - len(numbers)
        stretches = np.array([plan.stretch(number, freedom) for number in numbers])
        off = ((within - measured[:, None]) * stretches[:, None, None]).mean(axis=0)
    stretched: DoubleArray = measured.mean(axis=0) + off
    return stretched


def _within(counts: CountArray, plan: Bootstrap, rng: np.random.Generator) -> DoubleArray:
    """(n, R) F1 of one clip from drawn blocks."""
    frames = counts.shape[1]
    number = plan.blocks(frames)
    starts = np.arange(number) * frames // number
    blocks = np.add.reduceat(counts, starts, axis=1) if frames else np.zeros((len(counts), 1, 3), np.int64)
    resampled, step = np.empty((plan.resamples, len(counts))), max(1, AT_ONCE // number)
    for first in range(0, plan.resamples, step):
        some = resampled[first:first + step]
        some[:] = f1_of(blocks[:, rng.integers(0, number, (len(some), number))].sum(axis=2)).T
    return resampled
