"""What ``evaluate`` prints: one clip, many clips with their mean, several runs side by side, and the same as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from motion_detect_ros.results.bootstrap import Bootstrap
from motion_detect_ros.results.evaluation import ClipEvaluation, Figure, counting_of
from motion_detect_ros.results.identity import TrackScore
from motion_detect_ros.results.metrics import Score

MEAN = 'mean'
#: Columns of one run's score: heading and width.
_HEADINGS = 'precision  recall     F1   hits  false missed false/frame'


def as_lines(clips: Sequence[ClipEvaluation], figures: Sequence[Figure], plan: Bootstrap | None) -> list[str]:
    """The table of one clip, of many clips, or of several runs."""
    if len(clips[0].files) > 1:
        lines = _comparison(clips, figures)
    elif len(clips) > 1:
        lines = _many(clips, figures)
    else:
        lines = _one(clips[0], figures)
    return [*lines, *([plan.meaning(len(clips))] if plan else []),
            *([f'caution: {caution}'] if (caution := _caution(clips, plan)) else [])]


def as_json(
    clips: Sequence[ClipEvaluation], figures: Sequence[Figure], plan: Bootstrap | None,
    identity: Mapping[str, Mapping[str, TrackScore]],
) -> str:
    """One object: the scores of the only clip, or ``clips`` and ``mean``; of several runs one of these each."""
    content: dict[str, Any]
    runs = list(clips[0].files)
    if len(clips) == 1 and len(runs) == 1:
        content = _clip_as_json(clips[0], figures, runs[0])
        for figure in figures if plan else ():
            content[figure.name]['interval'] = list(_possible(figure.intervals[runs[0]]))
    else:
        content = {'runs': {run: {
            'clips': {clip.name: _clip_as_json(clip, figures, run) for clip in clips},
            MEAN: {figure.name: _mean_as_json(figure, run) for figure in figures}} for run in runs}}
        content = content if len(runs) > 1 else content['runs'][runs[0]]
    if plan:
        content['interval'] = plan.meaning(len(clips))
    if caution := _caution(clips, plan):
        content['caution'] = caution
    if identity:
        content['identity'] = {run: {clip: asdict(score) for clip, score in scores.items()}
                               for run, scores in identity.items()}
    return json.dumps(content)


def _clip_as_json(clip: ClipEvaluation, figures: Sequence[Figure], run: str) -> dict[str, Any]:
    content: dict[str, Any] = {
        'frames': len(clip.frames), 'truth': clip.truth.form, 'counting': counting_of(clip.truth)}
    for figure in figures:
        score = figure.scores[clip.name][run]
        content[figure.name] = {
            'precision': score.precision, 'recall': score.recall, 'f1': score.f1, 'gt': score.wanted,
            'true_positives': score.true_positives, 'false_positives': score.false_positives,
            'false_negatives': score.wanted - score.true_positives, 'false_per_frame': score.false_per_frame}
    return content


def _mean_as_json(figure: Figure, run: str) -> dict[str, Any]:
    scores = [by_run[run] for by_run in figure.scores.values()]
    content: dict[str, Any] = {name: float(np.mean([getattr(score, name) for score in scores]))
                               for name in ('precision', 'recall', 'f1', 'false_per_frame')}
    if run in figure.intervals:
        content['interval'] = list(_possible(figure.intervals[run]))
    if run in figure.differences:
        first = next(iter(figure.means))
        content['difference'] = figure.means[run] - figure.means[first]
        content['difference_interval'] = list(_possible(figure.differences[run], -1.0))
    return content


def _one(clip: ClipEvaluation, figures: Sequence[Figure]) -> list[str]:
    (run,) = clip.files
    return [_what([clip]), f'{"counting@IoU":12s} {_HEADINGS}',
            *(f'{figure.name:12s} {_cells(figure.scores[clip.name][run])}{_f1_interval(figure, run)}'
              for figure in figures)]


def _many(clips: Sequence[ClipEvaluation], figures: Sequence[Figure]) -> list[str]:
    (run,) = clips[0].files
    width = max(len(clip.name) for clip in clips)
    lines = [_what(clips)]
    for figure in figures:
        scores = [figure.scores[clip.name][run] for clip in clips]
        lines += ['', f'{figure.name:{width}s} {_HEADINGS}',
                  *(f'{clip.name:{width}s} {_cells(score)}' for clip, score in zip(clips, scores, strict=True)),
                  f'{MEAN:{width}s} {_mean_cells(scores)}{_f1_interval(figure, run)}']
    return [*lines, '']


def _comparison(clips: Sequence[ClipEvaluation], figures: Sequence[Figure]) -> list[str]:
    runs = list(clips[0].files)
    width = max(len('F1, moving@0.3'), *(len(clip.name) for clip in clips))
    letters = [chr(ord('A') + number % 26) for number in range(len(runs))]
    lines = [_what(clips), *(f'{letter}: {run}' for letter, run in zip(letters, runs, strict=True))]
    heads = [f'{letter:>6s}' for letter in letters] + [f'{letter:>6s} - A' for letter in letters[1:]]
    for figure in figures:
        lines += ['', f'{"F1, " + figure.name:{width}s} {" ".join(heads)}']
        lines += [f'{clip.name:{width}s} {_f1_cells([figure.scores[clip.name][run].f1 for run in runs])}'
                  for clip in clips]
        if len(clips) > 1:
            lines.append(f'{MEAN:{width}s} {_f1_cells([figure.means[run] for run in runs])}')
        lines += [f'  {letter} - A{_interval(_possible(figure.differences[run], -1.0), "+")}'
                  + ('' if _excludes_zero(figure.differences[run]) else ': no difference shown')
                  for letter, run in zip(letters[1:], runs[1:], strict=True) if figure.differences]
    return [*lines, '']


def _what(clips: Sequence[ClipEvaluation]) -> str:
    """How much there is of what kind, one line."""
    count = f'{len(clips)} clips, ' if len(clips) > 1 else ''
    return (f'{count}{sum(len(clip.frames) for clip in clips)} frames; '
            + '; '.join(dict.fromkeys(counting_of(clip.truth) for clip in clips)))


def _caution(clips: Sequence[ClipEvaluation], plan: Bootstrap | None) -> str:
    late = ', '.join(f'{clip.late_labels} labels of {clip.name}' for clip in clips if clip.late_labels)
    cautions = [f'{late} are of frames after the end of the replay and count nowhere'] if late else []
    if plan and (few := plan.caution([len(clip.frames) for clip in clips])):
        cautions.append(few)
    return '; '.join(cautions)


def _possible(interval: tuple[float, float], least: float = 0.0) -> tuple[float, float]:
    """The part of it that F1 can have, or with ``least`` -1 a difference of two."""
    return max(interval[0], least), min(interval[1], 1.0)


def _excludes_zero(interval: tuple[float, float]) -> bool:
    return interval[0] > 0 or interval[1] < 0


def _f1_cells(values: Sequence[float]) -> str:
    return ' '.join([f'{value:6.3f}' for value in values] + [f'{value - values[0]:+10.3f}' for value in values[1:]])


def _cells(score: Score) -> str:
    return (f'{score.precision:9.3f} {score.recall:7.3f} {score.f1:6.3f} {score.true_positives:6d} '
            f'{score.false_positives:6d} {score.wanted - score.true_positives:6d} {score.false_per_frame:11.2f}')


def _mean_cells(scores: Sequence[Score]) -> str:
    precision, recall, f1, false = (float(np.mean([getattr(score, name) for score in scores]))
                                    for name in ('precision', 'recall', 'f1', 'false_per_frame'))
    return f'{precision:9.3f} {recall:7.3f} {f1:6.3f} {"":6s} {"":6s} {"":6s} {false:11.2f}'


def _interval(interval: tuple[float, float], sign: str = '') -> str:
    return f' [{interval[0]:{sign}.3f}, {interval[1]:{sign}.3f}]'


def _f1_interval(figure: Figure, run: str) -> str:
    return _interval(_possible(figure.intervals[run])) if run in figure.intervals else ''
