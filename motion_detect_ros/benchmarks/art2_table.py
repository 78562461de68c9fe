"""ART2 beside other clusterers on labelled flow of the built-in flight: the table of docs/method.md.

    python -m motion_detect_ros.benchmarks.art2_table [--tuning-seeds N ...] [--seeds N ...] [--json FILE]

The flights go over the town with six boxes that move in three directions, at two speeds each. Every clusterer gets the
same (N, 2) vectors, motion against the background in units of its noise, a fresh start for each frame, and of its
twelve choices the one that does best on the flights of the tuning seeds; figures are those on the other seeds. No two
boxes move alike: what moves alike is one cluster to all of them, connected components split it later. Index: adjusted
Rand index (Hubert and Arabie 1985) against the object that each vector belongs to, all background being one; movers:
the same of the vectors of moving objects alone. The mean of both decides. Noise that a clusterer finds is one cluster.
What is not installed is left out with a note: ``pip install 'motion_detect_ros[compare]'``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from motion_detect_ros.benchmarks.clusterers import CLUSTERERS, Clusterer
from motion_detect_ros.core.background.planar import fit_background, motion_vectors
from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.optical_flow.conversion import residual_flow
from motion_detect_ros.core.types import DoubleArray, FloatArray
from motion_detect_ros.sources.synthetic import FlightConfig, ObjectSpec, SyntheticFlight, SyntheticFrame

Owners = npt.NDArray[np.int64]

TUNING_SEEDS, SEEDS = (101, 102), (1, 2, 3, 4)
#: Frames of each flight that are scored; deviation of the Gaussian noise added to the exact flow, pixels.
FRAMES, FLOW_NOISE_PX = (10, 40), 0.25
#: Speeds of the boxes; how far each is from the middle of the view at most, half way between ``FRAMES``.
SPEEDS_M_S, SPREAD_M = (4.0, 10.0), 22.0
#: Vectors of a scored frame, and of the timed ones.
SCORED_VECTORS, TIMED_VECTORS = 10_000, (5_000, 20_000, 80_000)
#: A run longer than this is not repeated, one expected to be longer than that is left out, seconds.
SLOW_S, TOO_LONG_S, REPEATS = 2.0, 120.0, 5


@dataclass(frozen=True)
class LabelledVectors:
    """``vectors``: (N, 2) noise units, all finite; ``owners``: (N,) id of the moving object, 0 = background."""

    vectors: FloatArray
    owners: Owners
    seed: int = 0

    def sample(self, count: int) -> LabelledVectors:
        """``count`` of them, evenly spread over the image, in its order."""
        chosen = np.linspace(0, len(self.owners) - 1, count).astype(np.int64)
        return LabelledVectors(self.vectors[chosen], self.owners[chosen], self.seed)


@dataclass(frozen=True)
class Row:
    """Means over frames of what the table shows; ``times_ms``: NaN = not run.

    ``worst``, ``worst_movers``: lowest mean of a seed.
    """

    name: str
    parameters: dict[str, Any]
    index: float
    worst: float
    movers: float
    worst_movers: float
    clusters: float
    times_ms: tuple[float, ...]

    @property
    def score(self) -> float:
        """What decides."""
        return (self.index + self.movers) / 2.0


def labelled_vectors(frame: SyntheticFrame, seed: int) -> LabelledVectors:
    """Exact flow of a frame with Gaussian noise, as the clustering stage sees it: stabilised, background fitted."""
    height, width = frame.owner.shape
    noise = np.random.default_rng(seed).normal(0.0, FLOW_NOISE_PX, frame.flow.shape)
    flow = (frame.flow + noise).astype(np.float32)
    residual = residual_flow(flow, frame.ground_homography, width, height)
    background = fit_background(residual, BackgroundConfig(), magnitude(np.nan_to_num(flow)))
    vectors = motion_vectors(residual, background).reshape(-1, 2)
    movers = frame.truth['id'][frame.truth['moving'] == 1]
    owners = np.where(np.isin(frame.owner, movers), frame.owner, 0).ravel().astype(np.int64)
    known = np.isfinite(vectors).all(axis=1)
    return LabelledVectors(vectors[known], owners[known], seed)


def flight_of(seed: int) -> FlightConfig:
    """Boxes in three directions 120 degrees apart, at each speed, over the town without its own traffic."""
    view, random = FlightConfig(), np.random.default_rng(seed)
    seconds = float(np.mean(FRAMES)) / view.fps
    ahead_m = view.altitude_m / np.tan(np.radians(view.pitch_deg)) + view.speed_m_s * seconds
    heading = np.radians(view.heading_deg)
    first_deg, boxes = float(random.uniform(0.0, 120.0)), []
    for direction_deg in (first_deg, first_deg + 120.0, first_deg + 240.0):
        course = np.radians(direction_deg)
        for speed_m_s in SPEEDS_M_S:
            place = ahead_m * np.array([np.cos(heading), np.sin(heading)]) + random.uniform(-SPREAD_M, SPREAD_M, 2)
            x, y = place - speed_m_s * seconds * np.array([np.cos(course), np.sin(course)])
            length, width = random.uniform(2.0, 5.0, 2)
            boxes.append(ObjectSpec('box', float(x), float(y), direction_deg, speed_m_s, float(length), float(width)))
    return FlightConfig(seed=seed, frames=max(FRAMES) + 1, cars=0, people=0, objects=tuple(boxes))


def frames_of(seeds: Sequence[int]) -> list[LabelledVectors]:
    """The scored frames of the flights of ``seeds``, every vector."""
    found = []
    for seed in seeds:
        flight = SyntheticFlight(flight_of(seed))
        found += [labelled_vectors(flight.frame(index), seed) for index in FRAMES]
    return found


def adjusted_rand_index(one: npt.ArrayLike, other: npt.ArrayLike) -> float:
    """1 for equal partitions, 0 on average for random ones. Source: Hubert and Arabie 1985, equation 5."""
    _, first = np.unique(one, return_inverse=True)
    _, second = np.unique(other, return_inverse=True)
    table = np.zeros((first.max() + 1, second.max() + 1), np.float64)
    np.add.at(table, (first, second), 1.0)
    together = _pairs(table).sum()
    in_first, in_second, all_pairs = _pairs(table.sum(1)).sum(), _pairs(table.sum(0)).sum(), _pairs(table.sum())
    expected = in_first * in_second / all_pairs if all_pairs > 0 else 0.0
    most = (in_first + in_second) / 2.0
    return 1.0 if most == expected else float((together - expected) / (most - expected))


def _pairs(count: Any) -> Any:
    return count * (count - 1.0) / 2.0


def scores(clusterer: Clusterer, frames: Sequence[LabelledVectors], parameters: dict[str, Any]) -> DoubleArray:
    """(frames, 3): index, index of the movers' vectors alone, clusters."""
    found = []
    for frame in frames:
        labels = clusterer.run(frame.vectors, parameters)
        moving = frame.owners > 0
        found.append((adjusted_rand_index(frame.owners, labels),
                      adjusted_rand_index(frame.owners[moving], labels[moving]), len(np.unique(labels))))
    return np.array(found, np.float64)


def tuned(clusterer: Clusterer, frames: Sequence[LabelledVectors]) -> dict[str, Any]:
    """The choice of the grid with the best mean of both indices; the first of equals."""
    choices = list(clusterer.choices())
    if len(choices) == 1:
        return choices[0]
    return choices[int(np.argmax([scores(clusterer, frames, choice)[:, :2].mean() for choice in choices]))]


def measure(clusterer: Clusterer, tuning: Sequence[LabelledVectors], frames: Sequence[LabelledVectors]) -> Row:
    """Tune on ``tuning``, score on ``frames``, time on the first of them."""
    parameters = tuned(clusterer, [frame.sample(SCORED_VECTORS) for frame in tuning])
    found = scores(clusterer, [frame.sample(SCORED_VECTORS) for frame in frames], parameters)
    seeds = np.array([frame.seed for frame in frames])
    worst, worst_movers, _ = np.min([found[seeds == seed].mean(axis=0) for seed in np.unique(seeds)], axis=0)
    index, movers, clusters = found.mean(axis=0)
    return Row(clusterer.name, parameters, float(index), float(worst), float(movers), float(worst_movers),
               float(clusters), tuple(times_ms(clusterer, frames[0], parameters)))


def times_ms(clusterer: Clusterer, frame: LabelledVectors, parameters: dict[str, Any]) -> Iterator[float]:
    """Median of some runs for each of ``TIMED_VECTORS``; NaN where it would take too long or too much memory."""
    expected_s = 0.0
    for count in TIMED_VECTORS:
        vectors = frame.sample(count).vectors
        too_many = clusterer.most_vectors is not None and count > clusterer.most_vectors
        times = list[float]()
        while not too_many and expected_s < TOO_LONG_S and len(times) < REPEATS and max(times, default=0.0) < SLOW_S:
            start = time.perf_counter()
            clusterer.run(vectors, parameters)
            times.append(time.perf_counter() - start)
        yield 1e3 * float(np.median(times)) if times else float('nan')
        expected_s = 4.0 * float(np.median(times or [TOO_LONG_S]))  # each count is four times the one before


def table(rows: Sequence[Row]) -> list[str]:
    """Markdown."""
    heads = ['clusterer', 'index, worst seed', 'movers, worst seed', 'clusters',
             *(f'{count // 1000}k ms' for count in TIMED_VECTORS), 'parameters']
    lines = [f'| {" | ".join(heads)} |', '|---' * len(heads) + '|']
    for row in rows:
        times = ['not run' if np.isnan(value) else f'{value:.3g}' for value in row.times_ms]
        chosen = ', '.join(f'{name} {value}' for name, value in row.parameters.items()) or 'defaults'
        figures = [f'{mean:.2f}, {worst:.2f}' for mean, worst in (
            (row.index, row.worst), (row.movers, row.worst_movers))]
        lines.append(f'| {" | ".join([row.name, *figures, f"{row.clusters:.0f}", *times, chosen])} |')
    return lines


def compare(
    clusterers: Sequence[Clusterer], tuning: Sequence[LabelledVectors], frames: Sequence[LabelledVectors],
    report: Callable[[str], None],
) -> list[Row]:
    """A row for each that is installed, best score first; ``report`` gets a line for each, and for what is left out."""
    rows = []
    for clusterer in clusterers:
        try:
            clusterer.require()
        except BackendError as error:
            report(f'left out: {error}')
            continue
        rows.append(measure(clusterer, tuning, frames))
        report(table(rows)[-1])
    return sorted(rows, key=lambda row: -row.score)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog='art2_table', description='ART2 beside other clusterers.')
    parser.add_argument('--tuning-seeds', type=int, nargs='+', default=list(TUNING_SEEDS))
    parser.add_argument('--seeds', type=int, nargs='+', default=list(SEEDS))
    parser.add_argument('--only', nargs='+', metavar='NAME', help='clusterers whose name begins so')
    parser.add_argument('--json', type=Path, help='write the figures here too')
    options = parser.parse_args(arguments)
    if set(options.seeds) & set(options.tuning_seeds):
        parser.error('--seeds: expected other seeds than --tuning-seeds')
    chosen = [each for each in CLUSTERERS if not options.only or each.name.startswith(tuple(options.only))]
    if not chosen:
        parser.error(f'--only: expected the beginning of some of {", ".join(each.name for each in CLUSTERERS)}')
    rows = compare(chosen, frames_of(options.tuning_seeds), frames_of(options.seeds),
                   lambda text: print(text, file=sys.stderr, flush=True))
    print('\n'.join(table(rows)))
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=2) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
