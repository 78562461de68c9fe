"""Lifecycle services under whatever a manager requests, against the state machine of the ROS 2 design article."""

from __future__ import annotations

import contextlib
import random
import threading
from collections.abc import Iterator
from typing import Any

import cv2
import pytest
import rclpy
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from peers import TIMEOUT_S, Peer, picture, small
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.nodes.camera import CameraNode
from motion_detect_ros.nodes.pipeline import PipelineNode

pytestmark = pytest.mark.messages

UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE, FINALIZED = State.PRIMARY_STATE_ACTIVE, State.PRIMARY_STATE_FINALIZED
#: https://design.ros2.org/articles/node_lifecycle.html: state -> transition -> state, as far as a node stays.
MACHINE = {
    UNCONFIGURED: {Transition.TRANSITION_CONFIGURE: INACTIVE},
    INACTIVE: {Transition.TRANSITION_CLEANUP: UNCONFIGURED, Transition.TRANSITION_ACTIVATE: ACTIVE},
    ACTIVE: {Transition.TRANSITION_DEACTIVATE: INACTIVE},
}
SHUTDOWNS = {UNCONFIGURED: Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
             INACTIVE: Transition.TRANSITION_INACTIVE_SHUTDOWN, ACTIVE: Transition.TRANSITION_ACTIVE_SHUTDOWN}
LABELS = {Transition.TRANSITION_CONFIGURE: 'configure', Transition.TRANSITION_CLEANUP: 'cleanup',
          Transition.TRANSITION_ACTIVATE: 'activate', Transition.TRANSITION_DEACTIVATE: 'deactivate'}
WAY_TO = {UNCONFIGURED: (), INACTIVE: (Transition.TRANSITION_CONFIGURE,),
          ACTIVE: (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)}
#: Every transition of lifecycle_msgs, and one that is none.
EVERY = sorted({getattr(Transition, name) for name in dir(Transition) if name.startswith('TRANSITION_')} | {200})
#: The way through all states that a node can come back to.
ROUND = ((UNCONFIGURED, Transition.TRANSITION_CONFIGURE), (INACTIVE, Transition.TRANSITION_ACTIVATE),
         (ACTIVE, Transition.TRANSITION_DEACTIVATE), (INACTIVE, Transition.TRANSITION_CLEANUP))
SEQUENCES, STEPS = 500, 10
SEED = 20240523


class Managed:
    """The lifecycle services of a node, as a lifecycle manager calls them."""

    def __init__(self, peer: Peer, name: str) -> None:
        self._peer = peer
        self._change = peer.node.create_client(ChangeState, f'/{name}/change_state')
        self._state = peer.node.create_client(GetState, f'/{name}/get_state')
        assert peer.until(lambda: self._change.service_is_ready() and self._state.service_is_ready())
        peer.known_to(f'/{name}')

    def change(self, number: int = 0, label: str = '') -> bool:
        return self._answer(self._change, ChangeState.Request(transition=Transition(id=number, label=label))).success

    @property
    def state(self) -> int:
        return self._answer(self._state, GetState.Request()).current_state.id

    def _answer(self, client: Any, request: Any) -> Any:
        answer = client.call_async(request)
        assert self._peer.until(answer.done), 'no answer'
        return answer.result()


@pytest.mark.parametrize('node', ['overlay', 'optical_flow'])
def test_every_transition_in_every_state(node: str, peer: Peer, start):
    process = start(node, *small('autostart:=false'))
    managed = Managed(peer, node)
    for state, onwards in ROUND:
        allowed = {*MACHINE[state], SHUTDOWNS[state]}
        assert managed.state == state
        refused = {number: managed.change(number) for number in EVERY if number not in allowed}
        assert (refused, managed.state) == (dict.fromkeys(refused, False), state)
        assert not any(managed.change(label=LABELS[number]) for number in set(LABELS) - allowed)
        assert managed.change(label=LABELS[onwards])
    assert (managed.state, process.poll()) == (UNCONFIGURED, None)


def test_random_sequences(peer: Peer, start, shown):
    """What a node answers, and where it is then, over and over; shutdown ends a node and has tests of its own."""
    chance = random.Random(SEED)
    process = start('overlay')
    managed = Managed(peer, 'overlay')
    assert peer.until(lambda: managed.state == ACTIVE)
    state, taken = ACTIVE, 0
    for _ in range(SEQUENCES):
        steps = [chance.choice([*EVERY, *6 * list(LABELS)]) for _ in range(STEPS)]
        for number in steps:
            if number == SHUTDOWNS[state]:
                continue
            expected = MACHINE[state].get(number)
            by_label = number in LABELS and chance.random() < 0.5
            succeeded = managed.change(label=LABELS[number]) if by_label else managed.change(number)
            assert succeeded == (expected is not None), (state, number, steps)
            state, taken = expected or state, taken + succeeded
        assert managed.state == state, steps
    assert taken > SEQUENCES
    assert process.poll() is None
    shown('transitions that the present state does not have', 'refused with `success: false`, the node as before',
          f'{SEQUENCES} random sequences of {STEPS}, {taken} taken, all others refused')


@pytest.mark.parametrize('label', [True, False], ids=['label', 'number'])
@pytest.mark.parametrize('state', SHUTDOWNS)
def test_shutdown_ends_the_process(state: int, label: bool, peer: Peer, start):
    process = start('overlay', '-p', 'autostart:=false')
    managed = Managed(peer, 'overlay')
    for number in WAY_TO[state]:
        assert managed.change(number)
    assert managed.change(label='shutdown') if label else managed.change(SHUTDOWNS[state])
    assert peer.until(lambda: process.poll() is not None)
    assert process.returncode == 0


def test_shutdown_ends_an_active_stage_and_source(peer: Peer, start, tmp_path):
    cv2.imwrite(str(tmp_path / '0.png'), picture(0))
    waiting = ('-p', f'source:={tmp_path}', '-p', 'wait_for_subscribers:=9')
    processes = [start('ego_motion', *small()), start('camera', *waiting)]
    for name in ('ego_motion', 'camera'):
        managed = Managed(peer, name)
        assert peer.until(lambda managed=managed: managed.state == ACTIVE)
        assert managed.change(SHUTDOWNS[ACTIVE])
    assert [process.wait(TIMEOUT_S) for process in processes] == [0, 0]


@pytest.fixture
def node_here(monkeypatch: pytest.MonkeyPatch) -> Iterator[ManagedNode]:
    """A node in this process, which nothing ends."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init(domain_id=own_domain(), signal_handler_options=SignalHandlerOptions.NO)
    node, executor = ManagedNode('here'), SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=spin_until_shutdown, args=(executor,))
    thread.start()
    yield node
    rclpy.shutdown()
    thread.join()
    node.destroy_node()


def spin_until_shutdown(executor: SingleThreadedExecutor) -> None:
    with contextlib.suppress(ExternalShutdownException):
        executor.spin()


def test_reset_clears_the_history_of_a_configured_node_only(node_here: ManagedNode, peer: Peer):
    managed = Managed(peer, 'here')
    answers = [peer.call(Trigger, '/here/reset')]
    for number in (*WAY_TO[ACTIVE], SHUTDOWNS[ACTIVE]):
        assert managed.change(number)
        answers.append(peer.call(Trigger, '/here/reset'))
    assert managed.state == FINALIZED
    refused = (False, 'expected a configured node, nothing to clear')
    cleared = (True, 'history cleared')
    assert [(each.success, each.message) for each in answers] == [refused, cleared, cleared, refused]
    assert not any(managed.change(number) for number in EVERY)
    assert managed.state == FINALIZED


def test_configure_of_a_node_that_started_by_itself_is_refused_with_a_reason(peer: Peer, start, tmp_path):
    process = start('overlay')
    managed = Managed(peer, 'overlay')
    assert peer.until(lambda: managed.state == ACTIVE)
    assert not managed.change(Transition.TRANSITION_CONFIGURE)
    assert (managed.state, process.poll()) == (ACTIVE, None)
    printed = (tmp_path / 'overlay.log').read_text()
    assert 'change_state refused: expected deactivate (4), shutdown (7) in state active, got 1' in printed


def test_nothing_is_left_of_a_configuration_that_failed(here):
    node = here(PipelineNode, 'autostart:=false', 'qos_overrides./detections.publisher.depth:=0')
    for _ in range(2):
        assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
        assert [node.count_publishers(name) for name in ('ego_motion', 'flow', 'detections')] == [0, 0, 0]


def test_what_could_not_be_activated_publishes_nothing(here, tmp_path):
    node = here(CameraNode, 'autostart:=false', f'source:={tmp_path / "none.mp4"}')
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.trigger_activate() == TransitionCallbackReturn.FAILURE
    assert node._publishers_made and not any(publisher.is_activated for publisher in node._publishers_made)
