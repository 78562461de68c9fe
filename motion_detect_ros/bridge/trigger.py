"""Services without arguments (``std_srvs/Trigger``) of other nodes, asked without waiting for the answer."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger


class TriggerClient:
    """Asks one service."""

    def __init__(self, node: Node, service: str) -> None:
        """service: full name, as /bag_player/pause."""
        self._client: Any = node.create_client(Trigger, service)

    def ask(self) -> Future | None:
        """Done once the service has answered; None where nobody offers it yet."""
        return self._client.call_async(Trigger.Request()) if self._client.service_is_ready() else None
