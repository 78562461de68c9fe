"""What rclpy 7.1 leaves undone of the states of a lifecycle node: attributes of its LifecycleNodeMixin."""

from __future__ import annotations

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode


def destroy_states(node: LifecycleNode) -> None:
    """After ``destroy_node``: it leaves the services of the states, and they keep the node on the network until Python
    has collected them, or, where the process ends without that, until its lease is over after 20 s.
    """
    node._state_machine.destroy_when_not_in_use()


def refuse_impossible_transitions(node: LifecycleNode) -> None:
    """Make ``change_state`` answer ``success: false`` to a transition that the present state does not have.

    rclpy raises RCLError out of the service's callback there, which ends the process.
    """
    service = node._service_change_state
    change = service.callback

    def checked(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
        wanted = request.transition
        possible = {number: label for number, label, *_ in node._state_machine.available_transitions}
        if wanted.label in possible.values() if wanted.label else wanted.id in possible:
            return change(request, response)
        expected = ', '.join(f'{label} ({number})' for number, label in possible.items()) or 'none'
        node.get_logger().warning(f'change_state refused: expected {expected} in state '
                                  f'{node._state_machine.current_state[1]}, got {wanted.label or wanted.id}')
        response.success = False
        return response

    service.callback = checked
