"""Every method of dense flow against the exact flow of the built-in flight: the table of docs/method.md.

    python -m motion_detect_ros.benchmarks.flow_table [--frames N] [--methods NAME ...] [--set NAME=VALUE ...]

End-point error of the published flow, pixels, of cells wholly on the background and wholly on one moving object; the
share of both that passes the forward-backward check; median processor time of the stage, forward and backward flow, at
960 x 540 on one thread.
What is not installed is left out with a note.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from motion_detect_ros.core.config import FLOW_METHODS, PipelineConfig
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.errors import BackendError, MotionDetectError
from motion_detect_ros.core.geometry.frame_history import FrameHistory
from motion_detect_ros.core.optical_flow.stage import OpticalFlowStage
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import BoolArray, FloatArray
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight, SyntheticFrame


@dataclass(frozen=True)
class Cells:
    """Truth on the grid: ``flow`` (rows, columns, 2) pixels, NaN = unknown; cells wholly of one kind."""

    flow: FloatArray
    background: BoolArray
    movers: BoolArray


@dataclass(frozen=True)
class Row:
    """Errors in pixels, NaN where the flow is unknown; ``times_ms``: processor time of the stage."""

    background: FloatArray
    movers: FloatArray
    times_ms: list[float]

    def line(self, name: str) -> str:
        """A row of the table."""
        figures = [f'{value:.2f}' for errors in (self.background, self.movers)
                   for value in (np.nanmedian(errors), np.nanmean(errors))]
        shares = [f'{np.isfinite(errors).mean():.2f}' for errors in (self.background, self.movers)]
        return f'| `{name}` | {" | ".join(figures + shares)} | {np.median(self.times_ms):.0f} |'


HEADER = ('| method | background: median EPE | mean | movers: median EPE | mean | share valid, background | movers '
          '| ms |\n|---|---|---|---|---|---|---|---|')


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog='flow_table', description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument('--frames', type=int, default=6, help='pairs of frames that are scored')
    parser.add_argument('--methods', nargs='+', metavar='NAME', choices=FLOW_METHODS,
                        default=[name for name in FLOW_METHODS if name != 'onnx'])
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', dest='values', help='settings')
    arguments = parser.parse_args(argv)
    cv2.setNumThreads(1)
    frames = [frame for frame, _ in zip(SyntheticFlight(FlightConfig()), range(arguments.frames + 1), strict=False)]
    print(HEADER)
    for method in arguments.methods:
        try:
            values = {**_changes(arguments.values), 'optical_flow.method': method}
            print(measure(with_settings(PipelineConfig(), values), frames).line(method), flush=True)
        except BackendError as missing:
            print(f'flow_table: {missing}', file=sys.stderr)
        except MotionDetectError as error:
            print(f'flow_table: {error}', file=sys.stderr)
            return 2
    return 0


def _changes(texts: Sequence[str]) -> dict[str, Any]:
    if not texts:
        return {}
    from motion_detect_ros.benchmarks.accuracy import read_changes  # needs what make test-extras does not install

    return dict(read_changes(texts))


def measure(config: PipelineConfig, frames: Sequence[SyntheticFrame]) -> Row:
    """Flow of consecutive frames, the ego-motion estimated. Raises: BackendError for a method that is missing."""
    prepare, ego_motion, flow = Preprocessor(config.preprocessing), EgoMotionStage(config), OpticalFlowStage(config)
    history = FrameHistory(config.optical_flow.baseline_s)
    background, movers, times = [], [], []
    for frame in frames:
        prepared = prepare.process(frame.image, frame.stamp_ns)
        ego = ego_motion.process(prepared)
        reference = history.step(prepared, ego)
        start = time.process_time()
        found = flow.process(prepared, ego, reference).flow
        if not ego.ok:
            continue
        times.append(1e3 * (time.process_time() - start))
        cells = truth_on_grid(frame, *found.shape[:2])
        error = np.hypot(*np.moveaxis(found - cells.flow, -1, 0))
        background.append(error[cells.background])
        movers.append(error[cells.movers])
    return Row(np.concatenate(background), np.concatenate(movers), times)


def truth_on_grid(frame: SyntheticFrame, rows: int, columns: int) -> Cells:
    """Means of the exact flow over rows x columns cells, pixels of the frame since the one before.

    Cells with pixels of two kinds, or of unknown flow, are of neither kind.
    """
    size = columns, rows
    flow = cv2.resize(frame.flow, size, interpolation=cv2.INTER_AREA)
    moving = np.isin(frame.owner, frame.truth['id'][frame.truth['moving'] > 0])
    share = cv2.resize(moving.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    known = np.isfinite(flow).all(axis=2)
    return Cells(flow, known & (share <= 0.0), known & (share >= 1.0))


if __name__ == '__main__':
    sys.exit(main())
