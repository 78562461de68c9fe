"""Where clusters matter: boxes that pass each other almost touching, by each way to cluster. Table of docs/accuracy.md.

    python -m motion_detect_ros.benchmarks.passing [--jobs N] [--write docs/accuracy.md]

Connected components separate what lies apart; objects that touch are told apart by their motion alone.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from motion_detect_ros.benchmarks.ablation import PARTS, Part, available, run_task
from motion_detect_ros.benchmarks.accuracy_clips import Clip, in_processes
from motion_detect_ros.benchmarks.accuracy_record import Figures
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.sources.synthetic import FlightConfig, ObjectSpec, SyntheticFlight
from motion_detect_ros.sources.truth import write_truth

SECTION = 'passing'
FRAMES, ALTITUDE_M = 60, 40.0
#: Speeds of the boxes over the ground, and the gap between the lanes of two that pass each other.
SPEEDS_M_S, GAP_M = (4.0, 8.0), 0.2
#: Pairs of lanes, their distance, and how far from the middle each box of a pair starts.
PAIRS, PAIR_M, START_M = 6, 6.0, 6.0
LENGTH_M, WIDTH_M, HEIGHT_M = 4.0, 2.0, 0.3


def flight(speed_m_s: float) -> FlightConfig:
    """Twelve boxes seen from straight above, each going the other way than the one in the lane beside it."""
    boxes = []
    for pair in range(PAIRS):
        y_m, x_m = PAIR_M * (pair - (PAIRS - 1) / 2.0), 8.0 * (pair % 3 - 1)
        boxes += [ObjectSpec('box', x_m - START_M, y_m, 0.0, speed_m_s, LENGTH_M, WIDTH_M, HEIGHT_M),
                  ObjectSpec('box', x_m + START_M, y_m + WIDTH_M + GAP_M, 180.0, speed_m_s, LENGTH_M, WIDTH_M,
                             HEIGHT_M)]
    return replace(FlightConfig.approach(0.0, frames=FRAMES), width=960, height=540, altitude_m=ALTITUDE_M,
                   objects=tuple(boxes))


def write_clip(config: FlightConfig, folder: Path, name: str) -> Clip:
    """The flight as pictures and truth in ``folder``. Raises: BackendError where a picture cannot be written."""
    truth = []
    for frame in SyntheticFlight(config):
        path = folder / f'{frame.index:06d}.png'
        if not cv2.imwrite(str(path), frame.image):
            raise BackendError(f'{path}: cannot be written')
        truth.append(frame.truth)
    write_truth(folder / 'truth.csv', np.concatenate(truth))
    return Clip(name, folder, folder / 'truth.csv', config.fps, 'default')


def rows(speed_m_s: float, parts: Sequence[Part], processes: int) -> list[str]:
    """Markdown lines of one flight, one for each way to cluster."""
    with tempfile.TemporaryDirectory() as folder:
        clip = write_clip(flight(speed_m_s), Path(folder), 'passing')
        runs = in_processes(run_task, [(clip, part) for part in parts], processes)
        found = [Figures.of(run, 'moving') for run in runs]
    return [f'| {speed_m_s:g} | {part.name.removeprefix("ART2: ")} | {one.f1_30:.2f} | {one.f1_50:.2f} '
            f'| {one.recall:.2f} | {one.false_per_frame:.2f} |' for part, one in zip(parts, found, strict=True)]


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog='passing', description='Boxes that pass each other, by way to cluster.')
    parser.add_argument('--jobs', type=int, default=2, metavar='N', help='processes (default: 2)')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    options = parser.parse_args(arguments)
    parts, missing = available([part for part in PARTS if part.name.startswith('ART2: ')])
    parts.insert(0, Part('ART2: ART2 as shipped', {}))
    lines = ['| speed, m/s | clustering | F1 at 0.3 | F1 at 0.5 | recall | false boxes a frame |',
             '|---|---|---|---|---|---|']
    for speed_m_s in SPEEDS_M_S:
        lines += rows(speed_m_s, parts, options.jobs)
    lines += ['', *missing] if missing else []
    show(lines, options.write, SECTION)
    return 0


if __name__ == '__main__':
    sys.exit(main())
