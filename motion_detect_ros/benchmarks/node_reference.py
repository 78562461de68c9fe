"""The tables of docs/nodes.md: ``python -m motion_detect_ros.benchmarks.node_reference --write docs/nodes.md``."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from motion_detect_ros.benchmarks.bench_nodes import NodeProcesses
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.benchmarks.node_interface import (
    QOS_PARAMETER,
    DeclaredParameter,
    Endpoint,
    Inspector,
    NodeInterface,
)
from motion_detect_ros.benchmarks.security_policy import policy
from motion_detect_ros.bridge.arguments import text_parameter
from motion_detect_ros.bridge.topics import FLOW_COLORS, MARKERS, OVERLAY
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.sources.bags import BagWriter

STAGES = ('ego_motion', 'optical_flow', 'art2_clustering', 'pipeline')
NODES = ('camera', *STAGES, 'overlay', 'bag_player')
SETS = {STAGES: 'stages', NODES: 'all'}
#: Nodes of a graph of their own, so that relative names show, and those that only tell their defaults.
NAMESPACE = 'reference'
#: Where nothing of the package has a say: every node of rclpy has these.
STANDARD_TOPICS = ('/rosout', '/parameter_events')
#: There only where vision_msgs is installed; the page says so.
OPTIONAL_TOPICS = ('detections_2d',)
#: Images of the bag that camera and player read, and the time between two of them: both run until they are stopped, as
#: they keep pauses up to a minute.
IMAGES, PAUSE_NS = 200, 50 * NANOSECONDS
#: A node whose parameters are given here would show those instead of its defaults.
NEEDED = 'bag'


def read_nodes(domain_id: int) -> dict[str, NodeInterface]:
    """Starts every node and reads its interface while it is active; values of parameters are their defaults.

    Raises: SourceError where a node does not start or answer.
    """
    with ExitStack() as stack:
        bag = Path(stack.enter_context(tempfile.TemporaryDirectory())) / 'slow.mcap'
        with BagWriter(bag) as writer:
            for index in range(IMAGES):
                writer.write_image(np.zeros((64, 64, 3), np.uint8), NANOSECONDS + index * PAUSE_NS)
        given = {'camera': (text_parameter('source', str(bag)),), 'bag_player': (text_parameter('bag', str(bag)),),
                 'ego_motion': ('imu.use:=true',), 'pipeline': ('imu.use:=true',)}
        defaults = _defaults(domain_id, [node for node in given if node != 'bag_player'])
        processes = [stack.enter_context(NodeProcesses(
            (node,), domain_id, given.get(node, ()), namespace=NAMESPACE)) for node in NODES]
        inspector = stack.enter_context(Inspector(domain_id, NAMESPACE))
        for topic in (OVERLAY, FLOW_COLORS, MARKERS):  # the overlay subscribes on demand
            inspector.subscribe(topic.kind, topic.name.replace('~', 'overlay'))

        def check() -> None:
            for process in processes:
                process.check()

        inspector.await_active(NODES, check)
        found = {node: inspector.read(node) for node in NODES}
    for node, parameters in defaults.items():
        found[node].parameters.update({name: one for name, one in parameters.items() if name != 'autostart'})
    return found


def _defaults(domain_id: int, nodes: list[str]) -> dict[str, dict[str, DeclaredParameter]]:
    """Parameters of nodes to which nothing is given but that they shall not start to work."""
    namespace = f'{NAMESPACE}_defaults'
    with (NodeProcesses(tuple(nodes), domain_id, ('autostart:=false',), namespace=namespace),
          Inspector(domain_id, namespace) as inspector):
        return {node: inspector.parameters(node) for node in nodes}


def topic_table(found: Mapping[str, NodeInterface]) -> list[str]:
    """A row for each topic, type and direction."""
    ends: dict[tuple[str, str], dict[bool, dict[str, Endpoint]]] = {}
    for node, interface in found.items():
        for end in interface.endpoints:
            ends.setdefault((end.topic, end.kind), {True: {}, False: {}})[end.publishes][node] = end
    rows = (f'| `{topic}` | `{kind}` | {_ends(sides[True])} | {_ends(sides[False])} |'
            for (topic, kind), sides in sorted(ends.items()) if topic not in (*STANDARD_TOPICS, *OPTIONAL_TOPICS))
    return ['| topic | type | published by | subscribed to by |', '|---|---|---|---|', *rows]


def _ends(ends: Mapping[str, Endpoint]) -> str:
    """Nodes, grouped by their QoS: ``camera (reliable, 1)``."""
    groups: dict[str, list[str]] = {}
    for node, end in ends.items():
        quality = end.reliability.replace('_', ' ') + ('' if end.depth is None else f', {end.depth}')
        groups.setdefault(quality, []).append(node)
    return '; '.join(f'{_names(nodes)} ({quality})' for quality, nodes in groups.items())


def service_table(found: Mapping[str, NodeInterface]) -> list[str]:
    """A row for each service."""
    rows = (f'| `{name}` | `{kind}` | {nodes} |' for (name, kind), nodes in _by_nodes(
        found, lambda interface: interface.services.items()))
    return ['| service | type | nodes |', '|---|---|---|', *rows]


def parameter_table(found: Mapping[str, NodeInterface]) -> list[str]:
    """A row for each parameter; those of the QoS are one row."""
    def rows_of(interface: NodeInterface) -> Iterator[tuple[str, str]]:
        for name, one in interface.parameters.items():
            if not QOS_PARAMETER.fullmatch(name):
                default = 'needed' if name == NEEDED else _value(one.value)
                yield name, ' | '.join((one.type_name, default, _cell(one.limits), _cell(one.doc),
                                        'no' if one.read_only else 'yes'))

    rows = (f'| `{name}` | {nodes} | {row} |' for (name, row), nodes in _by_nodes(found, rows_of))
    return ['| parameter | nodes | type | default | allowed | meaning | changes at run time |',
            '|---|---|---|---|---|---|---|', *rows]


def _by_nodes(
    found: Mapping[str, NodeInterface], items: Callable[[NodeInterface], Iterable[tuple[str, str]]],
) -> list[tuple[tuple[str, str], str]]:
    """Each item, sorted, with the nodes that have it."""
    nodes_of: dict[tuple[str, str], list[str]] = {}
    for node, interface in found.items():
        for item in items(interface):
            nodes_of.setdefault(item, []).append(node)
    return [(item, _names(nodes)) for item, nodes in sorted(nodes_of.items())]


def _names(nodes: list[str]) -> str:
    return SETS.get(tuple(nodes)) or ', '.join(f'`{node}`' for node in nodes)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return '' if value in ('', None) else f'`{value}`'


def _cell(text: str) -> str:
    return ' '.join(text.split()).replace('|', '\\|')


#: Section of docs/nodes.md -> its table.
TABLES = {'topics': topic_table, 'services': service_table, 'parameters': parameter_table}


@reports_errors
def main() -> int:
    """Exit code 2 where the nodes do not start or the document is not laid out for it."""
    parser = argparse.ArgumentParser(description='Topics, services and parameters of the running nodes.')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the tables into this document, too')
    parser.add_argument('--policy', type=Path, metavar='FILE', help='write the policy of SROS 2 to this file')
    options = parser.parse_args()
    found = read_nodes(own_domain())
    for name, table in TABLES.items():
        show(table(found), options.write, name)
    if options.policy:
        options.policy.write_text(policy(found), encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
