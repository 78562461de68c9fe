"""How small, slow and fast: recall on synthetic flights over object size, object speed and camera motion.

    python -m motion_detect_ros.benchmarks.limits [--preset NAME] [--seeds N] [--jobs N] [--set NAME=VALUE ...]
        [--picture FILE] [--write docs/accuracy.md]

Recall at IoU 0.3 of textured square objects that have been in view for 8 frames. Prints the tables and the limits of
90 % recall, reached from the reference object outwards.
"""

from __future__ import annotations

import argparse
import dataclasses
import multiprocessing
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from motion_detect_ros.benchmarks.accuracy import read_changes
from motion_detect_ros.benchmarks.bench_timing import not_enlarging
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.figures import make_figure, save
from motion_detect_ros.benchmarks.generated import replace_section
from motion_detect_ros.benchmarks.heat_map import HeatMap, heat_figure
from motion_detect_ros.benchmarks.limits_flights import Cell, Found, fly
from motion_detect_ros.cli.progress import track
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import DoubleArray
from motion_detect_ros.presets import load_preset

SECTION = 'limits'
#: Recall that counts as found.
WANTED_RECALL = 0.9
#: The object and camera that the others are compared with.
SIZE_PX, SPEED_PX, PAN_PX = 32.0, 4.0, 4.0
SIZES_PX = (8.0, 12.0, 16.0, 24.0, 32.0, 48.0)


@dataclass(frozen=True)
class Axis:
    """A field of ``Cell`` and the values it takes."""

    field: str
    name: str
    values: tuple[float, ...]
    reference: float


@dataclass(frozen=True)
class Grid:
    """Object sizes (rows) against one more quantity (columns); ``base``: everything else."""

    title: str
    axis: Axis
    base: Cell

    def cells(self, sizes: Sequence[float], seeds: int) -> list[Cell]:
        """Row by row, column by column, seed by seed."""
        return [dataclasses.replace(self.base, size_px=size, seed=seed, **{self.axis.field: value})
                for size in sizes for value in self.axis.values for seed in range(1, seeds + 1)]


GRIDS = (
    Grid(f'recall in %, camera pans {PAN_PX:g} px/frame',
         Axis('speed_px', 'object speed, px/frame', (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0), SPEED_PX),
         Cell(SIZE_PX, SPEED_PX, PAN_PX)),
    Grid(f'recall in %, objects move {SPEED_PX:g} px/frame',
         Axis('pan_px', 'camera pan, px/frame', (0.0, 4.0, 8.0, 16.0, 24.0, 32.0, 40.0), PAN_PX),
         Cell(SIZE_PX, SPEED_PX)),
    Grid(f'recall in %, objects move {SPEED_PX:g} px/frame',
         Axis('turn_deg', 'camera turn, degrees/frame', (0.0, 0.5, 1.0, 2.0, 3.0, 4.0), 0.0),
         Cell(SIZE_PX, SPEED_PX)),
)


def shares(grid: Grid, sizes: Sequence[float], seeds: int, found: Sequence[Found]) -> DoubleArray:
    """(sizes, values) recall over all seeds, NaN where nothing was in view. found: in the order of ``Grid.cells``."""
    counts = np.array([(one.hits, one.wanted) for one in found], np.float64)
    hits, wanted = counts.reshape(len(sizes), len(grid.axis.values), seeds, 2).sum(axis=2).transpose(2, 0, 1)
    return np.divide(hits, wanted, out=np.full_like(hits, np.nan), where=wanted > 0)


def reach(values: Sequence[float], recall: DoubleArray, start: float) -> tuple[float, float] | None:
    """Least and greatest of the values around ``start`` up to which recall is enough; None if it is not at start."""
    enough = (recall >= WANTED_RECALL).tolist()
    low = high = list(values).index(start)
    if not enough[low]:
        return None
    while low > 0 and enough[low - 1]:
        low -= 1
    while high < len(values) - 1 and enough[high + 1]:
        high += 1
    return values[low], values[high]


def limits(sizes: Sequence[float], recalls: Sequence[DoubleArray]) -> list[str]:
    """Sentences about where 90 % are found. recalls: one (sizes, values) array for each of ``GRIDS``."""
    speed, pan, turn = (grid.axis for grid in GRIDS)
    row = list(sizes).index(SIZE_PX)
    size = reach(sizes, recalls[0][:, speed.values.index(SPEED_PX)], SIZE_PX)
    return [
        f'- smallest object at {SPEED_PX:g} px/frame: {_value(size, 0)} px',
        f'- slowest motion of an object of {SIZE_PX:g} px: {_value(reach(speed.values, recalls[0][row], SPEED_PX), 0)} '
        'px/frame',
        f'- fastest motion of it: {_value(reach(speed.values, recalls[0][row], SPEED_PX), 1)} px/frame',
        f'- fastest pan: {_value(reach(pan.values, recalls[1][row], PAN_PX), 1)} px/frame',
        f'- fastest turn: {_value(reach(turn.values, recalls[2][row], 0.0), 1)} degrees/frame']


def markdown(grid: Grid, sizes: Sequence[float], recall: DoubleArray) -> list[str]:
    """One grid as a table, recall in percent."""
    head = ' | '.join(f'{value:g}' for value in grid.axis.values)
    lines = [f'| size, px; {grid.axis.name}: | {head} |', '|---' * (len(grid.axis.values) + 1) + '|']
    lines += [f'| {size:g} | ' + ' | '.join('-' if np.isnan(one) else f'{100 * one:.0f}' for one in row) + ' |'
              for size, row in zip(sizes, recall.tolist(), strict=True)]
    return lines


def measure(config: PipelineConfig, sizes: Sequence[float], seeds: int, processes: int) -> list[DoubleArray]:
    """Recall of every grid; flights with the same ground one after the other, as painting it takes longest."""
    cells = [cell for grid in GRIDS for cell in grid.cells(sizes, seeds)]
    ordered = sorted(set(cells), key=lambda cell: cell.seed)
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(processes, context, cv2.setNumThreads, (1,)) as pool:
        flown = track(pool.map(partial(fly, config=config), ordered), len(ordered), 'flights')
        found: Mapping[Cell, Found] = dict(zip(ordered, flown, strict=True))
    return [shares(grid, sizes, seeds, [found[cell] for cell in grid.cells(sizes, seeds)]) for grid in GRIDS]


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 for wrong settings or a file that cannot be written."""
    parser = argparse.ArgumentParser(prog='limits', description='Recall over size, speed and camera motion.')
    parser.add_argument('--preset', default='visdrone', metavar='NAME', help='name or YAML file (default: visdrone)')
    parser.add_argument('--seeds', type=int, default=2, metavar='N', help='flights a cell (default: 2)')
    parser.add_argument('--jobs', type=int, default=2, metavar='N', help='processes (default: 2)')
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', help='settings on top of the preset')
    parser.add_argument('--picture', type=Path, metavar='FILE', help='draw the heat maps (needs the extra plots)')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the tables into this document, too')
    options = parser.parse_args(arguments)
    config = with_settings(not_enlarging(load_preset(options.preset)), read_changes(options.set))
    if options.picture:
        make_figure(1, 1)
    recalls = measure(config, SIZES_PX, options.seeds, options.jobs)
    lines = _report(recalls)
    print('\n'.join(lines))
    if options.picture:
        draw(recalls, options.picture)
    if options.write:
        replace_section(options.write, f'{SECTION}, preset {options.preset}', lines)
    return 0


def draw(recalls: Sequence[DoubleArray], path: Path) -> None:
    """All grids side by side. Raises: BackendError where matplotlib is missing or the file cannot be written."""
    save(heat_figure([HeatMap(grid.title, 'object size, px', grid.axis.name, SIZES_PX, grid.axis.values, recall)
                      for grid, recall in zip(GRIDS, recalls, strict=True)]), path)


def _report(recalls: Sequence[DoubleArray]) -> list[str]:
    lines = [f'{100 * WANTED_RECALL:.0f} % recall:', '', *limits(SIZES_PX, recalls), '']
    for grid, recall in zip(GRIDS, recalls, strict=True):
        lines += [f'{grid.title[0].upper()}{grid.title[1:]}:', '', *markdown(grid, SIZES_PX, recall), '']
    return lines[:-1]


def _value(found: tuple[float, float] | None, end: int) -> str:
    return 'none' if found is None else f'{found[end]:g}'


if __name__ == '__main__':
    sys.exit(main())
