"""Two plain methods beside the detector, over the same clips and scored by the same code: a table of docs/accuracy.md.

    python -m motion_detect_ros.benchmarks.plain_methods [CLIP ...] [--data DIR] [--jobs N] [--write docs/accuracy.md]

Stabilised three-frame difference: what differs from both pictures before, warped onto this one by the ego-motion.
KLT residuals + DBSCAN: tracked corners that do not follow the ego-motion, clustered by place and motion. Both see the
pictures as the detector does (grey, at most 960 px wide, without the rows that the preset of the clip ignores) and
have one set of settings for all clips, the constants below. Neither remembers objects. Needs scikit-learn (the extra
``compare``).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from motion_detect_ros.benchmarks.accuracy import add_run_arguments
from motion_detect_ros.benchmarks.accuracy_clips import IOUS, Clip, Job, in_processes, read_clips, run_clip
from motion_detect_ros.benchmarks.clusterers import Clusterer, Labels, Parameters, sklearn_cluster
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.core.config import PreprocessingConfig
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.metrics import COUNTINGS, score_boxes
from motion_detect_ros.sources.frames import SourceFrame

#: F1 at each of ``IOUS``.
F1s = tuple[float, ...]

SECTION = 'plain methods'
DIFFERENCE, RESIDUALS = 'stabilised three-frame difference', 'KLT residuals + DBSCAN'
#: Pictures are shrunk to this width; all pixels below are of the shrunk picture.
MAX_WIDTH_PX = 960
#: Corners: how many, least strength relative to the best, and least distance, pixels.
CORNERS, CORNER_QUALITY, CORNER_DISTANCE_PX = 1500, 0.002, 7
#: Lucas-Kanade: window, pixels, pyramid levels above the image itself, and largest forward-backward error, pixels.
WINDOW_PX, LEVELS, FORWARD_BACKWARD_PX = 15, 3, 0.5
#: Ego-motion: how far from it RANSAC counts a corner as ground, pixels, and least corners.
GROUND_PX, LEAST_CORNERS = 1.0, 8
#: Deviation of a normal distribution in medians of its absolute value; of two components in medians of their length.
SIGMA_OF_MEDIAN, SIGMA_OF_MEDIAN_LENGTH = 1.4826, 0.8493

#: Difference: the kernel that blurs it, pixels, least grey levels, and least multiple of the noise.
BLUR_PX, LEAST_GRAY, GRAY_SIGMAS = 5, 15.0, 6.0
#: Pixels that differ: kernels that open and close them, and least area of a component, pixels and pixels^2.
OPEN_PX, CLOSE_PX, LEAST_AREA_PX2 = 3, 9, 50

#: Residuals: least length of one that counts, pixels, and in multiples of the noise.
LEAST_RESIDUAL_PX, RESIDUAL_SIGMAS = 1.0, 4.0
#: DBSCAN: neighbours are so near, pixels; one pixel of residual counts as so many pixels of distance; least corners.
NEAR_PX, RESIDUAL_WEIGHT, LEAST_CLUSTER = 30.0, 10.0, 4
#: Boxes around corners are larger by this on each side, pixels.
MARGIN_PX = 4.0


@dataclass(frozen=True)
class Step:
    """Two pictures one after the other and how the ground moved between them.

    ``before``, ``after``: (h, w) uint8; ``seen``: (h, w) uint8, 255 where the picture may be looked at, else 0;
    ``start``, ``end``: (N, 2) float32 corners in both, pixels; ``motion``: (2, 3), pixel before -> pixel after.
    """

    before: ByteArray
    after: ByteArray
    seen: ByteArray
    start: FloatArray
    end: FloatArray
    motion: DoubleArray


class Method(Protocol):
    """A detection method; it gets every step of a clip, in order."""

    def boxes(self, step: Step | None) -> DoubleArray:
        """(N, 4) x, y, w, h in the picture after the step, pixels; none where the step could not be measured: None."""


class ThreeFrameDifference:
    """Components of what differs from both pictures before, each warped onto the last one."""

    def __init__(self) -> None:
        self._last: Step | None = None

    def boxes(self, step: Step | None) -> DoubleArray:
        """See ``Method``; none either at the first step, which has one picture before it only."""
        first, self._last = self._last, step
        if step is None or first is None:
            return np.empty((0, 4))
        over_two = step.motion @ np.vstack([first.motion, [0.0, 0.0, 1.0]])
        change = np.minimum(_difference(step.before, step.motion, step), _difference(first.before, over_two, step))
        return _components(change, step.seen)


class ResidualClusters:
    """Clusters of corners that do not move as the ground does."""

    def boxes(self, step: Step | None) -> DoubleArray:
        """See ``Method``."""
        if step is None:
            return np.empty((0, 4))
        residuals = step.end - (step.start @ step.motion[:, :2].T + step.motion[:, 2])
        lengths = np.linalg.norm(residuals, axis=1)
        own = lengths > max(LEAST_RESIDUAL_PX, RESIDUAL_SIGMAS * SIGMA_OF_MEDIAN_LENGTH * float(np.median(lengths)))
        if own.sum() < LEAST_CLUSTER:
            return np.empty((0, 4))
        points = step.end[own].astype(np.float64)
        labels = CLUSTERER.run(np.hstack([points, RESIDUAL_WEIGHT * residuals[own]]).astype(np.float32), {})
        clusters = [points[labels == label] for label in range(labels.max() + 1)]
        return _within([np.concatenate([cluster.min(axis=0) - MARGIN_PX, cluster.max(axis=0) + MARGIN_PX])
                        for cluster in clusters if len(cluster) >= LEAST_CLUSTER], step.after)


def _dbscan(vectors: FloatArray, parameters: Parameters) -> Labels:
    return sklearn_cluster('DBSCAN', vectors, {'eps': NEAR_PX, 'min_samples': LEAST_CLUSTER, **parameters})


CLUSTERER = Clusterer(RESIDUALS, _dbscan, library='sklearn')
METHODS: Mapping[str, Callable[[], Method]] = {DIFFERENCE: ThreeFrameDifference, RESIDUALS: ResidualClusters}


@dataclass(frozen=True)
class ClipScores:
    """F1 of one clip: by name of the plain method, and of the detector."""

    clip: str
    plain: Mapping[str, F1s]
    ours: F1s

    @property
    def columns(self) -> list[F1s]:
        """The plain methods, the best of them at each IoU, known only afterwards, the detector."""
        plain = [self.plain[name] for name in METHODS]
        return [*plain, tuple(map(max, zip(*plain, strict=True))), self.ours]


def measure_step(before: ByteArray, after: ByteArray, seen: ByteArray) -> Step | None:
    """Corners tracked from one picture to the next and the affine that most follow; None with too few for it."""
    corners = cv2.goodFeaturesToTrack(before, CORNERS, CORNER_QUALITY, CORNER_DISTANCE_PX, mask=seen)
    if corners is None or len(corners) < LEAST_CORNERS:
        return None
    start = corners.reshape(-1, 2)
    end, found = _track(before, after, start)
    back, found_back = _track(after, before, end)
    good = found & found_back & (np.linalg.norm(back - start, axis=1) < FORWARD_BACKWARD_PX)
    if good.sum() < LEAST_CORNERS:
        return None
    motion, _ = cv2.estimateAffine2D(start[good], end[good], method=cv2.RANSAC, ransacReprojThreshold=GROUND_PX)
    return None if motion is None else Step(before, after, seen, start[good], end[good], motion)


def find_boxes(
    frames: Iterable[SourceFrame], methods: Sequence[Method], ignore_top_px: int = 0,
) -> list[dict[int, DoubleArray]]:
    """For each method its (N, 4) boxes x, y, w, h by frame, full-resolution pixels.

    ignore_top_px: rows of the full-resolution image that are not looked at.
    """
    prepare = Preprocessor(PreprocessingConfig(max_width_px=MAX_WIDTH_PX, ignore_top_px=ignore_top_px))
    found: list[dict[int, DoubleArray]] = [{} for _ in methods]
    before: ByteArray | None = None
    for frame in frames:
        prepared = prepare.process(frame.image, frame.stamp_ns)
        seen = np.full(prepared.gray.shape, 255, np.uint8)
        if prepared.mask is not None:
            seen[~prepared.mask] = 0
        step = None if before is None else measure_step(before, prepared.gray, seen)
        for method, boxes in zip(methods, found, strict=True):
            boxes[frame.index] = method.boxes(step) / prepared.scale
        before = prepared.gray
    return found


def score_clip(clip: Clip) -> ClipScores:
    """The plain methods and the detector with its preset, on the same frames of a clip."""
    ours, truth = run_clip(Job(clip, {})), clip.read_truth()
    top_px = load_preset(clip.preset).preprocessing.ignore_top_px
    found = find_boxes(islice(clip.source(), clip.limit), [make() for make in METHODS.values()], top_px)
    plain = {name: tuple(score_boxes(truth, boxes, iou, COUNTINGS['moving'], ours.skip, ours.frames).f1 for iou in IOUS)
             for name, boxes in zip(METHODS, found, strict=True)}
    return ClipScores(clip.name, plain, tuple(score.f1 for score in ours.scores()))


def table(rows: Sequence[ClipScores]) -> list[str]:
    """Markdown: a row a clip, the mean of all."""
    names = [f'F1 at {" / ".join(f"{iou:g}" for iou in IOUS)}', *METHODS, 'best of the two', 'ours']
    mean = np.mean([row.columns for row in rows], axis=0)
    return [f'| {" | ".join(names)} |', '|---' * len(names) + '|',
            *(_line(f'`{row.clip}`', row.columns) for row in rows), _line(f'mean of {len(rows)}', mean.tolist())]


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips or scikit-learn are missing."""
    parser = argparse.ArgumentParser(prog='plain_methods', description='Two plain methods and ours on all real clips.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all)')
    add_run_arguments(parser)
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    options = parser.parse_args(arguments)
    clips = read_clips(options.data, options.clips)
    CLUSTERER.require()
    lines = table(list(in_processes(score_clip, clips, options.jobs)))
    show(lines, options.write, SECTION)
    return 0


def _track(before: ByteArray, after: ByteArray, points: FloatArray) -> tuple[FloatArray, np.ndarray]:
    """(N, 2) positions of points in the other picture, and (N,) bool which were found."""
    there, status, _ = cv2.calcOpticalFlowPyrLK(
        before, after, points, None, winSize=(WINDOW_PX, WINDOW_PX), maxLevel=LEVELS)
    return there, status.ravel().astype(bool)


def _difference(earlier: ByteArray, motion: DoubleArray, step: Step) -> ByteArray:
    """(h, w) grey levels between the last picture of a step and an earlier one moved onto it; 0 where it is unseen."""
    size = step.after.shape[::-1]
    change = cv2.absdiff(step.after, cv2.warpAffine(earlier, motion, size))
    change[cv2.warpAffine(step.seen, motion, size) < 255] = 0
    return np.asarray(change, np.uint8)


def _components(change: ByteArray, seen: ByteArray) -> DoubleArray:
    """(N, 4) boxes x, y, w, h around what differs by more than the noise."""
    smooth = cv2.GaussianBlur(change.astype(np.float32), (BLUR_PX, BLUR_PX), 0)
    looked = seen > 0
    noise = SIGMA_OF_MEDIAN * float(np.median(smooth[looked]))
    differs = ((smooth > max(LEAST_GRAY, GRAY_SIGMAS * noise)) & looked).astype(np.uint8)
    for operation, side in ((cv2.MORPH_OPEN, OPEN_PX), (cv2.MORPH_CLOSE, CLOSE_PX)):
        differs = cv2.morphologyEx(differs, operation, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    _, _, figures, _ = cv2.connectedComponentsWithStats(differs, connectivity=8)
    parts = figures[1:]
    return np.asarray(parts[parts[:, cv2.CC_STAT_AREA] >= LEAST_AREA_PX2, :4], np.float64)


def _within(corners: Sequence[DoubleArray], image: ByteArray) -> DoubleArray:
    """(N, 4) boxes x, y, w, h of (left, top, right, bottom), cut to the image."""
    height, width = image.shape
    both = np.clip(np.array(corners, np.float64).reshape(-1, 4), 0.0, (width, height, width, height))
    return np.hstack([both[:, :2], both[:, 2:] - both[:, :2]])


def _line(name: str, columns: Iterable[Iterable[float]]) -> str:
    return f'| {name} | ' + ' | '.join(' / '.join(f'{f1:.2f}' for f1 in column) for column in columns) + ' |'


if __name__ == '__main__':
    sys.exit(main())
