"""Memory of ``replay`` over a long recording: the built-in flight, to and fro, for hours; every format is written.

    python -m motion_detect_ros.benchmarks.replay_memory --hours 2 -o out/memory

Prints resident memory as it goes and writes it to ``samples.csv``; the recording is deleted at the end. Further words
go to ``replay`` as they are. Exit codes: 0 flat, 1 memory grows or is too large, 2 wrong use or a replay that fails.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from motion_detect_ros.benchmarks.bench_nodes import resident_mb
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.core.errors import ConfigError, SourceError
from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.results.detection_bag import jpeg
from motion_detect_ros.results.files import FRAMES_NAME
from motion_detect_ros.results.formats import FORMATS
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.frames import FIRST_STAMP_NS
from motion_detect_ros.sources.part_file import part_of
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

RATE_HZ = 10.0
#: Small pictures, so that hours take minutes, from low above many cars, so that there is something to detect.
FLIGHT = FlightConfig(width=160, height=120, focal_px=180.0, altitude_m=30.0, cars=80, frames=120, fps=RATE_HZ)
PERIOD_FRAMES = 2000
LOOK_S = 0.5
#: Memory after this share of the recording is compared; before it, caches fill.
SETTLED_SHARE = 0.25
#: What may be gained after that, and the most there may ever be, megabytes.
GROWTH_MB, HIGHEST_MB = 10.0, 500.0


@dataclass(frozen=True)
class Sample:
    """Resident memory of the replay once so many frames were done, ``hours`` into the recording."""

    frames: int
    hours: float
    memory_mb: float


@dataclass(frozen=True)
class Verdict:
    """``growth_mb_per_hour``: slope of a line through the settled part, by hours of the recording."""

    highest_mb: float
    growth_mb: float
    growth_mb_per_hour: float

    @property
    def flat(self) -> bool:
        """Whether memory neither grows nor is too large."""
        return self.growth_mb <= GROWTH_MB and self.highest_mb <= HIGHEST_MB


def write_recording(path: Path, frames: int) -> None:
    """A bag of ``frames`` JPEG pictures at RATE_HZ: the flight forwards and backwards, so that no picture jumps."""
    there = [jpeg(frame.image) for frame in SyntheticFlight(FLIGHT)]
    loop = there + there[-2:0:-1]
    with BagWriter(path, compress=False) as bag:
        for index in range(frames):
            stamp_ns = FIRST_STAMP_NS + round(index * NANOSECONDS / RATE_HZ)
            bag.write_compressed(loop[index % len(loop)], 'jpeg', stamp_ns)


def watch(command: Sequence[str], progress: Path, period: int = PERIOD_FRAMES) -> Iterator[Sample]:
    """Run ``command`` and sample it every ``period`` lines that it adds to the file ``progress``.

    Raises: SourceError where it fails.
    """
    with tempfile.TemporaryFile() as said:
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said) as process:
            yield from _samples(process, progress, period)
        said.seek(0)
        if process.returncode:
            raise SourceError(f'replay: expected exit code 0, got {process.returncode}: '
                              f'{said.read().decode(errors="replace").strip()[-500:]}')


def _samples(process: subprocess.Popen[bytes], progress: Path, period: int) -> Iterator[Sample]:
    done, position, wanted = 0, 0, period
    try:
        while process.poll() is None:
            time.sleep(LOOK_S)
            if progress.is_file():
                with progress.open('rb') as file:
                    file.seek(position)
                    new = file.read()
                done, position = done + new.count(b'\n'), position + len(new)
            if done >= wanted and process.poll() is None:
                wanted = (done // period + 1) * period
                try:
                    memory_mb = resident_mb(process.pid)
                except SourceError:  # it has ended just now
                    return
                yield Sample(done, round(done / RATE_HZ / 3600.0, 3), memory_mb)
    finally:
        process.kill()


def replay_command(bag: Path, results: Path, more: Sequence[str]) -> list[str]:
    """The command that replays ``bag`` into ``results`` in every format."""
    return [sys.executable, '-m', 'motion_detect_ros', 'replay', str(bag), '-o', str(results), '--formats',
            ','.join(FORMATS), *more]


def judge(samples: Sequence[Sample]) -> Verdict:
    """Growth of the settled part. Raises: SourceError for too few samples to tell."""
    settled = samples[int(SETTLED_SHARE * len(samples)):]
    if len(settled) < 2:
        raise SourceError(f'expected samples of {3 * PERIOD_FRAMES} frames and more, got {len(samples)} samples')
    memory = np.array([sample.memory_mb for sample in settled])
    slope = np.polyfit([sample.hours for sample in settled], memory, 1)[0]
    return Verdict(max(sample.memory_mb for sample in samples), round(float(memory[-1] - memory[0]), 1),
                   round(float(slope), 2))


def measure(hours: float, folder: Path, more: Sequence[str], period: int = PERIOD_FRAMES) -> Verdict:
    """Write a recording of so many hours, replay it, print and write the samples."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch, \
            (folder / 'samples.csv').open('w', newline='', encoding='utf-8') as file:
        bag, results = Path(scratch) / 'long.mcap', Path(scratch) / 'results'
        write_recording(bag, round(3600.0 * hours * RATE_HZ))
        print(f'{bag.stat().st_size / 1e6:.0f} MB of pictures', flush=True)
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(Sample)])
        samples, start_s = list[Sample](), time.monotonic()
        for sample in watch(replay_command(bag, results, more), part_of(results / FRAMES_NAME), period):
            samples.append(sample)
            writer.writerow(asdict(sample).values())
            file.flush()
            print(f'{sample.frames:7d} frames  {sample.hours:6.3f} h  {sample.memory_mb:6.1f} MB  '
                  f'after {time.monotonic() - start_s:.0f} s', flush=True)
        for result in sorted(results.iterdir()):
            print(f'{result.name:20s} {result.stat().st_size / 1e6:8.2f} MB')
    return judge(samples)


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog='replay_memory', description=__doc__.partition('\n')[0])
    parser.add_argument('--hours', type=float, default=2.0, help='length of the recording')
    parser.add_argument('-o', '--output', type=Path, default=Path('out/memory'), help='folder of the samples')
    given, more = parser.parse_known_args(arguments)
    if not given.hours > 0.0:
        raise ConfigError(f'--hours: expected over 0, got {given.hours:g}')
    verdict = measure(given.hours, given.output, more)
    print(f'highest {verdict.highest_mb:.1f} MB, growth {verdict.growth_mb:.1f} MB, '
          f'{verdict.growth_mb_per_hour:.2f} MB an hour of the recording')
    return 0 if verdict.flat else 1


if __name__ == '__main__':
    sys.exit(main())
