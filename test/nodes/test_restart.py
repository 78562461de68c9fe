"""What a process that ends and starts again leaves to the others, and how fast it ends."""

from __future__ import annotations

import csv
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import pytest
from peers import TIMEOUT_S, Peer, image_message, ready, small
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, PointCloud2
from transport_files import ports_of, segments_of, set_back_checks

from motion_detect_ros.benchmarks import ends
from motion_detect_ros.bridge.images import header_of
from motion_detect_ros.bridge.managed_node import PORTS_PERIOD_S
from motion_detect_ros.bridge.records import read_detections
from motion_detect_ros.bridge.shared_memory import MIN_AGE_S, give_up_dead_ports
from motion_detect_ros.cli.domains import own_domain

pytestmark = pytest.mark.messages

FRAMES = 12
#: A node that is told to end has ended after so long, and the others know well before its lease of 20 s is over,
#: seconds.
END_S, GONE_S = 2.0, 10.0
ENDS = 20
#: Another's node, which knows nothing of this package: prints the first node whose diagnostics it gets.
STRANGER = '''
import rclpy
from diagnostic_msgs.msg import DiagnosticArray

rclpy.init()
node = rclpy.create_node('stranger')
names = []
node.create_subscription(DiagnosticArray, '/diagnostics', lambda message: names.append(message.status[0].name), 10)
while not names:
    rclpy.spin_once(node)
print(names[0], flush=True)
'''


def test_no_id_comes_twice_after_a_restart(peer, start, shown):
    answers, publisher = peer.subscribe(PointCloud2, 'detections'), peer.advertise(Image, 'image_raw')
    seen: list[list[int]] = []
    for _ in range(2):
        process = start('pipeline', *small(), code=0 if seen else -signal.SIGKILL)
        assert ready(peer, 'image_raw')
        answers.clear()
        for index in range(FRAMES):
            publisher.publish(image_message(index))
            assert peer.until(lambda index=index: len(answers) > index)
        seen.append([int(ident) for message in answers for ident in read_detections(message)['id']])
        process.send_signal(signal.SIGKILL if not seen[1:] else signal.SIGINT)
        process.wait(TIMEOUT_S)
        assert peer.until(lambda: publisher.get_subscription_count() == 0)
    assert seen[0] and seen[1]
    assert max(seen[0]) < min(seen[1])
    shown('a process is killed and starts again', 'no id comes twice, ids grow', f'{min(seen[1]) - max(seen[0])} apart')


def signs_of_waiting(peer: Peer, ports: set[Path]) -> dict[Path, int]:
    """Port -> place of the byte that says of its reader that it exists (1), waits (2) or reads a message (4), and of
    nothing else; the next byte counts while it waits, so that others see that it lives: where they look, that is.
    """
    set_back_checks()
    seen: dict[Path, list[bytes]] = {port: [] for port in ports}

    def places(port: Path) -> list[int]:
        return [place for place, bytes_ in enumerate(zip(*(one[:-1] for one in seen[port]), strict=True))
                if 3 in bytes_ and {*bytes_} <= {1, 3, 5} and len({one[place + 1] for one in seen[port]}) > 1]

    def one_each() -> bool:
        peer.rest(0.5)
        for port in ports:
            seen[port].append(port.read_bytes())
        return all(len(places(port)) == 1 for port in ports)

    assert peer.until(one_each)
    return {port: places(port)[0] for port in ports}


def kill_between_messages(process: subprocess.Popen[bytes], waits: dict[Path, int]) -> None:
    """A process ends when its readers neither wait nor read: to stop a thread there would take a debugger."""
    process.kill()
    process.wait(TIMEOUT_S)
    for port, place in waits.items():
        with port.open('r+b') as file:
            file.seek(place)
            file.write(b'\x01')


def seems_well(port: BinaryIO, folder: Path) -> bool:
    """Whether those that have it open, as we have, go on using it: a copy of it, which nobody reads, can be given up.

    By its name there may be another one by now.
    """
    port.seek(0)
    copy = folder / Path(port.name).name
    copy.write_bytes(port.read())
    lock = folder / f'{copy.name}_el'
    lock.touch()
    os.utime(lock, (0, 0))
    return give_up_dead_ports(folder) > 0


@pytest.mark.parametrize('found_by', ['its own start', 'a node that runs'])
def test_a_process_killed_between_messages_is_found_when_it_starts_again(found_by, peer, start, tmp_path, shown):
    """Of what Fast DDS 2.14 tells the readers of a port, nothing then says that this one is dead."""
    alive = start('overlay', '-r', '__node:=alive') if found_by == 'a node that runs' else None
    killed = start('optical_flow', *small(), code=-signal.SIGKILL)
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    if alive:
        peer.known_to('/alive')
    ports = ports_of(killed.pid)
    assert ports
    waits = signs_of_waiting(peer, ports)
    peer.rest(MIN_AGE_S)
    with ExitStack() as stack:
        opened = [stack.enter_context(port.open('rb')) for port in ports]
        assert all(seems_well(port, tmp_path) for port in opened)
        kill_between_messages(killed, waits)
        if alive:
            peer.rest(3 * PORTS_PERIOD_S)
            assert not any(seems_well(port, tmp_path) for port in opened)
    if alive:
        again = subprocess.run([sys.executable, '-c', STRANGER], env={**os.environ, 'ROS_DOMAIN_ID': str(own_domain())},
                               stdout=subprocess.PIPE, check=True, timeout=TIMEOUT_S)
        assert again.stdout == b'/alive\n'
    else:
        start('optical_flow', *small())
        assert peer.until(lambda: publisher.get_subscription_count() == 1)
        assert ready(peer, 'image_raw')
    shown('a process is killed between two messages', 'it is found when it starts again, and finds the others',
          f'{found_by} gave its {len(ports)} ports up')


def test_shared_memory_of_a_killed_process_is_removed_by_the_next_that_starts(peer, start, shown):
    alive, killed = start('overlay', '-r', '__node:=alive'), start('optical_flow', *small(), code=-signal.SIGKILL)
    for node in ('alive', 'optical_flow'):
        peer.known_to(f'/{node}')
    kept, left = segments_of(alive.pid), segments_of(killed.pid)
    killed.kill()
    killed.wait(TIMEOUT_S)
    assert left and kept and all(path.exists() for path in left | kept)
    peer.rest(MIN_AGE_S)
    start('camera', '-p', 'source:=/nowhere', code=2).wait(TIMEOUT_S)
    assert not any(path.exists() for path in left)
    assert all(path.exists() for path in kept)
    assert alive.poll() is None
    shown('a process is killed', 'the next start removes its shared memory, and no other', f'{len(left)} segments')


@pytest.fixture
def black_hole() -> Iterator[str]:
    """An address that accepts connections and never says anything."""
    with socket.create_server(('127.0.0.1', 0)) as server:
        yield f'http://127.0.0.1:{server.getsockname()[1]}/live.mjpg'


@pytest.mark.timing
def test_a_camera_that_waits_for_a_black_hole_ends_at_once(black_hole, peer, start, shown):
    longest_s = 0.0
    for delay_s in (0.2, 0.6, 1.0, 1.4):
        process = start('camera', '-p', f'source:={black_hole}')
        assert peer.until(lambda: 'camera' in peer.node.get_node_names())
        peer.rest(delay_s)
        began = time.monotonic()
        process.send_signal(signal.SIGTERM)
        assert process.wait(TIMEOUT_S) == 0
        longest_s = max(longest_s, time.monotonic() - began)
        assert longest_s < END_S
        assert peer.until(lambda: 'camera' not in peer.node.get_node_names(), GONE_S)
    shown('SIGTERM while a camera waits for a black hole', 'ends with code 0 in 2 s', f'at most {longest_s:.1f} s')


@pytest.mark.timing
def test_a_node_on_a_clock_that_went_back_and_stands_ends_at_once(peer, start, shown):
    longest_s = 0.0
    clock = peer.advertise(Clock, '/clock')
    for number in range(ENDS):
        process = start('overlay', '-p', 'use_sim_time:=true')
        assert ready(peer, '/clock')
        for second in (100 + number, 50):
            clock.publish(Clock(clock=header_of(second * 1_000_000_000, '').stamp))
        peer.rest(0.02 * (number % 7))
        began = time.monotonic()
        process.send_signal(signal.SIGTERM)
        assert process.wait(TIMEOUT_S) == 0
        longest_s = max(longest_s, time.monotonic() - began)
        assert longest_s < END_S, number
        assert peer.until(lambda: clock.get_subscription_count() == 0)
    shown('SIGTERM after /clock went back and stands', 'ends with code 0 in 2 s',
          f'{ENDS} ends, at most {longest_s:.1f} s')


@pytest.mark.timing
def test_nodes_end_at_once_in_every_state(tmp_path, capsys, shown):
    """A short run of ``benchmarks.ends``: every state once, and most a second time by the other signal."""
    assert ends.main(['--times', '12', '-o', str(tmp_path)]) == 0, capsys.readouterr().out
    with (tmp_path / 'ends.csv').open(encoding='utf-8') as file:
        ended = list(csv.DictReader(file))
    assert len(ended) == 12

    def longest(column: str) -> float:
        return max(float(one[column]) for one in ended)

    shown('SIGINT and SIGTERM in every state of the nodes, frozen and refused streams and black holes included',
          'end with code 0 in 2 s, of processor time where the machine is busy',
          f'{len(ended)} ends, at most {longest("seconds"):.1f} s, {longest("cpu_s"):.1f} s of processor time')
