"""Which ports of Fast DDS are given up, on copies of a real one."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from transport_files import ports_of

from motion_detect_ros.bridge.shared_memory import MIN_AGE_S, give_up_dead_ports
from motion_detect_ros.cli.domains import own_domain


@pytest.fixture(scope='module')
def real_port() -> Iterator[Path]:
    """One that a node of this process reads."""
    before, context = ports_of(os.getpid()), Context()
    rclpy.init(context=context, domain_id=own_domain())
    node = rclpy.create_node('reader', context=context)
    yield min(ports_of(os.getpid()) - before)
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def left(real_port, tmp_path) -> Path:
    """A copy of it as a process leaves it that was killed long ago."""
    port = tmp_path / real_port.name
    port.write_bytes(real_port.read_bytes())
    lock = tmp_path / f'{real_port.name}_el'
    lock.touch()
    old = lock.stat().st_mtime - 2 * MIN_AGE_S
    os.utime(lock, (old, old))
    return port


def test_a_dead_port_is_given_up_once_and_nothing_else_of_it_changes(left):
    before = left.read_bytes()
    assert give_up_dead_ports(left.parent) == 1
    after = left.read_bytes()
    changed = [place for place, (old, new) in enumerate(zip(before, after, strict=True)) if old != new]
    assert len(changed) == 1
    assert before[changed[0]] & 1 and after[changed[0]] == before[changed[0]] - 1
    assert give_up_dead_ports(left.parent) == 0
    assert left.read_bytes() == after


def test_a_port_that_is_read_or_about_to_be_is_left(left):
    before, lock = left.read_bytes(), left.with_name(f'{left.name}_el')
    with lock.open('rb') as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        assert give_up_dead_ports(left.parent) == 0
    os.utime(lock)
    assert give_up_dead_ports(left.parent) == 0
    lock.unlink()
    assert give_up_dead_ports(left.parent) == 0
    assert left.read_bytes() == before


@pytest.mark.parametrize('change', [
    lambda data: data[:1000], lambda data: b'', lambda data: bytes(len(data)), lambda data: b'\xff' * len(data),
    lambda data: data[:1] + data[:-1], lambda data: data[:1024] + data[:1024] + data[2048:]],
    ids=['short', 'empty', 'zeros', 'ones', 'shifted', 'two heads'])
def test_what_does_not_look_like_a_port_is_left(left, change):
    changed = change(left.read_bytes())
    left.write_bytes(changed)
    assert give_up_dead_ports(left.parent) == 0
    assert left.read_bytes() == changed


def test_a_port_with_flags_that_we_do_not_know_is_left(left):
    before = left.read_bytes()
    assert give_up_dead_ports(left.parent) == 1
    place = next(place for place, byte in enumerate(left.read_bytes()) if byte != before[place])
    changed = before[:place] + bytes([before[place] | 8]) + before[place + 1:]
    left.write_bytes(changed)
    assert give_up_dead_ports(left.parent) == 0
    assert left.read_bytes() == changed


def test_a_port_of_another_number_is_left(left):
    other = left.rename(left.with_name('fastrtps_port1'))
    left.with_name(f'{left.name}_el').rename(other.with_name('fastrtps_port1_el'))
    before = other.read_bytes()
    assert give_up_dead_ports(other.parent) == 0
    assert other.read_bytes() == before


def test_the_ports_of_this_process_are_left(real_port):
    before = real_port.read_bytes()[:512]
    os.utime(real_port.with_name(f'{real_port.name}_el'), (0, 0))
    give_up_dead_ports()
    flags = [place for place, (old, new) in enumerate(zip(before, real_port.read_bytes()[:512], strict=True))
             if old & 1 and new == old - 1 and old <= 7]
    assert not flags


def test_no_folder_no_ports(tmp_path):
    assert give_up_dead_ports(tmp_path / 'none') == 0
