"""``bench``: what a frame costs, against what OpenCV alone would take, as it grows, and over real processes."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from motion_detect_ros.benchmarks import bench_clips, bench_curves, bench_stages
from motion_detect_ros.benchmarks.bench_plot import draw_curves
from motion_detect_ros.benchmarks.bench_report import machine, markdown
from motion_detect_ros.benchmarks.bench_timing import WARM_FRAMES
from motion_detect_ros.benchmarks.figures import make_figure
from motion_detect_ros.cli.progress import track
from motion_detect_ros.core.errors import BackendError, ConfigError

#: Fewer frames than this have no percentiles.
MIN_FRAMES = 2 * WARM_FRAMES
#: Nodes are fed this many times the frames of the other measurements.
NODE_FRAMES, MEMORY_FRAMES = 5, 10
#: Parts that start processes.
NODE_PARTS = ('transport', 'transport_clip', 'start', 'memory')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--preset', default='default', help='settings: default, visdrone, kitti, report or a YAML file')
    parser.add_argument('--frames', type=int, default=60, help=f'frames of each measurement, at least {MIN_FRAMES}')
    parser.add_argument('--parts', help=f'some of {",".join(PARTS)}, separated by commas; the others stay as the '
                                        'file of --json has them; default: all')
    parser.add_argument('--no-nodes', action='store_true', help='leave the nodes out, measure in this process only')
    parser.add_argument('--soak', type=Path, nargs='+', default=[],
                        help='summary.json of runs of benchmarks.soak, for the document')
    parser.add_argument('--json', type=Path, help='write the figures here too')
    parser.add_argument('--markdown', type=Path,
                        help='write the document here, pictures to images/ beside it (needs the extra plots)')


def run(arguments: argparse.Namespace) -> int:
    """Measure, print markdown, write what was asked for.

    Raises: ConfigError for a part that does not exist; BackendError where matplotlib is missing for the pictures.
    """
    if arguments.frames < MIN_FRAMES:
        raise ConfigError(f'--frames: expected {MIN_FRAMES} or more, got {arguments.frames}')
    parts = chosen(arguments.parts, arguments.no_nodes)
    if arguments.markdown and 'curves' in parts:
        make_figure(1, 1)
    figures = {**_earlier(arguments), 'machine': machine(), 'preset': arguments.preset, 'frames': arguments.frames}
    if arguments.soak:
        figures['soak'] = [_read(path) for path in arguments.soak]
    for part in track(parts, len(parts), 'parts'):
        figures[part] = PARTS[part](arguments)
        _write(arguments, figures)
    print(markdown(figures))
    return 0


def _earlier(arguments: argparse.Namespace) -> dict[str, Any]:
    """What the file of ``--json`` has: with ``--parts`` the other parts, else what is not measured here.

    Raises: ConfigError for another file.
    """
    if not (arguments.json and arguments.json.is_file()):
        return {}
    figures = _read(arguments.json)
    return figures if arguments.parts else {name: figures[name] for name in ('soak',) if name in figures}


def _read(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text(encoding='utf-8')))
    except OSError as error:
        raise ConfigError(f'{path}: figures cannot be read: {error.strerror}') from None
    except ValueError as error:
        raise ConfigError(f'{path}: expected figures of an earlier run, got {error}') from None


def _write(arguments: argparse.Namespace, figures: dict[str, Any]) -> None:
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + '\n', encoding='utf-8')
    if arguments.markdown:
        arguments.markdown.write_text(markdown(figures), encoding='utf-8')


def chosen(words: str | None, no_nodes: bool = False) -> list[str]:
    """Parts in the order they are measured in. Raises: ConfigError for one that does not exist."""
    wanted = list(PARTS) if words is None else [word.strip() for word in words.split(',')]
    unknown = [word for word in wanted if word not in PARTS]
    if unknown:
        raise ConfigError(f'--parts: expected some of {", ".join(PARTS)}, got {", ".join(map(repr, unknown))}')
    return [part for part in PARTS if part in wanted and not (no_nodes and part in NODE_PARTS)]


def _stages(arguments: argparse.Namespace) -> dict[str, Any]:
    return {size: [asdict(row) for row in rows]
            for size, rows in bench_stages.stages(arguments.preset, arguments.frames).items()}


def _curves(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    found = bench_curves.curves(arguments.preset)
    if arguments.markdown:
        draw_curves(found, arguments.markdown.parent / 'images')
    return [bench_curves.as_json(curve) for curve in found]


def _nodes() -> Any:
    try:
        from motion_detect_ros.benchmarks import bench_transport
    except ModuleNotFoundError as error:
        raise BackendError(f'bench: expected an installation of ROS 2, but {error.name} is missing; '
                           '--no-nodes measures without') from None
    return bench_transport


#: Name -> what measures it.
PARTS: dict[str, Callable[[argparse.Namespace], Any]] = {
    'stages': _stages,
    'clips': lambda arguments: bench_clips.clip_costs(arguments.frames),
    'reported': lambda arguments: bench_stages.reported(arguments.frames),
    'floor': lambda arguments: [asdict(row) for row in bench_stages.floors(arguments.preset, arguments.frames)],
    'one_thread': lambda arguments: bench_stages.one_thread(arguments.frames),
    'background': lambda arguments: [
        asdict(row) for row in bench_stages.backgrounds(arguments.preset, arguments.frames)],
    'curves': _curves,
    'codec': lambda _: [asdict(row) for row in bench_stages.codec_times()],
    'transport': lambda arguments: [
        asdict(row) for row in _nodes().latencies(arguments.preset, NODE_FRAMES * arguments.frames)],
    'transport_clip': lambda arguments: [
        asdict(row) for row in _nodes().clip_latencies(NODE_FRAMES * arguments.frames)],
    'start': lambda arguments: asdict(_nodes().start_up(arguments.preset)),
    'memory': lambda arguments: asdict(_nodes().memory(arguments.preset, MEMORY_FRAMES * arguments.frames)),
}
