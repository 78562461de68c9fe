"""Camera and detector on two hosts with a radio link between them that loses, delays, and breaks for seconds."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import pytest
from lossy_link import LossyLink, refusal
from peers import TIMEOUT_S, picture, small

from motion_detect_ros.bridge import transport
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.presets import find_config

pytestmark = pytest.mark.messages

LOSS, DELAY_S, PARTITION_S = 0.02, 0.02, 5.0
RATE_HZ, PICTURES, SHOWN = 10, 40, 3000
LISTENER = Path(__file__).with_name('graph_listener.py')
WARN = 1


class Hosts:
    """Processes on the two sides of the link, and what the listener of side 1 has printed."""

    def __init__(self, link: LossyLink, folder: Path) -> None:
        self._link, self._folder = link, folder
        self._environment = {
            **os.environ, transport.PROFILE_VARIABLE: str(find_config('fastdds_wireless_profile.xml')),
            'ROS_HOME': str(folder), 'ROS_DOMAIN_ID': str(own_domain()),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
        self.running: list[subprocess.Popen[bytes]] = []

    def start(self, side: int, name: str, *words: str) -> subprocess.Popen[bytes]:
        with (self._folder / f'{name}.log').open('wb') as log:
            process = subprocess.Popen([*self._link.run(side), sys.executable, *words], env=self._environment,
                                       stdout=log, stderr=subprocess.STDOUT)
        self.running.append(process)
        return process

    def lines(self, name: str) -> list[list[str]]:
        """Words of what the listener has printed of a topic or node."""
        text = (self._folder / 'listener.log').read_text()
        return [line.split(' ', 3) for line in text.splitlines(keepends=True)
                if line.startswith(f'{name} ') and line.endswith('\n')]

    def until(self, condition: Callable[[], object]) -> bool:
        deadline = time.monotonic() + TIMEOUT_S
        while not condition():
            assert all(process.poll() is None for process in self.running)
            if time.monotonic() > deadline:
                return False
            time.sleep(0.1)
        return True


@pytest.fixture
def link() -> Iterator[LossyLink]:
    if reason := refusal():
        pytest.skip(f'no network namespaces with a link here: {reason}')
    with LossyLink(LOSS, DELAY_S) as one:
        yield one


@pytest.fixture
def hosts(link: LossyLink, tmp_path: Path) -> Iterator[Hosts]:
    one = Hosts(link, tmp_path)
    yield one
    for process in one.running:
        process.send_signal(signal.SIGINT)
    for process in one.running:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(TIMEOUT_S)
        process.kill()


def test_a_link_that_loses_delays_and_breaks(hosts, link, tmp_path, shown):
    folder = tmp_path / 'pictures'
    folder.mkdir()
    jpegs = [cv2.imencode('.jpg', picture(index))[1].tobytes() for index in range(PICTURES)]
    for index in range(SHOWN):
        (folder / f'{index:05d}.jpg').write_bytes(jpegs[min(index % 78, 78 - index % 78)])
    hosts.start(1, 'listener', str(LISTENER))
    hosts.start(1, 'pipeline', '-m', 'motion_detect_ros.nodes.pipeline', '--ros-args',
                *small('image_transport:=compressed'))
    hosts.start(0, 'camera', '-m', 'motion_detect_ros.nodes.camera', '--ros-args', '-p', f'source:={folder}',
                '-p', f'fps:={float(RATE_HZ)}', '-p', 'wait_for_subscribers:=1')
    assert hosts.until(lambda: len(hosts.lines('detections')) > 10 * RATE_HZ)
    before = [int(words[1]) for words in hosts.lines('detections')][RATE_HZ:]
    answered = len(before) / (1 + (before[-1] - before[0]) * 1e-9 * RATE_HZ)

    link.cut, cut_s = True, time.monotonic()
    time.sleep(PARTITION_S)
    link.cut, healed_s = False, time.monotonic()
    assert hosts.until(lambda: any(float(words[2]) > healed_s for words in hosts.lines('detections')))
    again_s = next(float(words[2]) for words in hosts.lines('detections') if float(words[2]) > healed_s) - healed_s
    count = len(hosts.lines('detections'))
    assert hosts.until(lambda: len(hosts.lines('detections')) > count + 3 * RATE_HZ)

    silent = [words for words in hosts.lines('/pipeline')
              if int(words[1]) >= WARN and float(words[2]) > cut_s and 'nothing received for' in words[3]]
    assert silent, 'the detector says that it hears nothing'
    stamps = [int(words[1]) for words in hosts.lines('detections')]
    assert stamps == sorted(set(stamps)), 'detections came twice, or went back in time'
    assert answered > 0.5
    assert link.lost > 0
    shown('camera and detector on two hosts, 2 % of the packets lost, 20 ms late; then no link for 5 s',
          'compressed images are answered in order, silence is WARN, detections come again by themselves',
          f'{answered:.0%} answered, silence told after {float(silent[0][2]) - cut_s:.1f} s, '
          f'detections {again_s:.1f} s after the link')
