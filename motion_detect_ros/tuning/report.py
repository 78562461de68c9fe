"""What a search came to, for people and for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from motion_detect_ros.tuning.study import Trial
from motion_detect_ros.tuning.tuner import Verdict

NO_GAIN = 'no gain shown'


def headline(verdict: Verdict) -> str:
    """One line: the gain on what was held out, or that there is none."""
    low, high = verdict.interval
    figures = f'{verdict.held_out_gain:+.3f} [{low:+.3f}, {high:+.3f}] on what was held out'
    return f'gain of {figures}' if verdict.shown else f'{NO_GAIN}: {figures}, the interval does not lie over 0'


def as_markdown(
    verdict: Verdict, start: Mapping[str, float], trials: Sequence[Trial], facts: Mapping[str, str],
) -> str:
    """The whole report. start: values that were searched, before; facts: what was done, name and text."""
    lines = ['# Tuning', '', f'**{headline(verdict)[0].upper()}{headline(verdict)[1:]}.**', '',
             f'Recommended: {"the tuned settings" if verdict.shown else "the start, unchanged"} (`preset.yaml`).', '',
             '| F1 | start | candidate | gain |', '|---|---|---|---|',
             f'| held out | {verdict.start_f1:.3f} | {verdict.candidate_f1:.3f} | {verdict.held_out_gain:+.3f} '
             f'[{verdict.interval[0]:+.3f}, {verdict.interval[1]:+.3f}] |',
             f'| searched on | | | {verdict.searched_gain:+.3f} (chosen by it: no evidence) |', '',
             *(f'- {name}: {text}' for name, text in facts.items()), '',
             '| setting | start | candidate |', '|---|---|---|',
             *(f'| `{name}` | {start[name]:.4g} | {value:.4g} |' for name, value in verdict.values.items()), '',
             '| trial | gain on what is searched on |', '|---|---|',
             *(f'| {trial.number} | {trial.gain:+.4f} |' for trial in trials)]
    return '\n'.join(lines) + '\n'


def as_json(
    verdict: Verdict, start: Mapping[str, float], trials: Sequence[Trial], facts: Mapping[str, str],
) -> dict[str, Any]:
    """The same as an object."""
    return {
        'gain_shown': verdict.shown,
        'held_out': {'start_f1': verdict.start_f1, 'candidate_f1': verdict.candidate_f1,
                     'gain': verdict.held_out_gain, 'interval': list(verdict.interval)},
        'searched_gain': verdict.searched_gain, 'start': dict(start), 'candidate': dict(verdict.values),
        'trials': [{'number': trial.number, 'gain': trial.gain, 'values': dict(trial.values)} for trial in trials],
        'facts': dict(facts)}
