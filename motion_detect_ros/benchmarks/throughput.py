"""Regenerates the table of docs/offline.md: many bags by one and two processes, and on a Dask cluster of as many.

``python -m motion_detect_ros.benchmarks.throughput --markdown docs/offline.md``
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.cli.progress import track
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

BAGS, FRAMES, WIDTH, HEIGHT = 8, 100, 480, 270
WORKERS = 1, 2
SECTION = 'throughput'


@dataclass(frozen=True)
class Row:
    """One way to do all bags: seconds from command to end, processor time of all its processes, and whether the results
    had the bytes of the first way.
    """

    way: str
    workers: int
    wall_s: float
    processor_s: float
    same: bool


def main(words: Sequence[str] | None = None) -> int:
    """Exit code 0; 1 where two ways did not give the same bytes."""
    parser = argparse.ArgumentParser(description='Throughput of replay over many bags.')
    parser.add_argument('--markdown', type=Path, help='document whose section is replaced')
    parser.add_argument('--bags', type=int, default=BAGS)
    parser.add_argument('--frames', type=int, default=FRAMES, help='of each bag')
    arguments = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as folder:
        write_bags(Path(folder) / 'bags', arguments.bags, arguments.frames)
        rows = measure(Path(folder))
    show(table(rows, arguments.bags, arguments.frames), arguments.markdown, SECTION)
    return 0 if all(row.same for row in rows) else 1


def write_bags(folder: Path, bags: int, frames: int) -> None:
    """The built-in flight, from one frame later on in each bag."""
    flight = SyntheticFlight(FlightConfig(width=WIDTH, height=HEIGHT, focal_px=360.0, frames=frames + bags))
    pictures = [frame.image for frame in track(flight, len(flight), 'flight')]
    for number in range(bags):
        with BagWriter(folder / f'flight_{number}.mcap', compress=False) as bag:
            for index in range(frames):
                bag.write_image(pictures[number + index], flight.stamp_ns(index))


def measure(folder: Path) -> list[Row]:
    """Every way, one after the other; one run before them loads the compiled kernels into the cache."""
    run(folder, 'warm', '--duration', '1')
    rows = []
    for way, do in (('processes', in_processes), ('Dask', on_cluster)):
        for workers in WORKERS:
            name, before_s = f'{way}_{workers}', _processor_s()
            wall_s = do(folder, name, workers)
            rows.append(Row(way, workers, wall_s, _processor_s() - before_s, _same(folder, name)))
    return rows


def in_processes(folder: Path, name: str, workers: int) -> float:
    """Seconds with so many processes of this machine."""
    return run(folder, name, '--workers', str(workers))


def _processor_s() -> float:
    """Of all processes that have ended, s: other programs make it little longer."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run(folder: Path, name: str, *words: str) -> float:
    """Seconds of ``replay`` over all bags. Raises: BackendError where it fails."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, '-m', 'motion_detect_ros', 'replay', str(folder / 'bags'), '-o', str(folder / name), *words],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise BackendError(f'replay {" ".join(words)}: expected exit code 0, got {done.returncode}: {done.stderr}')
    return time.perf_counter() - start


def on_cluster(folder: Path, name: str, workers: int) -> float:
    """The same on a cluster of this machine that is there already. Raises: BackendError without dask.distributed."""
    try:
        import distributed
    except ModuleNotFoundError:
        raise BackendError("expected dask.distributed (pip install 'motion_detect_ros[cluster]'), found none") from None
    local: Any = distributed.LocalCluster  # half annotated
    with local(n_workers=workers, threads_per_worker=max(1, (os.cpu_count() or 1) // workers), processes=True,
               host='127.0.0.1', dashboard_address='127.0.0.1:0', local_directory=str(folder)) as cluster:
        return run(folder, name, '--scheduler', str(cluster.scheduler_address))


def _same(folder: Path, name: str) -> bool:
    first = folder / f'processes_{WORKERS[0]}'
    return all(file.read_bytes() == (folder / name / file.relative_to(first)).read_bytes()
               for kind in ('detections.csv', 'detections.mcap', 'frames.csv') for file in sorted(first.rglob(kind)))


def table(rows: Sequence[Row], bags: int, frames: int) -> list[str]:
    """Lines of Markdown."""
    load = os.getloadavg()[0]
    lines = [f'{bags} bags of {frames} frames, {WIDTH}x{HEIGHT}, preset `default`, {os.cpu_count()} cores '
             f'({platform.machine()}), load average at the end {load:.1f}; start of the processes included.', '',
             '| by | workers | s | frames/s | against one | processor s | same bytes |',
             '|---|---|---|---|---|---|---|']
    for row in rows:
        one = next(each for each in rows if each.way == row.way)
        lines.append(f'| {row.way} | {row.workers} | {row.wall_s:.1f} | {bags * frames / row.wall_s:.0f} '
                     f'| {one.wall_s / row.wall_s:.2f} | {row.processor_s:.1f} | {"yes" if row.same else "NO"} |')
    return lines


if __name__ == '__main__':
    sys.exit(main())
