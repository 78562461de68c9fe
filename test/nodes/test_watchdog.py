"""The example that stops the vehicle, beside a pipeline that sees, goes blind, falls silent and is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped
from peers import TIMEOUT_S, picture, ready, small
from sensor_msgs.msg import Image

from motion_detect_ros.bridge.images import header_of, image_to_msg
from motion_detect_ros.bridge.transport import environment
from motion_detect_ros.bridge.watchdog import Watchdog
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.core.errors import ConfigError

pytestmark = pytest.mark.messages

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'watchdog.py'
PERIOD_NS = 100_000_000


@pytest.fixture
def guard(peer, request):
    """The example as a process of its own."""
    further = getattr(request, 'param', [])
    variables = {**environment(), 'ROS_DOMAIN_ID': str(own_domain()), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    command = [sys.executable, str(EXAMPLE), '--ros-args', '-p', 'detections_s:=5.0', *further]
    process = subprocess.Popen(command, env={**os.environ, **variables})
    yield process
    process.send_signal(signal.SIGINT)
    assert process.wait(TIMEOUT_S) == 0


def test_the_vehicle_drives_only_while_the_detector_sees(peer, start, guard, shown):
    pipeline = start('pipeline', *small(), code=-signal.SIGKILL)
    images, wishes = peer.advertise(Image, 'image_raw'), peer.advertise(Twist, 'cmd_vel_in')
    commands, sent = peer.subscribe(Twist, 'cmd_vel'), 0
    assert ready(peer, 'image_raw')
    assert ready(peer, 'cmd_vel_in')
    forward = Twist()
    forward.linear.x = 1.0

    def feeds(sees: bool | None, drives: bool) -> bool:
        """Images, grey ones, or none for a while, and whether the latest command that went out drives or stops."""
        def step() -> bool:
            nonlocal sent
            sent += 1
            if sees is not None:
                image = picture(sent % 40) if sees else np.full((240, 320), 90, np.uint8)
                images.publish(image_to_msg(image, header_of(sent * PERIOD_NS, '')))
            commands.clear()
            wishes.publish(forward)
            peer.rest(0.1)
            return bool(commands) and {command.linear.x for command in commands} == ({1.0} if drives else {0.0})
        return peer.until(step)

    assert feeds(None, drives=False)
    assert feeds(True, drives=True)
    assert feeds(False, drives=False)
    assert feeds(True, drives=True)
    assert feeds(None, drives=False)
    assert feeds(True, drives=True)
    pipeline.kill()
    assert feeds(True, drives=False)
    shown('the detector is blind, silent or killed', 'the example watchdog stops the vehicle, and lets it drive after',
          'no images yet, grey images, silence, kill -9: stopped')


@pytest.mark.parametrize('guard', [['-p', 'stamped:=true']], indirect=True)
def test_commands_may_be_stamped(peer, start, guard):
    """As those of the example that follows one object."""
    start('pipeline', *small())
    images, wishes = peer.advertise(Image, 'image_raw'), peer.advertise(TwistStamped, 'cmd_vel_in')
    commands, sent = peer.subscribe(TwistStamped, 'cmd_vel'), 0
    assert ready(peer, 'image_raw')
    assert ready(peer, 'cmd_vel_in')
    assert peer.until(lambda: commands)
    assert (commands[0].twist.linear.x, commands[0].header.stamp.sec > 0) == (0.0, True)
    forward = TwistStamped()
    forward.twist.linear.x = 1.0

    def driven() -> bool:
        nonlocal sent
        sent += 1
        images.publish(image_to_msg(picture(sent % 40), header_of(sent * PERIOD_NS, '')))
        wishes.publish(forward)
        peer.rest(0.1)
        return commands[-1].twist.linear.x == 1.0

    assert peer.until(driven)


@pytest.mark.parametrize('stages', ['/pipeline', ['pipeline'], ['/pipeline', '']])
def test_what_names_no_nodes_is_refused_instead_of_never_reporting(peer, stages):
    with pytest.raises(ConfigError, match='stages: expected full names of nodes') as refused:
        Watchdog(peer.node, stages)
    assert repr(stages) in str(refused.value)
    assert not peer.node.get_subscriptions_info_by_topic('/diagnostics')
