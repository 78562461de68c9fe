"""Lifecycle services under whatever a manager requests, against the state machine of the ROS 2 design article."""

from __future__ import annotations

import random
from typing import Any

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from peers import Peer, small

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
#: Every transition of lifecycle_msgs, and one that is none.
EVERY = sorted({getattr(Transition, name) for name in dir(Transition) if name.startswith('TRANSITION_')} | {200})
#: The way through all states that a node can come back to.
ROUND = ((UNCONFIGURED, Transition.TRANSITION_CONFIGURE), (INACTIVE, Transition.TRANSITION_ACTIVATE),
         (ACTIVE, Transition.TRANSITION_DEACTIVATE), (INACTIVE, Transition.TRANSITION_CLEANUP))
SEQUENCES, STEPS = 100, 10
SEED = 20240523


class Managed:
    """The lifecycle services of a node, as a lifecycle manager calls them."""

    def __init__(self, peer: Peer, name: str) -> None:
        self._peer = peer
        self._change = peer.node.create_client(ChangeState, f'/{name}/change_state')
        self._state = peer.node.create_client(GetState, f'/{name}/get_state')
        assert peer.until(lambda: self._change.service_is_ready() and self._state.service_is_ready())

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


def test_random_sequences(peer: Peer, start):
    """What a node answers, and where it is then, over and over; shutdown ends a node and is tried apart."""
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


def test_configure_of_a_node_that_started_by_itself_is_refused_with_a_reason(peer: Peer, start, tmp_path):
    process = start('overlay')
    managed = Managed(peer, 'overlay')
    assert peer.until(lambda: managed.state == ACTIVE)
    assert not managed.change(Transition.TRANSITION_CONFIGURE)
    assert (managed.state, process.poll()) == (ACTIVE, None)
    printed = (tmp_path / 'overlay.log').read_text()
    assert 'change_state refused: expected deactivate (4), shutdown (7) in state active, got 1' in printed
