"""Soak: the real ``pipeline`` node under a steady stream for a given time; memory, latency and drops over time.

    python -m motion_detect_ros.benchmarks.soak --minutes 30 -o out/soak

    python -m motion_detect_ros.benchmarks.soak --minutes 30 --real --preset visdrone -o out/soak_real

    python -m motion_detect_ros.benchmarks.soak --minutes 30 --rate 5 --faults "four nodes" -o out/soak

Writes ``samples.csv`` as it goes and ``summary.json`` at the end, or when it is interrupted. With ``--faults``, for 3
minutes at least, a graph is fed real pictures where ``MOTION_DETECT_DATA`` holds some, and disturbed all the time
(``soak_faults``): writes ``processes.csv`` and ``summary.json`` likewise. Exit codes: 0 steady, 1 memory grows or
pictures get lost, 2 wrong use or a node that ends. With ``--real`` the pictures are those of a real clip, in a loop.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from motion_detect_ros.benchmarks import soak_faults
from motion_detect_ros.benchmarks.accuracy_clips import DATA_VARIABLE, Clip
from motion_detect_ros.benchmarks.bench_clips import first_clip
from motion_detect_ros.benchmarks.bench_nodes import NodeProcesses
from motion_detect_ros.benchmarks.bench_timing import Timing
from motion_detect_ros.benchmarks.bench_transport import (
    GRAPHS,
    RATE_HZ,
    await_nodes,
    clip_pictures,
    parameters,
    pictures,
)
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.feeder import Feeder
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.cli.interrupts import interrupt_once
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.results.files import write_whole

PERIOD_S = 10.0
#: Memory after this share of the run is compared; before it, caches fill.
SETTLED_SHARE = 0.25
#: Megabytes an hour, and in all, that a steady node may gain after that.
GROWTH_MB_PER_HOUR, GROWTH_MB = 20.0, 5.0
#: Pictures that may be neither answered nor counted as dropped: what came since the last report, and a share.
UNREPORTED, LOST_SHARE = 40, 0.002
NODE = 'pipeline'
#: Where the pictures are from without ``--real``.
FLIGHT = 'built-in flight'
_ENDING = (signal.SIGINT, signal.SIGTERM)


@dataclass(frozen=True)
class Sample:
    """One period. ``seconds``: since the start; ``sent``, ``answered``, ``dropped``, ``errors``: within the period."""

    seconds: float
    memory_mb: float
    cpu_percent: float
    sent: int
    answered: int
    dropped: int
    errors: int
    latency_p50_ms: float
    latency_p95_ms: float
    latency_max_ms: float
    compute_p50_ms: float


@dataclass(frozen=True)
class SoakSummary:
    """``pictures``: where they are from; ``lost``: those neither answered nor counted as dropped by the node;
    ``growth_mb_per_hour``: slope of a line through the memory of the settled part; ``steady``: the result.
    """

    pictures: str
    preset: str
    minutes: float
    rate_hz: float
    sent: int
    answered: int
    dropped: int
    errors: int
    lost: int
    memory_first_mb: float
    memory_last_mb: float
    memory_highest_mb: float
    growth_mb: float
    growth_mb_per_hour: float
    latency_p50_ms: float
    latency_p95_ms: float
    latency_max_ms: float
    steady: bool


class Sampler:
    """Turns running totals into what happened within each period."""

    def __init__(self, feeder: Feeder, processes: NodeProcesses) -> None:
        self._feeder, self._processes = feeder, processes
        self._start_s = self._before_s = time.monotonic()
        self._sent, self._cpu_s = feeder.sent, processes.cpu_s(NODE)
        self._dropped, self._errors = self._counted('dropped'), self._counted('errors')

    def sample(self) -> Sample:
        """The period since the last call."""
        now_s, sent, cpu_s = time.monotonic(), self._feeder.sent, self._processes.cpu_s(NODE)
        dropped, errors, answers = self._counted('dropped'), self._counted('errors'), self._feeder.take()
        timing = Timing.of('latency', [answer.latency_ms for answer in answers])
        found = Sample(
            round(now_s - self._start_s, 1), self._processes.memory_mb(NODE),
            round(100.0 * (cpu_s - self._cpu_s) / (now_s - self._before_s), 1), sent - self._sent, len(answers),
            dropped - self._dropped, errors - self._errors, timing.p50, timing.p95,
            round(max((answer.latency_ms for answer in answers), default=math.nan), 2),
            round(float(self._feeder.diagnostics(NODE).get('latency_p50_ms', 'nan')), 2))
        self._before_s, self._sent, self._cpu_s, self._dropped, self._errors = now_s, sent, cpu_s, dropped, errors
        return found

    def _counted(self, name: str) -> int:
        return int(self._feeder.diagnostics(NODE).get(name, '0'))


def soak(
    minutes: float, preset: str, rate_hz: float, folder: Path, period_s: float = PERIOD_S, clip: Clip | None = None,
) -> SoakSummary:
    """Run, write the files, give the summary. clip: whose pictures are shown in a loop, None = those of the flight.

    Raises: SourceError where the node ends.
    """
    images = pictures() if clip is None else clip_pictures(clip, soak_faults.CLIP_FRAMES)
    folder.mkdir(parents=True, exist_ok=True)
    samples, domain = list[Sample](), own_domain()
    try:
        with Feeder(domain, images, rate_hz) as feeder, \
                NodeProcesses((NODE,), domain, parameters(preset)) as processes, \
                (folder / 'samples.csv').open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow([field.name for field in fields(Sample)])
            await_nodes(feeder, processes, 1)
            feeder.go()
            sampler, end_s = Sampler(feeder, processes), time.monotonic() + 60.0 * minutes
            while time.monotonic() < end_s:
                time.sleep(min(period_s, max(0.1, end_s - time.monotonic())))
                processes.check()
                samples.append(sampler.sample())
                writer.writerow(asdict(samples[-1]).values())
                file.flush()
                print(_line(samples[-1]), flush=True)
    finally:
        summary = summarize(samples, rate_hz, FLIGHT if clip is None else clip.name, preset)
        write_whole(folder / soak_faults.SUMMARY_NAME, json.dumps(asdict(summary), indent=1) + '\n')
    return summary


def summarize(samples: Sequence[Sample], rate_hz: float, shown: str, preset: str) -> SoakSummary:
    """Summary of the samples. shown: where the pictures are from."""
    settled = samples[int(SETTLED_SHARE * len(samples)):]
    memory = [sample.memory_mb for sample in settled] or [math.nan]
    sent, answered = sum(sample.sent for sample in samples), sum(sample.answered for sample in samples)
    growth, per_hour = memory[-1] - memory[0], _per_hour(settled)
    dropped, errors = sum(sample.dropped for sample in samples), sum(sample.errors for sample in samples)
    lost = max(0, sent - answered - dropped - errors)
    grows = growth > GROWTH_MB and per_hour > GROWTH_MB_PER_HOUR
    known = [sample for sample in samples if math.isfinite(sample.latency_p50_ms)]
    return SoakSummary(
        shown, preset, round(samples[-1].seconds / 60.0, 2) if samples else 0.0, rate_hz, sent, answered, dropped,
        errors, lost, memory[0], memory[-1], max(memory), round(growth, 1), round(per_hour, 1),
        round(float(np.median([sample.latency_p50_ms for sample in known] or [math.nan])), 2),
        round(float(np.median([sample.latency_p95_ms for sample in known] or [math.nan])), 2),
        max((sample.latency_max_ms for sample in known), default=math.nan),
        bool(sent) and not grows and not errors and lost <= max(UNREPORTED, LOST_SHARE * sent))


def _per_hour(samples: Sequence[Sample]) -> float:
    if len(samples) < 2:
        return 0.0
    hours = np.array([sample.seconds for sample in samples]) / 3600.0
    return float(np.polyfit(hours, np.array([sample.memory_mb for sample in samples]), 1)[0])


def _line(sample: Sample) -> str:
    return (f'{sample.seconds:7.0f} s  {sample.memory_mb:6.1f} MB  cpu {sample.cpu_percent:5.1f} %  '
            f'{sample.answered} of {sample.sent}  dropped {sample.dropped}  '
            f'latency {sample.latency_p50_ms:.1f} / {sample.latency_p95_ms:.1f} / {sample.latency_max_ms:.1f} ms')


def _disturbed(given: argparse.Namespace) -> int:
    verdict = soak_faults.run(given.minutes, given.faults, given.preset, given.rate, given.output)
    print((given.output / soak_faults.SUMMARY_NAME).read_text(encoding='utf-8'), end='')
    return 0 if verdict.steady else 1


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog='soak', description=__doc__.partition('\n')[0])
    parser.add_argument('--minutes', type=float, default=30.0, help='how long')
    parser.add_argument('--rate', type=float, default=RATE_HZ, help='pictures a second, 960x540')
    parser.add_argument('--preset', default='default', help='settings: default, visdrone, kitti, report or a YAML file')
    parser.add_argument('--real', action='store_true', help='pictures of the first real clip that is there, in a loop')
    parser.add_argument('--faults', choices=GRAPHS, help='disturb this graph all the time')
    parser.add_argument('-o', '--output', type=Path, default=Path('out/soak'), help='folder of the files')
    given = parser.parse_args(arguments)
    handlers = {number: signal.getsignal(number) for number in _ENDING}
    interrupt_once(*_ENDING)  # the nodes end with this process
    try:
        if not given.minutes > 0.0 or not given.rate > 0.0:
            raise ConfigError(f'--minutes, --rate: expected over 0, got {given.minutes:g}, {given.rate:g}')
        clip = first_clip() if given.real else None
        if given.real and clip is None:
            raise ConfigError(f'--real: expected real clips, found none; set {DATA_VARIABLE}')
        (given.output / soak_faults.SUMMARY_NAME).unlink(missing_ok=True)  # of another run
        if given.faults:
            return _disturbed(given)
        summary = soak(given.minutes, given.preset, given.rate, given.output, clip=clip)
    except KeyboardInterrupt:
        seen = given.output / soak_faults.SUMMARY_NAME
        print(f'interrupted; {f"{seen} holds what was seen" if seen.is_file() else "nothing was seen yet"}',
              file=sys.stderr)
        return 1
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    print(json.dumps(asdict(summary), indent=1))
    return 0 if summary.steady else 1


if __name__ == '__main__':
    sys.exit(main())
