"""What running nodes offer to a ROS graph, read as any other node would: topics with QoS, services, parameters."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from motion_detect_ros.bridge.topics import DIAGNOSTICS
from motion_detect_ros.core.errors import SourceError

#: Nodes that share a busy core need a minute to start; an interface counts as complete after this without a change.
START_TIMEOUT_S = 300.0
UNCHANGED_S = 3.0
#: After this a question is asked again: a node that has not found us yet drops it.
ASK_AGAIN_S = 5.0
POLL_S = 0.05
#: Parameters by which a user sets the QoS of an endpoint; they also tell its depth, which discovery does not.
QOS_PARAMETER = re.compile(r'qos_overrides\.(?P<topic>.+)\.(?P<end>publisher|subscription)\.(?P<policy>\w+)')


@dataclass(frozen=True)
class Endpoint:
    """A publisher or subscription. ``topic``: as the node names it, relative, private or absolute.

    ``reliability``: reliable or best_effort; ``depth``: messages kept, None where the user cannot set the QoS.
    """

    topic: str
    kind: str
    publishes: bool
    reliability: str
    depth: int | None


@dataclass(frozen=True)
class DeclaredParameter:
    """``value``: at present; ``limits``: in a few words; ``read_only``: not to be changed while the node runs."""

    name: str
    type_name: str
    value: Any
    limits: str
    read_only: bool
    doc: str


@dataclass(frozen=True)
class NodeInterface:
    """Everything one node offers; services: name -> type."""

    endpoints: tuple[Endpoint, ...]
    services: dict[str, str]
    parameters: dict[str, DeclaredParameter]


class Inspector:
    """A node that looks at others of a namespace; use as a context manager."""

    def __init__(self, domain_id: int, namespace: str) -> None:
        self._namespace = f'/{namespace}'
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self._node = rclpy.create_node('inspector', context=self._context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._active: set[str] = set()
        self._node.create_subscription(DIAGNOSTICS.kind, DIAGNOSTICS.name, self._on_report, DIAGNOSTICS.qos())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(timeout_sec=2.0)
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def subscribe(self, kind: Any, topic: str) -> None:
        """Receive a topic and forget it, for nodes that work on demand only."""
        self._node.create_subscription(kind, topic, lambda _: None, 1)

    def await_active(self, nodes: Sequence[str], check: Callable[[], None]) -> None:
        """Returns once all ``nodes`` are active and their topics and services no longer change.

        check: called all the time, may raise. Raises: SourceError where that takes too long.
        """
        seen: Any = None
        changed_s = time.monotonic()

        def settled() -> bool:
            nonlocal seen, changed_s
            check()
            graph = self._node.get_topic_names_and_types(), self._node.get_service_names_and_types()
            if graph != seen or not self._active >= set(nodes):
                seen, changed_s = graph, time.monotonic()
            return time.monotonic() - changed_s > UNCHANGED_S

        if not self._until(settled, START_TIMEOUT_S):
            raise SourceError(f'nodes: expected them active within {START_TIMEOUT_S:.0f} s, got '
                              f'{", ".join(sorted(self._active)) or "none"}')

    def read(self, node: str) -> NodeInterface:
        """The interface of an active node. Raises: SourceError where it does not answer."""
        parameters = self.parameters(node)
        graph = self._node
        ends = [(topic, kinds, publishes) for found, publishes in (
            (graph.get_publisher_names_and_types_by_node(node, self._namespace), True),
            (graph.get_subscriber_names_and_types_by_node(node, self._namespace), False)) for topic, kinds in found]
        services = {self._short(name, node): _short_type(kinds[0])
                    for name, kinds in graph.get_service_names_and_types_by_node(node, self._namespace)}
        return NodeInterface(tuple(Endpoint(
            self._short(topic, node), _short_type(kinds[0]), publishes, self._reliability(node, topic, publishes),
            self._depth(parameters, topic, publishes)) for topic, kinds, publishes in ends), services, parameters)

    def parameters(self, node: str) -> dict[str, DeclaredParameter]:
        """Every parameter that a node declares. Raises: SourceError where it does not answer."""
        client = AsyncParameterClient(self._node, f'{self._namespace}/{node}')
        names = sorted(self._answer(node, client.list_parameters).result.names)
        descriptors = self._answer(node, lambda: client.describe_parameters(names)).descriptors
        values = self._answer(node, lambda: client.get_parameters(names)).values
        return {one.name: DeclaredParameter(
            one.name, Parameter.Type(one.type).name.lower(), parameter_value_to_python(value), _limits(one),
            one.read_only, one.description) for one, value in zip(descriptors, values, strict=True)}

    def _on_report(self, message: Any) -> None:
        self._active |= {status.name.rpartition('/')[2] for status in message.status if status.message != 'inactive'}

    def _answer(self, node: str, ask: Callable[[], Any]) -> Any:
        asked = []

        def answered() -> bool:
            asked.append(ask())
            return self._until(lambda: any(one.done() for one in asked), ASK_AGAIN_S)

        if not self._until(answered, START_TIMEOUT_S):
            raise SourceError(f'{node}: does not answer')
        return next(one.result() for one in asked if one.done())

    def _until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=POLL_S)
        return True

    def _short(self, name: str, node: str) -> str:
        """As the node's code has it: without our namespace, ``~`` for its own name."""
        relative = name.removeprefix(f'{self._namespace}/')
        return f'~/{relative.removeprefix(f"{node}/")}' if relative.startswith(f'{node}/') else relative

    def _reliability(self, node: str, topic: str, publishes: bool) -> str:
        found = (self._node.get_publishers_info_by_topic if publishes
                 else self._node.get_subscriptions_info_by_topic)(topic)
        return next(str(one.qos_profile.reliability.name).lower() for one in found if one.node_name == node)

    @staticmethod
    def _depth(parameters: dict[str, DeclaredParameter], topic: str, publishes: bool) -> int | None:
        end = 'publisher' if publishes else 'subscription'
        one = parameters.get(f'qos_overrides.{topic}.{end}.depth')
        return None if one is None else int(one.value)


def _short_type(kind: str) -> str:
    return kind.replace('/msg/', '/').replace('/srv/', '/')


def _limits(descriptor: Any) -> str:
    for limit in (*descriptor.floating_point_range, *descriptor.integer_range):
        return f'{limit.from_value:g} to {limit.to_value:g}'
    return str(descriptor.additional_constraints)
