"""What each part of the detector is worth: every part off in turn, or another in its place, on all real clips.

    python -m motion_detect_ros.benchmarks.ablation [PART ...] [--data DIR] [--jobs N] [--write docs/accuracy.md]
        [--list]

Prints a markdown table: mean F1 over the clips and false boxes a frame, each with its change against the presets.
Rows with DBSCAN and k-means need scikit-learn (the extra ``compare``) and are left out without, with a note.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from motion_detect_ros.benchmarks.accuracy import add_run_arguments
from motion_detect_ros.benchmarks.accuracy_clips import Clip, ClipRun, Job, in_processes, read_clips, run_clip
from motion_detect_ros.benchmarks.accuracy_record import Figures
from motion_detect_ros.benchmarks.accuracy_table import change
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import replace_section
from motion_detect_ros.benchmarks.substitutes import DBSCAN, KMEANS, ONE_CLUSTER, Choice, Substitute, run_choices
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import BackendError, SourceError
from motion_detect_ros.core.settings import Scalar, with_settings

#: The whole detector, as the presets have it.
WHOLE = 'nothing'
SECTION = 'ablation'


@dataclass(frozen=True)
class Part:
    """One part and the settings that take it out; ``note`` where they only come near to that.

    ``substitute``: what clusters in ART2's place.
    """

    name: str
    off: Mapping[str, Scalar]
    note: str = ''
    substitute: Substitute | None = None


#: With nothing to confirm, a track is reported at its first detection.
AT_ONCE: Mapping[str, Scalar] = {
    'tracks.confirm_s': 0.0, 'tracks.confirm_log_odds': -100.0,
    'tracks.show_log_odds': -100.0}

PARTS = (
    Part('three-dimensional background', {'background.model': 'planar'}),
    Part('ego-motion beyond a shift', {'ego_motion.model': 'translation'}),
    Part('Kalman filter of the ego-motion', {'ego_motion.smoothing': 'none'}),
    Part('forward-backward check of the ego-motion', {'ego_motion.forward_backward_px': 10.0}, 'limit 10 px'),
    Part('RANSAC of the ego-motion', {'ego_motion.ransac_threshold_px': 20.0}, 'limit 20 px'),
    Part('variational refinement of the flow', {'optical_flow.refinement_iterations': 0}),
    Part('forward-backward check of the flow', {'optical_flow.forward_backward_px': 20.0}, 'limit 20 px'),
    Part('noise share of the camera-caused flow', {
        'background.noise_share': 0.0, 'background.depth_noise_share': 0.0}),
    Part('least noise of the flow', {'background.noise_floor_px': 0.01}),
    Part('ART2: one neuron beside the background', {'art2.initial_neurons': 2, 'art2.max_neurons': 2},
         'what it matches worse than the background does stays background'),
    Part('ART2: all that moves is one cluster', {}, substitute=Substitute(ONE_CLUSTER)),
    Part('ART2: DBSCAN in its place', {}, substitute=Substitute(DBSCAN, {'eps': 2.0, 'min_samples': 10})),
    Part('ART2: k-means in its place', {}, substitute=Substitute(KMEANS, {'n_clusters': 25})),
    Part('ART2: the classic variant in its place', {
        'art2.variant': 'classic', 'art2.vigilance': 0.95, 'art2.background_sigma': 4.0}),
    Part('joining of neighbouring clusters', {'objects.join_match': 1.0}),
    Part('photometric test', {'objects.photometric_sigma': 0.1}, 'any gain at all is enough'),
    Part('pixels near the strongest gain only', {'objects.peak_share': 0.0}),
    Part('closing of gaps', {'objects.closing_px': 1}),
    Part('log odds of tracks', {'tracks.confirm_log_odds': -100.0, 'tracks.show_log_odds': -100.0}),
    Part('confirmation by time', {'tracks.confirm_s': 0.0}),
    Part('all confirmation', AT_ONCE),
    Part('coasting', {'tracks.coast_s': 0.0}),
    Part('mask of on-screen text', {'preprocessing.ignore_top_px': 0}),
)
#: What no setting takes out.
WITHOUT_SWITCH = (
    'the noise measured in every frame (flow and image)', 'the fill of the background behind objects',
    'the test for ghosts in the photometric test', 'the smooth correction of the planar background',
    'the prediction of tracks through the ego-motion')


def rows(parts: Sequence[Part], means: Iterable[Figures]) -> Iterator[str]:
    """Lines of a markdown table, each as soon as it is known. means: of the whole detector, then without each part."""
    figures = iter(means)
    whole = next(figures)
    yield from ('| without | F1 at 0.3 | F1 at 0.5 | precision | recall | false boxes a frame | settings |',
                '|---|---|---|---|---|---|---|', _row(WHOLE, whole, whole, ''))
    for part, mean in zip(parts, figures, strict=True):
        settings = [f'`{name}={value}`' for name, value in part.off.items()]
        settings += [f'`{part.substitute}`'] if part.substitute else []
        yield _row(part.name, mean, whole, ', '.join(settings) + (f' ({part.note})' if part.note else ''))


def means_of(runs: Iterable[ClipRun], clips: int) -> Iterator[Figures]:
    """The mean of each ``clips`` runs one after the other."""
    ahead = iter(runs)
    while group := list(islice(ahead, clips)):
        yield Figures.mean([Figures.of(run, 'moving') for run in group])


def tasks_of(parts: Sequence[Part], data: Path, clips: Sequence[str] = ()) -> list[tuple[Clip, Part]]:
    """All clips with the presets, then all clips without the first part, and so on."""
    return [(clip, part) for part in (Part(WHOLE, {}), *parts) for clip in read_clips(data, clips)]


def run_task(task: tuple[Clip, Part]) -> ClipRun:
    """One clip without one part."""
    clip, part = task
    if part.substitute is None:
        return run_clip(Job(clip, part.off))
    return run_choices(clip, [Choice(part.off, part.substitute)])[0]


def available(parts: Sequence[Part]) -> tuple[list[Part], list[str]]:
    """The parts whose substitutes are installed, and a line for each other."""
    found, missing = [], []
    for part in parts:
        try:
            if part.substitute:
                part.substitute.require()
            found.append(part)
        except BackendError as error:
            missing.append(f'Left out: {part.name}: {error}.')
    return found, missing


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where parts or clips are unknown."""
    parser = argparse.ArgumentParser(prog='ablation', description='Every part of the detector off in turn.')
    parser.add_argument('parts', nargs='*', metavar='PART', help='names, or their beginnings (default: all)')
    add_run_arguments(parser)
    parser.add_argument('--clips', nargs='*', default=[], help='names of clips (default: all)')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    parser.add_argument('--list', action='store_true', help='print the parts and stop')
    options = parser.parse_args(arguments)
    if options.list:
        print('\n'.join(part.name for part in PARTS))
        return 0
    parts, missing = available(_chosen(options.parts))
    tasks = tasks_of(parts, options.data, options.clips)
    runs = in_processes(run_task, tasks, options.jobs)
    lines = []
    for line in rows(parts, means_of(runs, len(tasks) // (len(parts) + 1))):
        print(line, flush=True)
        lines.append(line)
    after = ['', f'No setting takes out: {"; ".join(WITHOUT_SWITCH)}.', *missing]
    print('\n'.join(after))
    lines += after
    if options.write:
        replace_section(options.write, SECTION, lines)
    return 0


def _chosen(names: Sequence[str]) -> list[Part]:
    chosen = [part for part in PARTS if not names or any(part.name.startswith(name) for name in names)]
    unknown = [name for name in names if not any(part.name.startswith(name) for part in PARTS)]
    if unknown:
        raise SourceError(f'parts: expected some of {", ".join(part.name for part in PARTS)}; '
                          f'got {", ".join(unknown)}')
    for part in chosen:
        with_settings(PipelineConfig(), part.off)
    return chosen


def _row(name: str, figures: Figures, whole: Figures, settings: str) -> str:
    cells = [f'{getattr(figures, item):.2f}{change(getattr(figures, item), getattr(whole, item))}'
             for item in ('f1_30', 'f1_50', 'precision', 'recall', 'false_per_frame')]
    return f'| {name} | ' + ' | '.join(cells) + f' | {settings} |'


if __name__ == '__main__':
    sys.exit(main())
