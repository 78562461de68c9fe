"""What a user writes behind the name of a node: ROS arguments are taken, everything else is refused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.context import Context

from motion_detect_ros.bridge.arguments import check_arguments, text_parameter
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.core.errors import ConfigError

REPOSITORY = Path(__file__).resolve().parents[2]
CONFIG = REPOSITORY / 'config'
TIMEOUT_S = 60.0
#: A program of ``run_plain``; -c is its name.
PLAIN = """
from rclpy.node import Node
from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.runner import run_plain

class Plain(Node):
    def __init__(self):
        super().__init__('plain')
        self.range_m = declare_simple(self, 'range_m', 5.0, 'assumed distance', 0.1, 100.0)
        print('made', self.range_m, flush=True)
        self.create_timer(0.1, self.context.shutdown)

run_plain(Plain)
"""
#: Module, words, the one line on stderr.
REFUSED = {
    'a parameter file': ('pipeline', ('--params-file', 'config/visdrone.yaml', '-p', 'art2.vigilance:=7'),
                         'pipeline: expected --ros-args before all arguments, got --params-file config/visdrone.yaml '
                         '-p art2.vigilance:=7; --help shows how'),
    'an option of replay': ('pipeline', ('--preset', 'visdrone'),
                            'pipeline: expected --ros-args before all arguments, got --preset visdrone; '
                            '--help shows how'),
    'a source': ('camera', ('-p', 'source:=nothere.mp4'),
                 'camera: expected --ros-args before all arguments, got -p source:=nothere.mp4; --help shows how'),
    'a password': ('camera', ('-p', 'source:=rtsp://me:secret@cam/1'),
                   'camera: expected --ros-args before all arguments, got -p source:=rtsp://***@cam/1; '
                   '--help shows how'),
    'behind the end': ('overlay', ('--ros-args', '-p', 'box_distance_m:=2', '--', 'rectified'),
                       'overlay: expected --ros-args before all arguments, got rectified; --help shows how'),
    'unknown to ROS': ('overlay', ('--ros-args', '--wrong'),
                       "overlay: expected ROS arguments after --ros-args, got '--wrong'"),
    'no value': ('overlay', ('--ros-args', '-p', 'rectified:='),
                 "Failed to parse ROS arguments: Couldn't parse parameter override rule: '-p rectified:='"),
    'a preset': ('pipeline', ('--ros-args', '--params-file', 'visdrone'),
                 '--params-file: expected a file, got visdrone, which is none; names of presets work in launch files '
                 f'and offline commands only, the files of the presets are in {CONFIG}'),
    'a folder': ('overlay', ('--ros-args', '--params-file', 'config'),
                 '--params-file: expected a file, got config, which is none; names of presets work in launch files '
                 f'and offline commands only, the files of the presets are in {CONFIG}'),
    'no YAML': ('overlay', ('--ros-args', '--params-file', 'README.md'),
                "Failed to parse ROS arguments: Couldn't parse params file: '--params-file README.md'. Error: Cannot "
                'have a value before ros__parameters at line 3'),
}


def run(*words: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr (less what Fast DDS says of ports in use) of a process in a domain of its own."""
    done = subprocess.run(
        [sys.executable, *words], text=True, capture_output=True, timeout=TIMEOUT_S, check=False, cwd=REPOSITORY,
        env={**os.environ, 'ROS_DOMAIN_ID': str(own_domain()), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})
    errors = ''.join(line for line in done.stderr.splitlines(keepends=True) if 'RTPS_TRANSPORT' not in line)
    return done.returncode, done.stdout, errors


@pytest.mark.timeout(120)
@pytest.mark.parametrize(('node', 'words', 'line'), REFUSED.values(), ids=REFUSED)
def test_a_node_refuses_in_one_line(node: str, words: tuple[str, ...], line: str):
    assert run('-m', f'motion_detect_ros.nodes.{node}', *words) == (2, '', f'{line}\n')


@pytest.mark.timeout(120)
@pytest.mark.parametrize('words', [('--help',), ('-h',), ('--ros-args', '--help')])
def test_help_is_a_usage(words: tuple[str, ...]):
    code, printed, errors = run('-m', 'motion_detect_ros.nodes.pipeline', *words)
    assert (code, errors) == (0, '')
    assert printed.startswith('usage: pipeline [--ros-args [-p NAME:=VALUE] [-r FROM:=TO] [--params-file FILE] ...]\n')
    assert 'docs/nodes.md' in printed


@pytest.mark.timeout(120)
@pytest.mark.parametrize(('words', 'line'), [
    (('-p', 'range_m:=4.0'), '-c: expected --ros-args before all arguments, got -p range_m:=4.0; --help shows how'),
    (('--ros-args', '-p', 'nonsense'), "Failed to parse ROS arguments: Couldn't parse parameter override rule: "
     "'-p nonsense'. Error: Expected lexeme type (22) not found, search ended at index 8"),
    (('--ros-args', '-p', 'range_m:=-4.0'), 'parameter range_m: expected float from 0.1 to 100.0: Invalid parameter '
     'value (-4.0) for parameter. Reason: Parameter range_m out of range Min: 0.1, Max: 100.0, value: -4.0: range_m'),
    (('--ros-args', '-p', 'use_sim_time:=5'), None),
])
def test_a_plain_program_refuses_in_one_line(words: tuple[str, ...], line: str | None):
    """None: rclpy's own words for a parameter of its own."""
    code, printed, errors = run('-c', PLAIN, *words)
    assert (code, printed, errors.count('\n')) == (2, '', 1)
    assert errors == f'{line}\n' or (line is None and 'use_sim_time' in errors)


@pytest.mark.timeout(120)
def test_a_plain_program_takes_whole_numbers_and_warns_of_misspelt_names():
    code, printed, errors = run('-c', PLAIN, '--ros-args', '-p', 'range_m:=4', '-p', 'rang_m:=3')
    assert (code, printed) == (0, 'made 4.0\n')
    assert 'parameter rang_m is unknown and has no effect; did you mean range_m?' in errors


@pytest.mark.timeout(120)
def test_a_plain_program_has_a_usage():
    code, printed, errors = run('-c', PLAIN, '--help')
    assert (code, errors) == (0, '')
    assert printed.startswith('usage: -c [--ros-args ')


@pytest.mark.parametrize('words', [
    (),
    ('--ros-args',),
    ('--ros-args', '-r', '__node:=front', '-r', '__ns:=/drone', '-p', 'autostart:=false', '--log-level', 'warn'),
    ('--ros-args', '--log-level', 'info', '--ros-args', '-r', '__ns:=/drone', '--params-file',
     str(CONFIG / 'kitti.yaml')),
    ('--ros-args', '-p', 'bag:=a b.mcap', '--'),
    ('__node:=front', '__ns:=/drone'),
])
def test_what_ros_takes_is_taken(words: tuple[str, ...]):
    """As launch files and ``ros2 run`` pass it; the last is an old form, of which rcl warns."""
    check_arguments(['overlay', *words])


def test_a_pipe_is_left_to_the_node():
    """``--params-file <(...)`` of a shell can be read once."""
    reader, writer = os.pipe()
    os.write(writer, b'/**: {ros__parameters: {autostart: false}}')
    os.close(writer)
    check_arguments(['overlay', '--ros-args', '--params-file', f'/dev/fd/{reader}', '-p', 'rectified:=true'])
    with os.fdopen(reader, 'rb') as pipe:
        assert pipe.read().startswith(b'/**')


def test_a_file_behind_another_flag_is_looked_at_too(tmp_path: Path):
    missing = tmp_path / 'mine.yaml'
    with pytest.raises(ConfigError, match=rf'expected a file, got {missing}, which is none'):
        check_arguments(['overlay', '--ros-args', '-p', 'a:=1', '--params-file', str(missing)])


@pytest.mark.parametrize('text', [
    'flight.mcap', 'flight #2.mcap', 'a: b.mcap', '123', '1e3', '0x1F', 'true', 'null', '~', '~/a.mcap', '', ' a ',
    '-', '[a]', '{a: b}', '&a', '*a', '!a', '%a', '@a', '`a`', "it's", 'say "a"', r'C:\new\x41', 'a\tb\nc',
    'a\x7f\x85\u2028b', 'Überflug é', '飛行 🚁.mcap', '[1, 2', '2024-05-01', 'a:=b', 'bag:=a', '|', '> a', '---', 'a,b',
    '\ufeffa',
])
def test_a_text_comes_through_as_it_is(text: str):
    """By rcl, which reads the value as YAML."""
    context = Context()
    rclpy.init(context=context, domain_id=own_domain())
    node = rclpy.create_node('reader', context=context, use_global_arguments=False,
                             cli_args=['--ros-args', '-p', text_parameter('bag', text)])
    try:
        assert node.declare_parameter('bag', 'default').value == text
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
