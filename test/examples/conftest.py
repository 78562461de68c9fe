"""The examples as users run them, beside the real nodes, while synthetic flights are played: once for all tests."""

from __future__ import annotations

import contextlib
import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from flights import DESCENT, EXAMPLES, RUN, TOWN, Flown
from geometry_msgs.msg import Quaternion, TwistStamped
from peers import PATIENT, TIMEOUT_S, Peer
from sensor_msgs.msg import Imu, LaserScan, PointCloud2
from std_msgs.msg import String

from motion_detect_ros.bridge.images import header_of
from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.cli.demo import FLIGHT_BAG, record_flight
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.cli.live import LiveGraph
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight
from motion_detect_ros.sources.synthetic.camera_path import CameraPath

#: Topic -> type of everything they publish.
ANSWERS = {
    'avoidance/suggestion': String, 'follower/target': PointCloud2, 'cmd_vel': TwistStamped, 'points': PointCloud2,
    'autopilot_frames/bearings_ned': PointCloud2, 'obstacles': LaserScan,
}
#: The last answers are on their way while the detections are already here.
LAST_ANSWERS_S = 20.0


@contextlib.contextmanager
def running(folder: Path) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """Every example as a process; each must end cleanly at SIGINT."""
    variables = {**environment(), 'ROS_DOMAIN_ID': str(own_domain()), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                 'ROS_HOME': str(folder)}
    processes, logs = {}, {}
    for name, parameters in RUN.items():
        words = [word for parameter in parameters for word in ('-p', parameter)]
        logs[name] = folder / f'{name}.log'
        with logs[name].open('wb') as log:
            processes[name] = subprocess.Popen([sys.executable, EXAMPLES / f'{name}.py', '--ros-args', *words],
                                               env=variables, stdout=log, stderr=subprocess.STDOUT)
    try:
        yield processes
        for process in processes.values():
            process.send_signal(signal.SIGINT)
        for name, process in processes.items():
            assert process.wait(TIMEOUT_S) == 0, logs[name].read_text()
            assert 'Traceback' not in logs[name].read_text()
    finally:
        for process in processes.values():
            process.kill()


def send_attitudes(peer: Peer, publisher: Any, config: FlightConfig) -> None:
    """The attitude at each image as MAVROS gives it: body FLU in world ENU. The town's camera only yaws.

    The camera's forward axis is the third row of its rotation, world (east, north, up) -> optical.
    """
    flight, path = SyntheticFlight(config), CameraPath(config)
    for index in range(config.frames):
        east, north, _ = path.pose(index).rotation[2]
        half = math.atan2(north, east) / 2
        publisher.publish(Imu(header=header_of(flight.stamp_ns(index), 'base_link'),
                              orientation=Quaternion(w=math.cos(half), z=math.sin(half))))
        peer.rest(0.02)


@pytest.fixture(scope='session')
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Flown]:
    """``town`` and ``descent``, played through the pipeline node with all examples beside it."""
    folder = tmp_path_factory.mktemp('examples')
    configs = {'descent': DESCENT, 'town': TOWN}
    for name, config in configs.items():
        record_flight(config, folder / name)
    results: dict[str, Flown] = {}
    with (pytest.MonkeyPatch.context() as patch, LiveGraph('default', ('pipeline',), parameters=PATIENT) as graph,
          running(folder) as processes):
        patch.setattr('motion_detect_ros.cli.live.IDLE_TIMEOUT_S', TIMEOUT_S)
        peer = Peer(own_domain())
        try:
            heard = {topic: peer.subscribe(kind, topic, 1000) for topic, kind in ANSWERS.items()}
            attitude = peer.advertise(Imu, 'imu/data')
            assert peer.until(lambda: all(peer.node.count_publishers(topic) for topic in ANSWERS))
            assert peer.matched('imu/data', 1)
            send_attitudes(peer, attitude, TOWN)
            # An example that the detector has not found yet misses the first images: until each has answered.
            deadline = time.monotonic() + TIMEOUT_S
            while not all(heard.values()):
                assert time.monotonic() < deadline, {topic: len(messages) for topic, messages in heard.items()}
                assert [name for name, process in processes.items() if process.poll() is not None] == []
                graph.play(folder / 'town' / FLIGHT_BAG, TOWN.frames, rate=2.0)
                peer.rest(0.5)
            for name, config in configs.items():
                peer.rest(1.0)
                for messages in heard.values():
                    messages.clear()
                bag = folder / name / FLIGHT_BAG
                playback = graph.play(bag, config.frames)
                expected = [messages for topic, messages in heard.items() if name == 'town' or 'ned' not in topic]
                peer.until(lambda expected=expected, count=config.frames: all(
                    len(messages) >= count for messages in expected), LAST_ANSWERS_S)
                results[name] = Flown(config, bag, playback.received, {topic: list(m) for topic, m in heard.items()})
        finally:
            peer.close()
    return results
