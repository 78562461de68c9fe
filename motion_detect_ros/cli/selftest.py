"""``selftest``: whether this machine and installation will do, before anything flies. Exit code 0 where all passes.

The floors are those of the built-in flight in the default preset: accuracy does not depend on the machine, and the
latency that is asked for is a frame at the flight's own rate.
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from motion_detect_ros.cli.compiled_kernels import compile_missing
from motion_detect_ros.cli.demo import record_flight, run_in_process
from motion_detect_ros.cli.demo_table import score_rows
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.kernel_compiler import from_cache
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.summary import Percentiles
from motion_detect_ros.sources.synthetic import FlightConfig

OK, FAILED = 0, 1
#: Length of the flight, and F1 at IoU 0.3 of its moving objects of 32 x 32 px and larger: 0.96 (docs/accuracy.md).
FLIGHT_S, MIN_F1, SCORED = 5.0, 0.9, ('32 x 32 px and larger', 0.3)
#: Presets whose kernels are all that the presets of the package need; from the cache they are there after so long,
#: seconds.
COMPILED_PRESETS, WARM_S = ('visdrone', 'default'), 15.0
#: Two processes with the shipped profile, and as much again, bytes.
MIN_SHARED_MEMORY = 256 << 20
SHARED_MEMORY = Path('/dev/shm')
#: Before 1 January 2026 the system's clock is not set, s since 1970; how far it may drift in CLOCK_S seconds.
MIN_CLOCK_S, CLOCK_S, MAX_DRIFT_S = 1_767_225_600, 0.5, 0.02
#: How long a camera is listened to, seconds.
LISTEN_S = 5.0


@dataclass(frozen=True)
class Check:
    """``passed``: None = not tried; ``found``: what is the case; ``cure``: what helps where it did not pass."""

    name: str
    passed: bool | None
    found: str
    cure: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('--topic', help=f'also listen to the images of a camera for {LISTEN_S:g} s, e.g. /image_raw')
    parser.add_argument('--best-effort', action='store_true', help='listen to them best effort')


def run(arguments: argparse.Namespace) -> int:
    """Prints a line for each check.

    Raises: SourceError where a topic is to be listened to without ROS 2; ConfigError for what is no topic.
    """
    with_ros, topic = importlib.util.find_spec('rclpy') is not None, arguments.topic
    if topic is not None:
        if not with_ros:
            raise SourceError('--topic: expected an installation of ROS 2, found none')
        from motion_detect_ros.cli.selftest_camera import checked
        checked(topic)
    checks = [_shared_memory(), _clock(), compiled_kernels(), *_flight()]
    if with_ros:
        from motion_detect_ros.cli.selftest_camera import listen, profile
        checks += [Check(*profile()), *(Check(*row) for row in _camera(arguments, listen))]
    for check in checks:
        word = {True: 'pass', False: 'FAIL', None: 'not tried'}[check.passed]
        print(f'{word:<10}{check.name:<16}{check.found}' + ('' if check.passed else f'; {check.cure}'))
    return FAILED if any(check.passed is False for check in checks) else OK


def _camera(
    arguments: argparse.Namespace, listen: Callable[[str, bool, float], tuple[bool, str, str]],
) -> Iterator[tuple[str, bool | None, str, str]]:
    if arguments.topic is None:
        yield 'camera', None, 'no topic given', 'give --topic /image_raw'
        return
    yield 'camera', *listen(arguments.topic, arguments.best_effort, LISTEN_S)


def _shared_memory() -> Check:
    free = shutil.disk_usage(SHARED_MEMORY).free if SHARED_MEMORY.is_dir() else 0
    return Check('shared memory', free >= MIN_SHARED_MEMORY, f'{free >> 20} MB free in {SHARED_MEMORY}',
                 f'{MIN_SHARED_MEMORY >> 20} MB are wanted: docker run --shm-size=512m, or end what holds it')


def _clock() -> Check:
    system, steady = time.time(), time.monotonic()
    time.sleep(CLOCK_S)
    drift_s = (time.time() - system) - (time.monotonic() - steady)
    passed = system >= MIN_CLOCK_S and abs(drift_s) < MAX_DRIFT_S
    return Check('clock', passed, f'{time.strftime("%Y-%m-%d %H:%M", time.gmtime(system))} UTC, '
                 f'drift {1e3 * drift_s:+.1f} ms in {CLOCK_S:g} s', 'set it, and let chrony or ntpd slew it, not step')


def compiled_kernels() -> Check:
    """Compiled for every preset where they are not, and found again by another process."""
    configs = [load_preset(name) for name in COMPILED_PRESETS]
    compile_missing(*configs)
    with ProcessPoolExecutor(1, get_context('spawn')) as another:
        start = time.perf_counter()
        found = all(another.map(from_cache, configs))
        seconds = time.perf_counter() - start
    kept = 'from the cache' if found else 'without a cache'
    return Check('kernels', found and seconds < WARM_S, f'ready after {seconds:.1f} s in another process, {kept}',
                 'NUMBA_CACHE_DIR must be a folder that can be written')


def _flight() -> Iterator[Check]:
    config = FlightConfig(frames=round(FLIGHT_S * FlightConfig().fps))
    with tempfile.TemporaryDirectory(prefix='motion_detect_') as folder:
        truth = record_flight(config, Path(folder))
        answers = run_in_process(Path(folder) / 'flight.mcap', 'default')
    f1 = next(row.score.f1 for row in score_rows(truth, answers) if (row.what, row.iou) == SCORED)
    times = Percentiles.of(list(answers.times_ms))
    yield Check('accuracy', f1 >= MIN_F1, f'F1 {f1:.2f} on the built-in flight, at least {MIN_F1} is wanted',
                'the installation computes wrongly: versions of OpenCV and NumPy as in requirements.lock')
    limit_ms = 1e3 / config.fps
    found = f'p95 {times.p95:.0f} ms a frame, at most {limit_ms:.0f} ms is wanted for {config.fps:g} frames/s'
    yield Check('latency', times.p95 <= limit_ms, found,
                'end other programs, lower preprocessing.max_width_px, or decimate')
