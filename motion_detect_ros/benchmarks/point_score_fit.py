"""The score of small objects: fitted anew over real clips, and judged on each clip that was left out of the fit.

    python -m motion_detect_ros.benchmarks.point_score_fit [CLIP ...] [--data DIR] [--jobs N] [--flights N]
        [--write docs/accuracy.md]

A logistic regression (Cox 1958) over the clusters of points that the detector looks at, every clip with equal weight; a
cluster is right where its box matches a moving object at IoU 0.3. Then the whole detector runs over each clip with the
coefficients in use, with those fitted on all clips, with those fitted without that clip, and with those of synthetic
flights alone: town, cars and people under the disturbances of ``benchmarks.silence``. The intercepts are lowered as
the one in use was.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from motion_detect_ros.benchmarks.accuracy import add_run_arguments
from motion_detect_ros.benchmarks.accuracy_clips import (
    IOUS,
    SHORT_WARM_UP_FRAMES,
    Clip,
    ClipRun,
    in_processes,
    read_clips,
)
from motion_detect_ros.benchmarks.accuracy_table import f1_table
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.benchmarks.silence import FRAMES, Flight
from motion_detect_ros.core.clustering_stage import ClusteringStage
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.trajectories.finder import TrajectoryFinder
from motion_detect_ros.core.trajectories.follower import PointFollower
from motion_detect_ros.core.trajectories.point_scoring import POINT_SCORE, PointScore
from motion_detect_ros.core.types import BoolArray, CameraModel, DoubleArray, RecordArray
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.metrics import judge_frame
from motion_detect_ros.sources.frames import SourceFrame

SECTION = 'point score'
#: What the fitted intercept is lowered by: false boxes cost more than missed ones.
LOWERED = 1.0
#: Score that drops no cluster.
EVERYTHING = replace(POINT_SCORE, least=-1e3)
#: Weight of the squared coefficients, so that a perfect separation has a solution.
RIDGE = 1e-4
#: Synthetic flights: the preset, and what moves in them.
FLIGHT_PRESET, FLIGHTS, CARS, PEOPLE = 'visdrone', 4, 40, 110


@dataclass(frozen=True)
class Judged:
    """Clusters of one clip. ``regressors``: (N, 3), see ``ClusterFigures``; ``right``: (N,)."""

    regressors: DoubleArray
    right: BoolArray


def collect(config: PipelineConfig, frames: Iterable[tuple[SourceFrame, RecordArray]],
            camera: CameraModel | None = None) -> Judged:
    """Every cluster of the frames after the first, with the truth of each; what lies on ignored truth is left out."""
    preprocessor, ego_motion = Preprocessor(config.preprocessing), EgoMotionStage(config, camera)
    follower, finder = PointFollower(config), TrajectoryFinder(config, EVERYTHING)
    regressors, right = list[tuple[float, float, float]](), list[bool]()
    for frame, truth in frames:
        prepared = preprocessor.process(frame.image, frame.stamp_ns)
        height, width = prepared.gray.shape
        known = camera or CameraModel.guessed(prepared.width, prepared.height, config.background.focal_share)
        found = finder.candidates(follower.follow(prepared, ego_motion.process(prepared), known.resized(width, height)))
        if not finder.found or not found or frame.index < SHORT_WARM_UP_FRAMES:
            continue
        boxes = np.array([np.r_[one.centre - one.size / 2.0, one.size] for one in found])
        verdict = judge_frame(truth, boxes, IOUS[0])
        counted = ~verdict.ignored
        regressors += [each.figures.regressors for each, counts in zip(finder.objects, counted, strict=True) if counts]
        right += verdict.hit[counted].tolist()
    return Judged(np.array(regressors).reshape(-1, 3), np.array(right, np.bool_))


def collect_clip(clip: Clip) -> Judged:
    """``collect`` over a real clip with its preset."""
    truth, source = clip.read_truth(), clip.source()
    frames = ((frame, truth[truth['frame'] == frame.index]) for frame in islice(source, clip.limit))
    return collect(load_preset(clip.preset), frames, source.camera)


def collect_flight(seed: int, frames: int) -> Judged:
    """``collect`` over a synthetic flight."""
    flight = Flight(FLIGHT_PRESET, {}, seed, frames, cars=CARS, people=PEOPLE)
    return collect(load_preset(FLIGHT_PRESET), flight.judged())


def fit(clips: Sequence[Judged]) -> PointScore:
    """Most probable coefficients, every clip with equal weight, the intercept lowered by ``LOWERED``.

    Raises: SourceError where there are no right or no wrong clusters.
    """
    used = [clip for clip in clips if len(clip.right)]
    right = np.concatenate([clip.right for clip in used]) if used else np.zeros(0, np.bool_)
    if not right.any() or right.all():
        raise SourceError(f'expected right and wrong clusters, got {right.sum()} of {len(right)} right')
    x = np.concatenate([np.column_stack([np.ones(len(clip.right)), clip.regressors]) for clip in used])
    weights = np.concatenate([np.full(len(clip.right), 1.0 / len(clip.right)) for clip in used])
    sign = np.where(right, 1.0, -1.0)

    def loss(coefficients: DoubleArray) -> tuple[float, DoubleArray]:
        margin = sign * (x @ coefficients)
        slope = -weights * sign * np.exp(-np.logaddexp(0.0, margin))
        return (float(weights @ np.logaddexp(0.0, -margin) + RIDGE * coefficients @ coefficients),
                x.T @ slope + 2.0 * RIDGE * coefficients)

    found = minimize(loss, np.zeros(x.shape[1]), jac=True, method='BFGS').x
    intercept, points, share, around = found.tolist()
    return replace(POINT_SCORE, intercept=intercept - LOWERED, per_log_points=points, per_moving_share=share,
                   per_moving_around=around)


def run_scored(task: tuple[Clip, PointScore]) -> ClipRun:
    """The whole detector over a clip, with another score of small objects; ``frame_ms`` is unknown: NaN."""
    clip, score = task
    source, config = clip.source(), load_preset(clip.preset)
    first_half = MotionPipeline(config, source.camera)
    second_half = ClusteringStage(config, source.camera, point_score=score)
    detections = dict[int, RecordArray]()
    for frame in islice(source, clip.limit):
        measured = first_half.measure(frame.image, frame.stamp_ns)
        detections[frame.index] = second_half.process(
            measured.frame, measured.ego, measured.reference, measured.flow)
    return ClipRun(clip, detections, float('nan'))


def coefficient_table(scores: Mapping[str, PointScore]) -> list[str]:
    """Markdown, a row a score."""
    return ['| coefficients | intercept | log points | moving share | moving around |', '|---|---|---|---|---|',
            *(f'| {name} | {score.intercept:.2f} | {score.per_log_points:.2f} | {score.per_moving_share:.2f} | '
              f'{score.per_moving_around:.2f} |' for name, score in scores.items())]


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips are wrong or give nothing to fit."""
    parser = argparse.ArgumentParser(prog='point_score_fit', description='Fit of the score of small objects.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all whose preset tracks points)')
    add_run_arguments(parser)
    parser.add_argument('--flights', type=int, default=FLIGHTS, metavar='N',
                        help=f'synthetic flights (default: {FLIGHTS}; 0 = none)')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the tables into this document, too')
    options = parser.parse_args(arguments)
    clips = [clip for clip in read_clips(options.data, options.clips) if load_preset(clip.preset).trajectories.use]
    if len(clips) < 2:
        raise SourceError(f'expected at least two clips whose preset tracks points, got {len(clips)}')
    judged = list(in_processes(collect_clip, clips, options.jobs))
    without = [fit([*judged[:index], *judged[index + 1:]]) for index in range(len(clips))]
    scores = {'in use': POINT_SCORE, 'fitted on all clips': fit(judged)}
    kinds = {**{name: [score] * len(clips) for name, score in scores.items()}, 'fitted without the clip': without}
    if options.flights:
        flown = list(in_processes(partial(collect_flight, frames=FRAMES), range(1, options.flights + 1), options.jobs))
        scores['fitted on synthetic flights'] = fit(flown)
        kinds['fitted on synthetic flights'] = [scores['fitted on synthetic flights']] * len(clips)
    scores |= {f'without `{clip.name}`': score for clip, score in zip(clips, without, strict=True)}
    tasks = [(clip, score) for each in kinds.values() for clip, score in zip(clips, each, strict=True)]
    runs = in_processes(run_scored, tasks, options.jobs)
    table = f1_table(clips, {name: list(islice(runs, len(clips))) for name in kinds})
    right = np.concatenate([each.right for each in judged])
    counts = f'{len(right)} clusters of real clips, {right.sum()} of them right.'
    show([*coefficient_table(scores), '', counts, '', *table], options.write, SECTION)
    return 0


if __name__ == '__main__':
    sys.exit(main())
