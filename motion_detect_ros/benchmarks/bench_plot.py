"""Cost curves as pictures, both axes logarithmic.

    python -m motion_detect_ros.benchmarks.bench_plot docs/performance.json docs/images

draws those of an earlier run again.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from motion_detect_ros.benchmarks.bench_curves import Curve, Point
from motion_detect_ros.benchmarks.figures import make_figure, save

WIDTH_PX, HEIGHT_PX = 880, 480
#: Ticks of the time in every decade.
TICKS = (1.0, 2.0, 5.0)


def curve_figure(curve: Curve) -> Any:
    """A ``matplotlib.figure.Figure`` with a line a series. Points without a logarithm (zero objects) are left out.

    Raises: BackendError where matplotlib is missing.
    """
    figure = make_figure(WIDTH_PX, HEIGHT_PX)
    from matplotlib.ticker import LogLocator, NullLocator
    axes = figure.add_subplot(xscale='log', yscale='log', xlabel=curve.unit, ylabel='time a frame, ms')
    points = [point for point in curve.points if point.x > 0.0]
    for name, exponent in curve.slopes.items():
        axes.plot([point.x for point in points], [point.ms[name] for point in points], marker='o',
                  label=f'{name.replace("_", " ")}, $\\propto x^{{{exponent + 0.0:.2f}}}$')
    axes.yaxis.set_major_locator(LogLocator(subs=TICKS))
    axes.yaxis.set_major_formatter('{x:g}')
    axes.set_xticks([point.x for point in points],
                    [f'{point.x:.2g}' if point.x < 100.0 else f'{point.x:.0f}' for point in points])
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_locator(NullLocator())
    axes.grid(linewidth=0.4)
    axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure


def draw_curves(curves: list[Curve], folder: Path) -> None:
    """Write ``cost_<name>.png`` for each. Raises: BackendError."""
    for curve in curves:
        save(curve_figure(curve), folder / f'cost_{curve.name}.png')


def curves_of(figures: dict[str, Any]) -> list[Curve]:
    """The curves of ``bench --json``."""
    return [Curve(one['name'], one['unit'], one['counted'], [Point(**point) for point in one['points']])
            for one in figures['curves']]


if __name__ == '__main__':
    draw_curves(curves_of(json.loads(Path(sys.argv[1]).read_text(encoding='utf-8'))), Path(sys.argv[2]))
