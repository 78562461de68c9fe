"""Grids of shares as a picture: a colour and a number a cell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_detect_ros.benchmarks.figures import make_figure
from motion_detect_ros.core.types import DoubleArray

CELL_PX, BESIDE_PX, ABOVE_PX = (46, 40), 160, 110
#: Cells with more than this share have dark numbers.
LIGHT_SHARE = 0.6


@dataclass(frozen=True)
class HeatMap:
    """``shares``: (rows, columns) 0..1, NaN = empty; ``rows``, ``columns``: values of the axes."""

    title: str
    row_name: str
    column_name: str
    rows: Sequence[float]
    columns: Sequence[float]
    shares: DoubleArray


def heat_figure(maps: Sequence[HeatMap]) -> Any:
    """A ``matplotlib.figure.Figure`` with the maps side by side, first row at the bottom, numbers in %.

    Raises: BackendError where matplotlib is missing.
    """
    counts = [len(heat.columns) for heat in maps]
    rows = max(len(heat.rows) for heat in maps)
    figure = make_figure(CELL_PX[0] * sum(counts) + BESIDE_PX, CELL_PX[1] * rows + ABOVE_PX)
    every = figure.subplots(1, len(maps), squeeze=False, width_ratios=counts)[0]
    for axes, heat in zip(every, maps, strict=True):
        image = axes.imshow(heat.shares, origin='lower', aspect='auto', vmin=0.0, vmax=1.0, cmap='viridis')
        axes.set_title(heat.title, fontsize='small')
        axes.set(xlabel=heat.column_name, ylabel=heat.row_name)
        axes.set_xticks(range(len(heat.columns)), [f'{value:g}' for value in heat.columns])
        axes.set_yticks(range(len(heat.rows)), [f'{value:g}' for value in heat.rows])
        for row, column in np.argwhere(np.isfinite(heat.shares)).tolist():
            share = float(heat.shares[row, column])
            axes.text(column, row, f'{100.0 * share:.0f}', ha='center', va='center', fontsize='small',
                      color='black' if share > LIGHT_SHARE else 'white')
    figure.colorbar(image, ax=every.tolist(), label='recall', fraction=0.03, pad=0.01, format='{x:.0%}')
    return figure
