"""docs/nodes.md holds what the running nodes offer, and the reader of their interfaces sees a change."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from motion_detect_ros.benchmarks.node_interface import DeclaredParameter, Endpoint, NodeInterface
from motion_detect_ros.benchmarks.node_reference import (
    NODES,
    TABLES,
    parameter_table,
    read_nodes,
    service_table,
    topic_table,
)
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.settings import settings

pytestmark = pytest.mark.messages

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'nodes.md'
POLICY = PAGE.parents[1] / 'config' / 'motion_detect.policy.xml'
WRITE = 'run python -m motion_detect_ros.benchmarks.node_reference --write docs/nodes.md'


@pytest.fixture(scope='module')
def found() -> dict[str, NodeInterface]:
    return read_nodes(own_domain())


@pytest.mark.parametrize('name', TABLES)
def test_page_holds_what_the_running_nodes_offer(found: dict[str, NodeInterface], name: str) -> None:
    _, part = PAGE.read_text(encoding='utf-8').split(f'<!-- generated: {name} -->\n')
    assert part.split(f'\n<!-- end: {name} -->')[0].splitlines() == TABLES[name](found), WRITE


def test_policy_allows_what_the_running_nodes_do_and_no_more(found: dict[str, NodeInterface], shown) -> None:
    """Besides: the clock of a simulation, compressed images, and the topic of an optional package."""
    enclaves = ElementTree.parse(POLICY).findall('./enclaves/enclave')
    assert [enclave.get('path') for enclave in enclaves] == [f'/motion_detect/{node}' for node in found]
    for enclave, (node, interface) in zip(enclaves, found.items(), strict=True):
        (profile,) = enclave.findall('./profiles/profile')
        assert (profile.get('ns'), profile.get('node')) == ('/', node)
        allowed = {act: {one.text for group in profile if group.get(act) == 'ALLOW' for one in group}
                   for act in ('publish', 'subscribe', 'reply')}
        ends = {publishes: {end.topic for end in interface.endpoints if end.publishes == publishes}
                for publishes in (True, False)}
        assert allowed['publish'] - {'detections_2d'} == ends[True] - {'detections_2d'}, node
        compressed = {'image_raw/compressed'} if 'image_transport' in interface.parameters else set()
        assert allowed['subscribe'] == ends[False] | {'/clock'} | compressed, node
        assert allowed['reply'] == set(interface.services), node
    shown('the policy of SROS 2 in `config/`', 'allows the topics and services of the running nodes, and no more',
          f'{len(enclaves)} nodes')


def test_reader_sees_what_a_user_gives(found: dict[str, NodeInterface]) -> None:
    """Against what rclpy itself was told in the code: names, types, ranges and defaults of the settings."""
    assert set(found) == set(NODES)
    for name, default, metadata in settings(PipelineConfig()):
        declared = [interface.parameters[name] for interface in found.values() if name in interface.parameters]
        assert declared, name
        assert {one.value for one in declared} == {default}, name
        if metadata['low'] is not None:
            assert {one.limits for one in declared} == {f'{metadata["low"]:g} to {metadata["high"]:g}'}
    assert found['camera'].parameters['source'].value == '0'
    assert '/dev/video0' in found['camera'].parameters['source'].doc
    assert found['pipeline'].services['~/reset'] == 'std_srvs/Trigger'


def test_tables() -> None:
    """Worked by hand: two nodes that share a topic, a service and a parameter, and differ in another."""
    rate = DeclaredParameter('rate', 'double', 1.0, '0 to 5', False, 'speed | pace')
    depth = DeclaredParameter('qos_overrides./r/image.publisher.depth', 'integer', 3, '', True, '')
    one = NodeInterface((Endpoint('image', 'sensor_msgs/Image', True, 'best_effort', 3),),
                        {'~/reset': 'std_srvs/Trigger'}, {'rate': rate, depth.name: depth})
    other = NodeInterface((Endpoint('image', 'sensor_msgs/Image', False, 'reliable', None),),
                          {'~/reset': 'std_srvs/Trigger'}, {'rate': replace(rate, read_only=True)})
    both = {'camera': one, 'overlay': other}
    assert topic_table(both)[2:] == [
        '| `image` | `sensor_msgs/Image` | `camera` (best effort, 3) | `overlay` (reliable) |']
    assert service_table(both)[2:] == ['| `~/reset` | `std_srvs/Trigger` | `camera`, `overlay` |']
    assert parameter_table(both)[2:] == [
        '| `rate` | `overlay` | double | `1.0` | 0 to 5 | speed \\| pace | no |',
        '| `rate` | `camera` | double | `1.0` | 0 to 5 | speed \\| pace | yes |']
