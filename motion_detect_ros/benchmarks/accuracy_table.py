"""Tables of accuracy: a run with means by data set and the change against an earlier one, and runs side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

import numpy as np

from motion_detect_ros.benchmarks.accuracy_clips import IOUS, Clip, ClipRun
from motion_detect_ros.benchmarks.accuracy_record import Figures, Record

HEAD = ['| clip | F1 at 0.3 | F1 at 0.5 | precision | recall | false boxes a frame | ms a frame |',
        '|---|---|---|---|---|---|---|']
#: Changes of less are not shown.
SHOWN_CHANGE = 0.005


def table(run: Record, before: Record | None = None, counting: str = 'moving') -> list[str]:
    """Markdown: a row a clip, a mean for each data set of several clips, the mean of all.

    before: shown as the change of each figure, means over the clips that both have. counting: 'moving' or 'all'.
    """
    figures = run.figures(counting)
    old = before.figures(counting) if before else {}
    return [*HEAD, *_rows(figures, old, {name: clip.frame_ms for name, clip in run.clips.items()})]


def _rows(figures: Mapping[str, Figures], old: Mapping[str, Figures], times: Mapping[str, float]) -> Iterator[str]:
    for family, members in groupby(figures, lambda name: name.split('_', maxsplit=1)[0]):
        names = list(members)
        for name in names:
            yield _row(f'`{name}`', figures[name], figures[name], old.get(name), times[name])
        if 1 < len(names) < len(figures):
            yield _mean_row(f'*mean of {len(names)} {family}*', names, figures, old, times)
    yield _mean_row(f'mean of {len(figures)}', list(figures), figures, old, times)


def _mean_row(
    title: str, names: list[str], figures: Mapping[str, Figures], old: Mapping[str, Figures],
    times: Mapping[str, float],
) -> str:
    shared = [name for name in names if name in old]
    now = Figures.mean([figures[name] for name in shared]) if shared else None
    before = Figures.mean([old[name] for name in shared]) if shared else None
    mean = Figures.mean([figures[name] for name in names])
    return _row(title, mean, now or mean, before, float(np.mean([times[name] for name in names])))


def _row(title: str, figures: Figures, now: Figures, before: Figures | None, frame_ms: float) -> str:
    """now: what ``before`` is compared with, for a mean that of the clips both have."""
    cells = [f'{getattr(figures, name):.2f}{change(getattr(now, name), getattr(before, name) if before else None)}'
             for name in ('f1_30', 'f1_50', 'precision', 'recall', 'false_per_frame')]
    return f'| {title} | ' + ' | '.join(cells) + f' | {frame_ms:.0f} |'


def change(now: float, before: float | None) -> str:
    """' (+0.02)', or nothing where there is nothing to compare or no change that shows."""
    if before is None or abs(now - before) < SHOWN_CHANGE:
        return ''
    return f' ({now - before:+.2f})'


def f1_table(clips: Sequence[Clip], runs: Mapping[str, Sequence[ClipRun]]) -> list[str]:
    """Markdown, a row a clip and the mean, a column a kind of run: F1 at each of ``IOUS``."""
    found = np.array([[[score.f1 for score in run.scores()] for run in each] for each in runs.values()])
    found = np.concatenate([found, found.mean(axis=1, keepdims=True)], axis=1)
    names = [*(f'`{clip.name}`' for clip in clips), f'mean of {len(clips)}']
    return [f'| F1 at {" / ".join(f"{iou:g}" for iou in IOUS)} | {" | ".join(runs)} |', '|---' * (len(runs) + 1) + '|',
            *(f'| {name} | ' + ' | '.join(' / '.join(f'{f1:.3f}' for f1 in cell) for cell in row) + ' |'
              for name, row in zip(names, found.transpose(1, 0, 2).tolist(), strict=True))]
