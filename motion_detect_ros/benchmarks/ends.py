"""Bring-up and end, again and again: how long nodes take to end in every state that they can be in.

    python -m motion_detect_ros.benchmarks.ends --times 200 [-o out/ends]

Every case in turn: while it starts, idle, at work, without its other inputs, on a clock that stands, and the camera on
a stream that flows, is frozen, refused, or a black hole. SIGINT and SIGTERM in turn, at a random moment of the state.
Writes ``ends.csv``. Exit codes: 0 every node ended with code 0 within 2 s (of processor time, where the machine is
busy), 1 one did not, 2 a node does not come up.
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import astuple, dataclass, fields
from pathlib import Path

from motion_detect_ros.benchmarks.bench_nodes import cpu_s
from motion_detect_ros.benchmarks.bench_transport import pictures
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.feeder import Feeder
from motion_detect_ros.benchmarks.jpeg_stream import JpegStream
from motion_detect_ros.bridge.arguments import text_parameter
from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.cli.domains import lock_of, own_domain
from motion_detect_ros.core.errors import SourceError

#: A node that is told to end has ended after so long, seconds.
END_S = 2.0
START_TIMEOUT_S, END_TIMEOUT_S, POLL_S = 180.0, 30.0, 0.01
#: The moment of the signal is so long after the state is reached, at most, seconds.
WITHIN_S = 1.0
#: A library that a node loads first of all: before that, the signal is Python's.
LOADED_FIRST = '_multiarray_umath'
WIDTH, HEIGHT, RATE_HZ = 320, 180, 5.0


@dataclass(frozen=True)
class End:
    """``seconds``, ``cpu_s``: from the signal to the end of the process, and the processor time that it took for that;
    ``load``: of the machine at that time, processes that want to run.
    """

    case: str
    node: str
    seconds: float
    cpu_s: float
    code: int
    load: float

    @property
    def good(self) -> bool:
        """Clean, and in time: by the clock, or by processor time where more processes want to run than can."""
        busy = self.load > (os.cpu_count() or 1)
        return self.code == 0 and (self.cpu_s if busy else self.seconds) < END_S


@dataclass(frozen=True)
class Case:
    """A node with its arguments. ``disturb``: what is done once it works; ``waits``: for the node in the graph, else
    the signal falls into its start.
    """

    name: str
    node: str
    arguments: tuple[str, ...] = ()
    disturb: Callable[[], None] | None = None
    waits: bool = True


class Ends:
    """The surroundings that the cases need; use as a context manager."""

    def __init__(self) -> None:
        self._domain, self._random = own_domain(), random.Random(1)
        self._stack = ExitStack()
        images = pictures(WIDTH, HEIGHT)
        self._feeder = Feeder(self._domain, images, RATE_HZ)
        self._flowing, self._frozen, self._lost = (JpegStream(images, RATE_HZ) for _ in range(3))
        self._hole = socket.create_server(('127.0.0.1', 0))

    def __enter__(self) -> Ends:
        folder = self._stack.enter_context(tempfile.TemporaryDirectory())
        self._environment = {**environment(), 'ROS_DOMAIN_ID': str(self._domain), 'ROS_HOME': folder,
                             'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        for part in (self._feeder, self._flowing, self._frozen, self._lost, self._hole):
            self._stack.enter_context(part)
        self._feeder.go()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def cases(self) -> list[Case]:
        """Every state."""
        small = 'preprocessing.max_width_px:=160'
        hole = f'http://127.0.0.1:{self._hole.getsockname()[1]}/live.mjpg'
        flowing, frozen, lost, hole = (text_parameter('source', address) for address in (
            self._flowing.address, self._frozen.address, self._lost.address, hole))
        return [
            Case('pipeline starts', 'pipeline', (small,), waits=False),
            Case('pipeline at work', 'pipeline', (small,)),
            Case('pipeline on a clock that stands', 'pipeline', (small, 'use_sim_time:=true')),
            Case('art2_clustering without flow', 'art2_clustering', (small,)),
            Case('overlay unconfigured', 'overlay', ('autostart:=false',)),
            Case('camera starts', 'camera', (flowing,), waits=False),
            Case('camera on a stream', 'camera', (flowing,)),
            Case('camera on a frozen stream', 'camera', (frozen,), self._frozen.freeze),
            Case('camera on a refused stream', 'camera', (lost,), self._lost.refuse),
            Case('camera on a black hole', 'camera', (hole,)),
        ]

    def run(self, times: int) -> Iterator[End]:
        """So many ends, the cases in turn. Raises: SourceError where a node does not come up."""
        cases = self.cases()
        for number in range(times):
            for stream in (self._frozen, self._lost):
                stream.flow()
            yield self._end(cases[number % len(cases)], number)

    def _end(self, case: Case, number: int) -> End:
        name = f'ending_{number}'
        command = [sys.executable, '-m', f'motion_detect_ros.nodes.{case.node}', '--ros-args', '-r', f'__node:={name}']
        for argument in case.arguments:
            command += ['-p', argument]
        process = subprocess.Popen(command, env=self._environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                   pass_fds=lock_of(self._domain))
        try:
            if case.waits:
                self._await(lambda: name in self._feeder.nodes, process)
            if case.disturb is not None:
                self._await(lambda: int(self._feeder.diagnostics(name).get('received', '0')) > 0, process)
                case.disturb()
            if not case.waits:
                maps = Path(f'/proc/{process.pid}/maps')
                self._await(lambda: LOADED_FIRST in maps.read_text(encoding='ascii', errors='replace'), process)
            time.sleep(self._random.uniform(0.0, WITHIN_S))
            return self._signalled(case, process, signal.SIGTERM if number % 2 else signal.SIGINT)
        finally:
            process.kill()
            process.wait()

    @staticmethod
    def _signalled(case: Case, process: subprocess.Popen[bytes], number: signal.Signals) -> End:
        began_s, used_s = time.monotonic(), cpu_s(process.pid)
        process.send_signal(number)
        ended, status, usage = 0, 0, None
        while not ended and time.monotonic() - began_s < END_TIMEOUT_S:
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            time.sleep(POLL_S)
        seconds, load = round(time.monotonic() - began_s, 2), round(os.getloadavg()[0], 1)
        if not ended or usage is None:
            return End(case.name, case.node, seconds, END_TIMEOUT_S, -signal.SIGKILL, load)
        process.returncode = os.waitstatus_to_exitcode(status)
        spent_s = round(usage.ru_utime + usage.ru_stime - used_s, 2)
        return End(case.name, case.node, seconds, spent_s, process.returncode, load)

    def _await(self, reached: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
        deadline = time.monotonic() + START_TIMEOUT_S
        while not reached():
            if process.poll() is not None or time.monotonic() > deadline:
                raise SourceError(f'node: expected it to start, it ended with {process.poll()}')
            time.sleep(POLL_S)


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog='ends', description=__doc__.partition('\n')[0])
    parser.add_argument('--times', type=int, default=200, metavar='N', help='starts and ends (default: 200)')
    parser.add_argument('-o', '--output', type=Path, default=Path('out/ends'), help='folder of ends.csv')
    given = parser.parse_args(arguments)
    given.output.mkdir(parents=True, exist_ok=True)
    ended = list[End]()
    with Ends() as ends, (given.output / 'ends.csv').open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(End)])
        for one in ends.run(given.times):
            ended.append(one)
            writer.writerow(astuple(one))
            file.flush()
    for case in dict.fromkeys(one.case for one in ended):
        of_case = [one for one in ended if one.case == case]
        spent_s = max(one.cpu_s for one in of_case)
        print(f'{case}: {sum(one.good for one in of_case)} of {len(of_case)}, at most '
              f'{max(one.seconds for one in of_case):.2f} s, {spent_s:.2f} s of processor time')
    return 0 if all(one.good for one in ended) else 1


if __name__ == '__main__':
    sys.exit(main())
