"""The real graph as child processes: nodes over DDS, fed by the bag player, heard by a planner."""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from motion_detect_ros.bridge.arguments import text_parameter
from motion_detect_ros.bridge.qos import CLOCK_DEPTH
from motion_detect_ros.bridge.serialized import header_stamp_ns
from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.cli.domains import lock_of, own_domain
from motion_detect_ros.cli.holding import Holding
from motion_detect_ros.cli.interrupts import held_back
from motion_detect_ros.cli.planner import Planner, Received
from motion_detect_ros.core.errors import MessageError, SourceError
from motion_detect_ros.presets import preset_path
from motion_detect_ros.sources.bags import BagReader
from motion_detect_ros.sources.timeline import timeline

#: The three stages as separate processes; the fourth node of the graph is the player or camera.
STAGES = ('ego_motion', 'optical_flow', 'art2_clustering')
#: How long nodes may take to start (an empty kernel cache compiles), to stop, and messages to come, seconds.
START_TIMEOUT_S = 120.0
STOP_TIMEOUT_S = 10.0
IDLE_TIMEOUT_S = 15.0
POLL_S = 0.05
#: After this without an answer the images that lack one are looked at, seconds.
QUIET_S = 2.0
#: What the nodes listen to.
IMAGE_TOPIC, COMPRESSED_TOPIC, CAMERA_TOPIC, IMU_TOPIC = 'image_raw', 'image_raw/compressed', 'camera_info', 'imu'
#: What goes from one process to another for each image.
IMAGE_BY_IMAGE = (IMAGE_TOPIC, COMPRESSED_TOPIC, CAMERA_TOPIC, 'ego_motion', 'flow', 'detections')
#: Which of the images of these stamps cannot be answered.
Refused = Callable[[Collection[int]], Collection[int]]


@dataclass(frozen=True)
class Playback:
    """What a planner heard while a bag was played; ``published``: images the player published; ``held_s``: how long it
    waited for the stages; ``processed``: images by stage, ``left_out``: by the first one on purpose, as the stages have
    last said.
    """

    received: tuple[Received, ...]
    published: int
    seconds: float
    held_s: float = 0.0
    processed: Mapping[str, int] = field(default_factory=dict)
    left_out: int = 0


class LiveGraph:
    """Starts ``nodes`` as processes of their own; use as a context manager. Stops them by process id.

    preset: name or path of a parameter file, given to every node; parameters: further ``name:=value`` for every node
    and for the player; compressed: the nodes listen to JPEG or PNG images.
    Raises: SourceError where a node ends or does not come up in time.
    """

    def __init__(
        self, preset: str = 'default', nodes: tuple[str, ...] = STAGES, domain_id: int | None = None,
        parameters: tuple[str, ...] = (), compressed: bool = False,
    ) -> None:
        self._preset, self._further = str(preset_path(preset)), parameters
        self._stages = (f'image_transport:={"compressed" if compressed else "raw"}', 'first_id:=1')  # ids as offline
        self._nodes = nodes
        self._image_topic = COMPRESSED_TOPIC if compressed else IMAGE_TOPIC
        self._domain_id = own_domain() if domain_id is None else domain_id
        self._environment = {
            **environment(), 'ROS_DOMAIN_ID': str(self._domain_id), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._started: list[subprocess.Popen[bytes]] = []
        self.exit_codes: dict[str, int] = {}
        self._log = Path(tempfile.mkdtemp(prefix='motion_detect_'))
        self._environment['ROS_HOME'] = str(self._log)

    def __enter__(self) -> LiveGraph:
        os.environ.update({name: self._environment[name] for name in ('ROS_AUTOMATIC_DISCOVERY_RANGE',)})
        for name, value in self._environment.items():
            os.environ.setdefault(name, value)
        with contextlib.ExitStack() as stack:
            stack.push(self._stop)
            self.planner = stack.enter_context(Planner(self._domain_id))
            for node in self._nodes:
                self._processes[node] = self._spawn(
                    node, ['--params-file', self._preset, *_set(node, (*self._stages, *self._further))])
            self._await(lambda: self.planner.subscribers_of(self._image_topic) >= len(self._nodes))
            self._await(lambda: self.planner.publishers_of('detections') >= 1)
            # What a stage publishes before it has found the next one is lost.
            self._await(lambda: all(self.planner.connected(f'/{node}') for node in self._nodes))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def process_id(self, node: str) -> int:
        """Of a node's process."""
        return self._processes[node].pid

    def output(self, node: str) -> str:
        """What a node has printed so far."""
        return (self._log / f'{node}.txt').read_text(encoding='utf-8', errors='replace')

    def play(
        self, bag: Path, images: int, rate: float = 1.0, topics: Mapping[str, str] | None = None,
        wanted: Collection[int] | None = None, hold: bool = False, refused: Refused | None = None,
    ) -> Playback:
        """Plays a bag through the nodes and gives what the planner heard, sorted by stamp.

        images: how many of those in the bag the nodes are to answer, which may leave some out; topics: what to play,
        and under which name; None = everything under its own; wanted: stamps of the images to be answered, None = all;
        hold: the player waits where the stages are behind; refused: asked at the end which images of ``wanted``, of
        those without an answer, get none, so that they are not waited for.
        """
        played = topics or {topic: topic.lstrip('/') for topic in _topics(bag)}
        self.planner.expect(_clock_of_images(bag, played, self._image_topic), wanted)
        player = ['-p', text_parameter('bag', str(bag)), '-p', f'rate:={float(rate)}',
                  '-p', f'wait_for_subscribers:={len(self._nodes)}']
        player += _set('bag_player', self._further)
        if topics:
            player += ['-p', text_parameter('topics', ','.join(topics))]
        for recorded, name in (topics or {}).items():
            player += ['-r', f'{recorded.lstrip("/")}:={name}']
        start, holding = time.monotonic(), Holding(self.planner) if hold else None
        process = self._spawn('bag_player', player)
        try:
            self._await_end(process, images, holding, lambda: self._refused(wanted or (), refused))
            if holding:
                holding.release()
        except BaseException:  # Ctrl-C, maybe for this process only: nobody hears the rest
            process.send_signal(signal.SIGINT)
            raise
        finally:
            _end(process)
        return Playback(self.heard, self.planner.published, time.monotonic() - start,
                        holding.held_s if holding else 0.0, self._processed(),
                        self.planner.counter(f'/{self._nodes[0]}', 'left_out') or 0)

    def _refused(self, wanted: Collection[int], refused: Refused | None) -> int:
        """How many images without an answer get none."""
        unanswered = frozenset(wanted) - {message.stamp_ns for message in self.planner.received}
        return len(refused(unanswered)) if refused else 0

    def _processed(self) -> dict[str, int]:
        counts = {node: self.planner.counter(f'/{node}', 'processed') for node in self._nodes}
        return {node: count for node, count in counts.items() if count is not None}

    @property
    def heard(self) -> tuple[Received, ...]:
        """What the planner has heard of the bag so far, sorted by stamp."""
        return tuple(sorted(self.planner.received, key=lambda message: message.stamp_ns))

    def _await_end(
        self, process: subprocess.Popen[bytes], images: int, holding: Holding | None, refused: Callable[[], int],
    ) -> None:
        """Until all answers are there, or none has come for a while after the last image was published.

        refused: how many of the images get none, asked once things are quiet.
        """
        count, changed, asked = 0, time.monotonic(), False
        while count < images and (quiet_s := time.monotonic() - changed) < IDLE_TIMEOUT_S:
            self._check_alive()
            if process.poll() not in (None, 0):
                raise SourceError(f'bag_player: ended with {process.poll()}: {self.output("bag_player").strip()}')
            self.planner.wait_for(count + 1, POLL_S)
            if holding:
                holding.look()
            if quiet_s > QUIET_S and not asked:
                images, asked = images - refused(), True
            news = self.planner.answers
            if news > count or (process.poll() is None and self.planner.published < self.planner.expected):
                count, changed = news, time.monotonic()

    def _spawn(self, node: str, parameters: list[str]) -> subprocess.Popen[bytes]:
        command = [sys.executable, '-m', f'motion_detect_ros.nodes.{node}', '--ros-args', *parameters]
        with (self._log / f'{node}.txt').open('wb') as log, held_back():
            process = subprocess.Popen(command, env=self._environment, stdout=log, stderr=subprocess.STDOUT,
                                       pass_fds=lock_of(self._domain_id))
            self._started.append(process)
        return process

    def _await(self, condition: Any) -> None:
        deadline = time.monotonic() + START_TIMEOUT_S
        while not condition():
            self._check_alive()
            if time.monotonic() > deadline:
                raise SourceError(f'nodes: expected them to be up within {START_TIMEOUT_S:.0f} s; see {self._log}')
            time.sleep(POLL_S)

    def _check_alive(self) -> None:
        for node, process in self._processes.items():
            if process.poll() is not None:
                lines = self.output(node).strip().splitlines()
                said = '\n'.join(line for line in lines if not line.startswith('[INFO]'))
                raise SourceError(f'{node}: ended with exit code {process.poll()}' + (f': {said}' if said else ''))

    def _stop(self, kind: type[BaseException] | None, *_: object) -> None:
        for process in self._started:
            process.send_signal(signal.SIGINT)
        try:
            for process in self._started:
                _end(process)
        finally:  # after a second Ctrl-C none is waited for
            for process in self._started:
                process.kill()
            self.exit_codes = {node: _end(process) for node, process in self._processes.items()}
            # What failed nodes have printed stays to be read; one that is told to end while it loads has a code too.
            interrupted = kind is not None and issubclass(kind, KeyboardInterrupt)
            if interrupted or (kind is None and not any(self.exit_codes.values())):
                shutil.rmtree(self._log, ignore_errors=True)


def _set(node: str, parameters: tuple[str, ...]) -> list[str]:
    """Words that give a node ``name:=value``, whatever a section of its own in a parameter file says."""
    return [word for parameter in parameters for word in ('-p', f'{node}:{parameter}')]


def queues(depth: int) -> tuple[str, ...]:
    """Settings of nodes and player under which so many images may wait before any is lost, wherever they wait."""
    return (f'queue_size:={depth}', *(setting for topic in IMAGE_BY_IMAGE for setting in depth_of(topic, depth)),
            *depth_of('clock', max(depth, CLOCK_DEPTH)))  # ticks with other messages than images too


def depth_of(topic: str, depth: int) -> tuple[str, str]:
    """Settings under which so many messages of ``topic`` wait at its publisher and at each subscriber."""
    publisher, subscription = (f'qos_overrides./{topic}.{end}.depth:={depth}' for end in ('publisher', 'subscription'))
    return publisher, subscription


def _topics(bag: Path) -> list[str]:
    with BagReader(bag) as reader:
        return [topic.name for topic in reader.topics]


def _clock_of_images(bag: Path, played: Mapping[str, str], image_topic: str) -> dict[int, int]:
    """Stamp of each image that the nodes get -> what ``/clock`` shows when it is played, ns."""
    clock_of: dict[int, int] = {}
    with BagReader(bag) as reader:
        for timed in timeline(reader.messages(played)):
            if played[timed.message.topic] == image_topic:
                with contextlib.suppress(MessageError):
                    clock_of.setdefault(header_stamp_ns(timed.message.data), timed.clock_ns)
    return clock_of


def _end(process: subprocess.Popen[bytes]) -> int:
    try:
        return process.wait(STOP_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def spread(values_ms: list[float]) -> tuple[float, float, float]:
    """Median, 95th and 99th percentile of the known values; NaN where there are none."""
    known = np.array([value for value in values_ms if math.isfinite(value)] or [math.nan])
    median, p95, p99 = np.percentile(known, [50, 95, 99])
    return float(median), float(p95), float(p99)
