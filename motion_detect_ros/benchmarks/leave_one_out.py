"""The thresholds of the detector, chosen anew without the clip that is then judged: what a clip never seen may lose.

    python -m motion_detect_ros.benchmarks.leave_one_out [--data DIR] [--jobs N] [--write docs/accuracy.md]

Every threshold of ``THRESHOLDS`` is tried a step lower and a step higher in all presets, the others as they are. A
choice takes of each threshold the value with the best mean F1 (of both IoUs) over the clips that it may see; all chosen
values together are then run. Chosen with every clip seen this is a fit in sample; without the judged clip it is
what leave-one-out cross-validation (Stone 1974) gives. About 20 minutes on two cores.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from pathlib import Path

import numpy as np

from motion_detect_ros.benchmarks.accuracy import add_run_arguments
from motion_detect_ros.benchmarks.accuracy_clips import Clip, ClipRun, Job, in_processes, read_clips, run_clip
from motion_detect_ros.benchmarks.accuracy_table import f1_table
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.settings import Scalar, settings
from motion_detect_ros.core.types import DoubleArray
from motion_detect_ros.presets import load_preset

SECTION = 'leave one out'
CORE = 'motion_detect_ros.core.'
#: A step multiplies a threshold by the first, or adds the second to log odds; the steps tried.
FACTOR, LOG_ODDS = 1.4, 1.0
STEPS = (-1, 1)


@dataclass(frozen=True)
class Threshold:
    """What is chosen: settings by their dotted names, or constants as ``module:NAME`` under ``core``.

    ``shift``: added at a step up; None multiplies by ``FACTOR``.
    """

    name: str
    places: tuple[str, ...]
    shift: float | None = None

    def at(self, step: int, value: float) -> float:
        """``value`` that many steps higher."""
        return value * FACTOR ** step if self.shift is None else value + step * self.shift


THRESHOLDS = (
    Threshold('least noise of the flow', ('background.noise_floor_px',)),
    Threshold('noise share of the camera-caused flow', ('background.noise_share',)),
    Threshold('forward-backward error of the flow', ('optical_flow.forward_backward_px',)),
    Threshold('smoothness of the flow', ('optical_flow.smoothness',)),
    Threshold('gain of the photometric test', ('objects.photometric_sigma',)),
    Threshold('share of the strongest gain', ('objects.peak_share',)),
    Threshold('match of neighbours that join', ('objects.join_match',)),
    Threshold('time to confirm', ('tracks.confirm_s',)),
    Threshold('time to coast', ('tracks.coast_s',)),
    Threshold('log odds of tracks', ('tracks.confirm_log_odds', 'tracks.show_log_odds'), LOG_ODDS),
    Threshold('log odds of a miss', ('tracking.track:MISS_LOG_ODDS',), LOG_ODDS),
    Threshold('memory of log odds', ('tracking.track:LOG_ODDS_MEMORY_S',)),
    Threshold('gain of sizes', ('tracking.track:SIZE_GAIN',)),
    Threshold('acceleration of tracks', ('tracking.track:ACCELERATION_SHARE',)),
    Threshold('significance of moving points', ('trajectories.object_motion:MOVING_SIGMAS',)),
    Threshold('difference of linked points', ('trajectories.alike:ALIKE_PX',)),
)
#: Thresholds to change and the steps; an empty choice is the detector as it stands.
Choice = tuple[tuple[Threshold, int], ...]


@dataclass(frozen=True)
class Values:
    """What a choice means for one preset: settings to change, and constants by module and name."""

    settings: Mapping[str, Scalar]
    constants: Mapping[tuple[str, str], float]


def values_of(choice: Choice, preset: str) -> Values:
    """The numbers of a choice, from those in use."""
    in_use = {name: value for name, value, _ in settings(load_preset(preset))}
    changed, constants = dict[str, Scalar](), dict[tuple[str, str], float]()
    for threshold, step in choice:
        for place in threshold.places:
            module, _, name = place.partition(':')
            if name:
                constants[module, name] = threshold.at(step, getattr(import_module(CORE + module), name))
            else:
                changed[place] = threshold.at(step, float(in_use[place]))
    return Values(changed, constants)


def run_choice(task: tuple[Clip, Choice]) -> ClipRun:
    """One clip with the thresholds of a choice."""
    clip, choice = task
    values = values_of(choice, clip.preset)
    with _constants(values.constants):
        return run_clip(Job(clip, values.settings))


@contextmanager
def _constants(values: Mapping[tuple[str, str], float]) -> Iterator[None]:
    modules = {module: import_module(CORE + module) for module, _ in values}
    before = {(module, name): getattr(modules[module], name) for module, name in values}
    try:
        for (module, name), value in values.items():
            setattr(modules[module], name, value)
        yield
    finally:
        for (module, name), value in before.items():
            setattr(modules[module], name, value)


def chosen(in_use: DoubleArray, tried: DoubleArray, seen: Sequence[int]) -> Choice:
    """The best value of each threshold over the clips ``seen``; the one in use where none is better.

    in_use: (C,) figure of every clip; tried: (T, 2, C) the same with every threshold at the two ``STEPS``.
    """
    best = []
    for threshold, figures in zip(THRESHOLDS, tried, strict=True):
        means = figures[:, seen].mean(axis=1)
        if means.max() > in_use[list(seen)].mean():
            best.append((threshold, STEPS[int(means.argmax())]))
    return tuple(best)


def choices_told(choices: Sequence[Choice]) -> list[str]:
    """Markdown: how often each threshold was chosen lower, as it is, and higher, of the choices."""
    lines = ['| threshold | lower | in use | higher |', '|---|---|---|---|']
    for threshold in THRESHOLDS:
        count = Counter(dict(choice).get(threshold, 0) for choice in choices)
        lines.append(f'| {threshold.name} | {count[-1]} | {count[0]} | {count[1]} |')
    return lines


def _f1(runs: Iterable[ClipRun]) -> DoubleArray:
    """(C,) mean over the IoUs."""
    return np.array([np.mean([score.f1 for score in run.scores()]) for run in runs])


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where there are fewer than two clips."""
    parser = argparse.ArgumentParser(prog='leave_one_out', description='Thresholds chosen without the judged clip.')
    add_run_arguments(parser)
    parser.add_argument('--clips', nargs='*', default=[], help='names of clips (default: all)')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the tables into this document, too')
    options = parser.parse_args(arguments)
    clips = read_clips(options.data, options.clips)
    if len(clips) < 2:
        raise SourceError(f'leave_one_out: expected two clips at least, got {len(clips)}')
    alone = [((threshold, step),) for threshold in THRESHOLDS for step in STEPS]
    runs = in_processes(run_choice, [(clip, choice) for choice in ((), *alone) for clip in clips], options.jobs)
    ways = {'in use': list(islice(runs, len(clips)))}
    in_use = _f1(ways['in use'])
    tried = np.array([_f1(islice(runs, len(clips))) for _ in alone]).reshape(len(THRESHOLDS), len(STEPS), len(clips))
    everything = list(range(len(clips)))
    fitted = chosen(in_use, tried, everything)
    without = [chosen(in_use, tried, [one for one in everything if one != index]) for index in everything]
    tasks = [(clip, fitted) for clip in clips] + list(zip(clips, without, strict=True))
    runs = in_processes(run_choice, tasks, options.jobs)
    ways |= {name: list(islice(runs, len(clips))) for name in ('chosen on all', 'chosen without the clip')}
    told = ', '.join(f'{threshold.name} {"higher" if step > 0 else "lower"}' for threshold, step in fitted)
    told = f'Chosen on all: {told or "what is in use"}. Without a clip, of {len(clips)} choices:'
    show([*f1_table(clips, ways), '', told, '', *choices_told(without)], options.write, SECTION)
    return 0


if __name__ == '__main__':
    sys.exit(main())
