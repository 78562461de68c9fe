"""``soak --faults``: a graph of real nodes on real pictures, and for all the time what happens to it in the field.

In the first sixth of the run every node is killed and starts again, then parameters change, the camera's driver starts
anew, its clock steps an hour to and fro, and with the four nodes the stream of the camera is cut; from then on all but
the kills come again and again, in turn, and nothing may grow any more.
"""

from __future__ import annotations

import csv
import itertools
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from motion_detect_ros.benchmarks.bench_clips import first_clip
from motion_detect_ros.benchmarks.bench_nodes import NodeProcesses
from motion_detect_ros.benchmarks.bench_transport import GRAPHS, await_nodes, clip_pictures, parameters, pictures
from motion_detect_ros.benchmarks.feeder import Answer, Feeder
from motion_detect_ros.benchmarks.jpeg_stream import JpegStream
from motion_detect_ros.benchmarks.soak_verdict import LEAST_MINUTES, Fault, ProcessSample, Verdict, judge, settled_s
from motion_detect_ros.bridge.arguments import text_parameter
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.core.errors import ConfigError, SourceError
from motion_detect_ros.core.types import ByteArray
from motion_detect_ros.results.files import write_whole

#: Pictures of the clip, played forward and backward.
CLIP_FRAMES = 120
#: Between two samples, and two faults at least, seconds; share of the run between two faults.
PERIOD_S, FAULT_PERIOD_S, FAULT_SHARE = 10.0, 20.0, 1.0 / 30.0
#: No answer for so long after a fault: given up, seconds.
RECOVERY_TIMEOUT_S = 120.0
POLL_S = 0.05
CAMERA = 'camera'
SUMMARY_NAME = 'summary.json'


@dataclass(frozen=True)
class Due:
    """What is done to the graph, and when, seconds after the start."""

    seconds: float
    name: str
    action: Callable[[], None]


class Graph:
    """The nodes under test, fed with pictures; use as a context manager.

    With ``four nodes`` the camera runs on a stream of its own, in the namespace ``stream``; the stages get their
    pictures from this process, whose clock can step.
    """

    def __init__(self, name: str, preset: str, rate_hz: float, images: Sequence[ByteArray]) -> None:
        self.stages = GRAPHS[name]
        domain = own_domain()
        self._stack = ExitStack()
        self.feeder = Feeder(domain, images, rate_hz)
        self.processes = NodeProcesses(self.stages, domain, parameters(preset))
        self.stream = JpegStream(images, rate_hz) if name != 'pipeline' else None
        self.camera: NodeProcesses | None = None
        if self.stream:
            source = text_parameter('source', self.stream.address)
            self.camera = NodeProcesses((CAMERA,), domain, (source,), namespace='stream')

    def __enter__(self) -> Graph:
        if self.stream and self.camera:
            self._stack.enter_context(self.stream)
            self._stack.enter_context(self.camera)
        self._stack.enter_context(self.feeder)
        self._stack.enter_context(self.processes)
        await_nodes(self.feeder, self.processes, len(self.stages))
        self.feeder.go()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def check(self) -> None:
        """Raises: SourceError where a node has ended."""
        self.processes.check()
        if self.camera:
            self.camera.check()

    def sample(self, seconds: float) -> Iterator[ProcessSample]:
        """Figures of every process."""
        everyone = [(self.processes, node) for node in self.stages]
        everyone += [(self.camera, CAMERA)] if self.camera else []
        for group, node in everyone:
            yield ProcessSample(seconds, node, group.memory_mb(node), group.threads(node), group.handles(node),
                                group.cpu_s(node))

    def set_parameter(self, name: str, value: float) -> None:
        """Of every stage that has it."""
        for node in self.stages:
            self.feeder.set_parameter(node, name, value)

    def schedule(self, run_s: float) -> Iterator[Due]:
        """Every fault of the run, in order."""
        first_s, faults = settled_s(run_s), self._faults()
        for index, node in enumerate(self.stages):
            yield Due(first_s * (0.05 + 0.4 * index / len(self.stages)), f'kill {node}',
                      partial(self.processes.kill_and_restart, node))
        for index, (name, action) in enumerate(faults):
            yield Due(first_s * (0.5 + 0.45 * index / len(faults)), name, action)
        step_s = max(FAULT_PERIOD_S, FAULT_SHARE * run_s)
        for number, (name, action) in enumerate(itertools.cycle(faults), start=1):
            if (seconds := first_s + number * step_s) > run_s - step_s:
                return
            yield Due(seconds, name, action)

    def _faults(self) -> list[tuple[str, Callable[[], None]]]:
        set_to = self.set_parameter
        return [
            ('parameter that holds at once', lambda: set_to('art2.vigilance', 0.3)),
            ('driver starts anew', self.feeder.reconnect),
            ('clock + 1 h', lambda: self.feeder.shift(3600.0)),
            ('parameter that clears history', lambda: set_to('preprocessing.ignore_top_px', 24)),
            *([('stream is cut', self.stream.cut)] if self.stream else []),
            ('parameter that holds at once', lambda: set_to('art2.vigilance', 0.2)),
            ('clock - 1 h', lambda: self.feeder.shift(-3600.0)),
            ('parameter that clears history', lambda: set_to('preprocessing.ignore_top_px', 14)),
        ]


class Recorder:
    """Takes the answers and the figures of the processes, and writes them as they come."""

    def __init__(self, graph: Graph, folder: Path) -> None:
        self._graph, self._start_s = graph, time.monotonic()
        self.answers: list[Answer] = []
        self.samples: list[ProcessSample] = []
        self.loads: list[float] = []
        self.faults: list[Fault] = []
        self._pending: list[tuple[str, float]] = []
        self._file = (folder / 'processes.csv').open('w', newline='', encoding='utf-8')
        self._writer = csv.writer(self._file)
        self._writer.writerow([*ProcessSample.__dataclass_fields__, 'load'])

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._start_s

    def take(self) -> None:
        """What was answered since the last call; raises: SourceError where a fault is not survived."""
        for answer in self._graph.feeder.take():
            sent_s = answer.sent_s - self._start_s
            self.answers.append(Answer(answer.stamp_ns, answer.latency_ms, sent_s))
            survived = [fault for fault in self._pending if sent_s >= fault[1]]
            self._pending = [fault for fault in self._pending if fault not in survived]
            self.faults += [Fault(name, at_s, sent_s + answer.latency_ms / 1e3 - at_s) for name, at_s in survived]
        for name, at_s in self._pending:
            if self.seconds - at_s > RECOVERY_TIMEOUT_S:
                raise SourceError(f'{name}: expected detections within {RECOVERY_TIMEOUT_S:.0f} s, got none')

    def inflict(self, due: Due) -> None:
        """Do it; the next answer to a picture sent later tells how long it took."""
        print(f'{self.seconds:7.0f} s  {due.name}', flush=True)
        self._pending.append((due.name, self.seconds))
        due.action()

    def sample(self) -> None:
        """Figures of every process now."""
        load = os.getloadavg()[0]
        self.loads.append(load)
        for sample in self._graph.sample(round(self.seconds, 1)):
            self.samples.append(sample)
            self._writer.writerow([*asdict(sample).values(), load])
        self._file.flush()
        answered = sum(answer.sent_s > self.seconds - PERIOD_S for answer in self.answers)
        now = {one.node: one for one in self.samples}
        print(f'{self.seconds:7.0f} s  {answered} answers, load {load:.1f}', *(
            f'{one.node} {one.memory_mb:.1f} MB {one.threads} threads {one.handles} handles'
            for one in now.values()), sep=', ', flush=True)

    def close(self) -> None:
        """The file is complete."""
        self._file.close()


def run(minutes: float, graph_name: str, preset: str, rate_hz: float, folder: Path) -> Verdict:
    """Run, write the files, give the verdict; what was seen is judged and written however the run ends.

    Raises: SourceError where a node ends by itself or stays silent; ConfigError for a run too short to be judged.
    """
    if not minutes >= LEAST_MINUTES:
        raise ConfigError(f'--minutes: expected {LEAST_MINUTES:g} or more with --faults, got {minutes:g}')
    folder.mkdir(parents=True, exist_ok=True)
    with Graph(graph_name, preset, rate_hz, real_pictures()) as graph:
        recorder = Recorder(graph, folder)
        try:
            _play(graph, recorder, 60.0 * minutes)
        finally:
            recorder.close()
            ran = min(minutes, round(recorder.seconds / 60.0, 2))
            verdict = judge(ran, graph_name, rate_hz, graph.feeder.sent, recorder.answers, recorder.samples,
                            recorder.faults, recorder.loads)
            text = json.dumps({**asdict(verdict), 'steady': verdict.steady, 'in_time': verdict.in_time}, indent=1)
            write_whole(folder / SUMMARY_NAME, text + '\n')
    return verdict


def real_pictures() -> list[ByteArray]:
    """Of the first clip that is there; else of the synthetic flight."""
    clip = first_clip()
    return pictures() if clip is None else clip_pictures(clip, CLIP_FRAMES)


def _play(graph: Graph, recorder: Recorder, run_s: float) -> None:
    schedule = graph.schedule(run_s)
    due, sample_s = next(schedule, None), PERIOD_S
    while recorder.seconds < run_s:
        if due and recorder.seconds >= due.seconds:
            recorder.inflict(due)
            due = next(schedule, None)
        if recorder.seconds >= sample_s:
            recorder.sample()
            sample_s += PERIOD_S
        graph.check()
        recorder.take()
        time.sleep(POLL_S)
