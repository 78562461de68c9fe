"""Tunes what stands in ART2's place in the ablation: every choice of the grids over all real clips.

    python -m motion_detect_ros.benchmarks.substitute_grid [METHOD ...] [--data DIR] [--jobs N]

Prints the mean F1 over the clips for each choice; the best of each method are the constants of
``benchmarks.ablation``. The clips are those that the table then shows: the best is in-sample, as the presets are.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from functools import partial

from motion_detect_ros.benchmarks.accuracy import add_run_arguments
from motion_detect_ros.benchmarks.accuracy_clips import Clip, in_processes, read_clips
from motion_detect_ros.benchmarks.accuracy_record import Figures
from motion_detect_ros.benchmarks.substitutes import Choice, check, grids, run_choices
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import MotionDetectError


def figures_of(choices: Sequence[Choice], clip: Clip) -> list[Figures]:
    """Of one clip, moving objects wanted."""
    return [Figures.of(run, 'moving') for run in run_choices(clip, choices)]


def rows(method: str, choices: Sequence[Choice], means: Iterable[Figures]) -> list[str]:
    """Markdown, best mean of both F1 first, the first of equals."""
    ranked = sorted(zip(choices, means, strict=True), key=lambda pair: -(pair[1].f1_30 + pair[1].f1_50))
    return [f'| {method} | {mean.f1_30:.3f} | {mean.f1_50:.3f} | {mean.false_per_frame:.2f} | {choice} |'
            for choice, mean in ranked]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips are missing or scikit-learn is."""
    parser = argparse.ArgumentParser(prog='substitute_grid', description='Tunes what stands in the place of ART2.')
    parser.add_argument('methods', nargs='*', choices=[*grids(), []], help='default: all')
    add_run_arguments(parser)
    parser.add_argument('--clips', nargs='*', default=[], help='names of clips (default: all)')
    options = parser.parse_args(arguments)
    grid = {name: choices for name, choices in grids().items() if not options.methods or name in options.methods}
    every = [choice for choices in grid.values() for choice in choices]
    try:
        for choice in every:
            check(PipelineConfig(), choice)
        clips = read_clips(options.data, options.clips)
    except MotionDetectError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    found = list(in_processes(partial(figures_of, every), clips, options.jobs))
    means = iter([Figures.mean(one) for one in zip(*found, strict=True)])
    print('| method | F1 at 0.3 | F1 at 0.5 | false boxes a frame | choice |\n|---|---|---|---|---|')
    for method, choices in grid.items():
        print('\n'.join(rows(method, choices, [next(means) for _ in choices])))
    return 0


if __name__ == '__main__':
    sys.exit(main())
