"""Runs on one machine get domains of their own."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli import domains
from motion_detect_ros.cli.domains import DOMAINS, lock_of, own_domain
from motion_detect_ros.core.errors import ConfigError

#: A process that thinks that its number is 7 and says its domain, until its input ends.
RUN = '''
import os, sys
os.getpid = lambda: 7
from motion_detect_ros.cli.domains import own_domain
print(own_domain(), own_domain(), flush=True)
sys.stdin.read()
'''


@pytest.fixture
def no_domain(monkeypatch: pytest.MonkeyPatch, tmp_path):
    """Locks in a folder of their own, and no domain chosen by the user."""
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)
    monkeypatch.setenv('TMPDIR', str(tmp_path))
    return tmp_path


def test_processes_whose_numbers_collide_have_different_domains(no_domain):
    processes = [subprocess.Popen([sys.executable, '-c', RUN], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
                 for _ in range(3)]
    said = [process.stdout.readline().split() for process in processes]
    first = {one for one, _ in said}
    assert len(first) == 3
    assert all(one == other and int(one) in DOMAINS for one, other in said)
    for process in processes:
        process.communicate()
    process = subprocess.run([sys.executable, '-c', RUN], input='', capture_output=True, text=True, check=True)
    assert process.stdout.split()[0] in first, 'free again'


def test_a_domain_is_reserved_until_the_last_node_in_it_has_ended(no_domain):
    """A run that is killed leaves its nodes behind."""
    killed = """
import os, subprocess, sys
os.getpid = lambda: 7
from motion_detect_ros.cli.domains import lock_of, own_domain
domain = own_domain()
left = subprocess.Popen([sys.executable, '-c', 'input()'], pass_fds=lock_of(domain), stdout=subprocess.DEVNULL)
print(domain, flush=True)
os._exit(9)
"""
    run = subprocess.Popen([sys.executable, '-c', killed], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    domain = run.stdout.readline().strip()
    assert run.wait() == 9

    def next_one() -> str:
        said = subprocess.run([sys.executable, '-c', RUN], input='', capture_output=True, text=True, check=True)
        return said.stdout.split()[0]

    assert next_one() != domain
    run.stdin.write('\n')  # ends what is left
    run.stdin.close()
    deadline = time.monotonic() + 60.0
    while next_one() != domain:
        assert time.monotonic() < deadline
    run.stdout.close()


def test_the_user_s_choice_counts(no_domain, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '150')
    assert own_domain() == 150
    assert lock_of(150) == ()
    assert not [*no_domain.iterdir()]


@pytest.mark.parametrize('word', ['abc', '-1', '233', '1.5'])
def test_a_choice_that_is_none_is_one_line(word: str, no_domain, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', word)
    with pytest.raises(ConfigError, match=rf'^ROS_DOMAIN_ID: expected a whole number from 0 to 232, got {word}$'):
        own_domain()


@pytest.mark.parametrize('words', [['replay', 'a.mcap', '--live'], ['demo']])
def test_so_it_is_before_anything_is_done(
    words: list[str], no_domain, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
):
    pytest.importorskip('rclpy', reason='ROS 2 is not installed')
    monkeypatch.setenv('ROS_DOMAIN_ID', 'abc')
    assert main([*words, '-o', str(no_domain / 'out')]) == 2
    assert capsys.readouterr().err == 'error: ROS_DOMAIN_ID: expected a whole number from 0 to 232, got abc\n'
    assert not (no_domain / 'out').exists()


def test_where_nothing_can_be_locked_the_process_decides(no_domain, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(domains.tempfile, 'gettempdir', lambda: str(no_domain / 'none'))
    assert domains._reserved.__wrapped__(207) == DOMAINS[7]
