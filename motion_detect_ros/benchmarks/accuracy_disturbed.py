"""Accuracy over disturbed copies of the clips: what a camera in gusts, at night, in haze or under a bad lamp costs.

    python -m motion_detect_ros.benchmarks.accuracy_disturbed [CLIP ...] [--data DIR] [--only NAME ...]
        [--set NAME=VALUE ...] [--write FILE]

No setting was chosen on them. Prints mean F1, precision, recall and false boxes a frame for each disturbance.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from motion_detect_ros.benchmarks.accuracy import add_run_arguments, add_settings, read_changes
from motion_detect_ros.benchmarks.accuracy_clips import IOUS, ClipRun, Job, in_processes, read_clips
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray, RecordArray
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.metrics import COUNTINGS, Score, score_boxes

#: Place in a document.
SECTION = 'disturbed'
#: Pictures of this width are jerked by the pixels named below, others by as large a part of theirs.
WIDTH_PX = 960.0
#: What of a picture a jerk may take out of view is cut off before, share of the size.
MARGIN = 0.06

#: Grey or colour values as float32, and numbers drawn anew for every frame -> what the camera makes of them.
Effect = Callable[[FloatArray, np.random.Generator], FloatArray]


@dataclass(frozen=True)
class Disturbance:
    """``effect`` on the grey values; ``jerk_px``, ``jerk_deg``: deviation of the camera's place and roll from frame to
    frame; ``scale`` of the pictures; every ``every``-th frame only; every ``lost_every``-th is grey, and not counted.
    """

    name: str
    effect: Effect | None = None
    jerk_px: float = 0.0
    jerk_deg: float = 0.0
    scale: float = 1.0
    every: int = 1
    lost_every: int = 0

    def seen(self, image: ByteArray, frame: int) -> tuple[ByteArray, DoubleArray]:
        """The disturbed picture, and (3, 3) pixel of the original -> pixel of it. image: (H, W) or (H, W, 3)."""
        random = np.random.default_rng([frame, 5])
        height, width = image.shape[:2]
        matrix = np.diag([self.scale, self.scale, 1.0])
        if self.jerk_px or self.jerk_deg:
            matrix = self._jerk(random, width, height)
            image = np.asarray(cv2.warpPerspective(
                image, matrix, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT), np.uint8)
        if self.scale != 1.0:
            size = (round(width * self.scale), round(height * self.scale))
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        if self.lost(frame):
            image = np.full_like(image, 128)
        if self.effect is not None:
            image = np.clip(np.rint(self.effect(image.astype(np.float32), random)), 0, 255).astype(np.uint8)
        return image, matrix

    def lost(self, frame: int) -> bool:
        """Whether nothing is to be seen in a frame."""
        return self.lost_every > 0 and frame % self.lost_every == self.lost_every - 1

    def _jerk(self, random: np.random.Generator, width: int, height: int) -> DoubleArray:
        zoom = 1.0 + MARGIN
        turn = cv2.getRotationMatrix2D((width / 2.0, height / 2.0), random.normal(0.0, self.jerk_deg), zoom)
        matrix = np.vstack([turn, [0.0, 0.0, 1.0]])
        matrix[:2, 2] += random.normal(0.0, self.jerk_px * width / WIDTH_PX, 2)
        return matrix


def _noisy(image: FloatArray, random: np.random.Generator, sigma: FloatArray | float) -> FloatArray:
    """Noise that is the same in all colours."""
    noise = random.normal(0.0, 1.0, image.shape[:2]).astype(np.float32)
    return image + sigma * (noise[..., None] if image.ndim == 3 else noise)


def _night(image: FloatArray, random: np.random.Generator) -> FloatArray:
    dark = 0.35 * image * image / 255.0
    return _noisy(dark, random, 1.5 + 0.25 * np.sqrt(dark))


def _jpeg(image: FloatArray, _random: np.random.Generator) -> FloatArray:
    _, packed = cv2.imencode('.jpg', image.astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 20])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_UNCHANGED), np.float32)


DISTURBANCES = (
    Disturbance('none'),
    Disturbance('camera jerked by 2 px and 0.1 degrees', jerk_px=2.0, jerk_deg=0.1),
    Disturbance('by 4 px and 0.25 degrees', jerk_px=4.0, jerk_deg=0.25),
    Disturbance('by 8 px and 0.5 degrees', jerk_px=8.0, jerk_deg=0.5),
    Disturbance('light flickers by up to 20 %', lambda image, random: image * np.float32(random.uniform(0.8, 1.2))),
    Disturbance('haze: contrast 0.35', lambda image, _: 0.35 * image + 130.0),
    Disturbance('night: dark and noisy', _night),
    Disturbance('noise of 6 grey levels', lambda image, random: _noisy(image, random, 6.0)),
    Disturbance('JPEG of quality 20', _jpeg),
    Disturbance('blur of 1.5 px', lambda image, _: np.asarray(cv2.GaussianBlur(image, (0, 0), 1.5), np.float32)),
    Disturbance('two thirds of the size', scale=2.0 / 3.0),
    Disturbance('half of the size', scale=0.5),
    Disturbance('a third of the size', scale=1.0 / 3.0),
    Disturbance('every second frame', every=2),
    Disturbance('every 20th picture is grey', lost_every=20),
)
NAMES = [each.name for each in DISTURBANCES]


@dataclass(frozen=True)
class DisturbedJob(Job):
    """The same for a disturbed copy of the clip."""

    disturbance: int


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips or settings are wrong."""
    parser = argparse.ArgumentParser(prog='accuracy_disturbed', description='Mean F1 over disturbed copies of clips.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all)')
    parser.add_argument('--only', nargs='+', choices=NAMES, default=NAMES, metavar='NAME',
                        help=f'of the disturbances ({"; ".join(NAMES)})'.replace('%', '%%'))
    add_run_arguments(parser)
    add_settings(parser)
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    options = parser.parse_args(arguments)
    changes, clips = read_changes(options.set), read_clips(options.data, options.clips)
    jobs = [DisturbedJob(clip, changes, NAMES.index(name)) for name in options.only for clip in clips]
    scores = list(in_processes(run_disturbed, jobs, options.jobs))
    show(table(options.only, [scores[start:start + len(clips)] for start in range(0, len(scores), len(clips))]),
         options.write, SECTION)
    return 0


def run_disturbed(job: DisturbedJob) -> tuple[Score, ...]:
    """Every frame of a disturbed copy through a fresh pipeline, scored at each of ``IOUS``; without calibration."""
    disturbance = DISTURBANCES[job.disturbance]
    pipeline = MotionPipeline(with_settings(load_preset(job.clip.preset), job.changes))
    truth, detections = job.clip.read_truth(), dict[int, RecordArray]()
    for frame in itertools.islice(job.clip.source(), 0, job.clip.limit, disturbance.every):
        image, matrix = disturbance.seen(frame.image, frame.index)
        found = pipeline.process(image, frame.stamp_ns).detections
        lost = disturbance.lost(frame.index)
        detections[frame.index // disturbance.every] = undone(found[:0] if lost else found, matrix)
    truth = truth[(truth['frame'] % disturbance.every == 0) & ~np.array([*map(disturbance.lost, truth['frame'])], bool)]
    truth['frame'] //= disturbance.every
    run = ClipRun(job.clip, detections, math.nan)
    return tuple(score_boxes(truth, run.boxes(), iou, COUNTINGS['moving'], run.skip, run.frames) for iou in IOUS)


def undone(records: RecordArray, matrix: DoubleArray) -> RecordArray:
    """Detections in a disturbed picture, where they are in the original. matrix: (3, 3) of ``Disturbance.seen``."""
    there, back = records.copy(), np.linalg.inv(matrix)
    there['u'], there['v'] = (back @ np.stack([records['u'], records['v'], np.ones(len(records))]))[:2]
    for side in ('width', 'height'):
        there[side] = records[side] * math.sqrt(abs(np.linalg.det(back[:2, :2])))
    return there


def table(names: Sequence[str], scores: Sequence[Sequence[tuple[Score, ...]]]) -> list[str]:
    """Markdown: a row a disturbance, means over the clips. scores: of each clip at each of ``IOUS``."""
    head = ['disturbance', *(f'F1 at {iou:g}' for iou in IOUS), 'precision', 'recall', 'false boxes a frame']
    lines = [f'| {" | ".join(head)} |', '|---' * len(head) + '|']
    for name, clips in zip(names, scores, strict=True):
        each = [[*(score.f1 for score in one), one[0].precision, one[0].recall, one[0].false_per_frame]
                for one in clips]
        lines.append(f'| {name} | ' + ' | '.join(f'{mean:.2f}' for mean in np.mean(each, axis=0).tolist()) + ' |')
    return lines


if __name__ == '__main__':
    sys.exit(main())
