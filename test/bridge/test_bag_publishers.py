"""Which topics of a bag get a publisher, and what is said of the others."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from motion_detect_ros.bridge.bag_publishers import BagPublishers
from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.sources.raw import TopicInfo

TEXT = 'std_msgs/msg/String'


@pytest.fixture
def node() -> Iterator[ManagedNode]:
    rclpy.init(domain_id=own_domain())
    made = ManagedNode('player')
    yield made
    made.destroy_node()
    rclpy.shutdown()


def warned(node: ManagedNode, capfd: pytest.CaptureFixture[str], *topics: TopicInfo) -> tuple[BagPublishers, list[str]]:
    """The publishers of a bag's topics, and the warnings of the node, a line each."""
    capfd.readouterr()
    made = BagPublishers(node, topics)
    return made, [line.partition('input left out: ')[2] for line in capfd.readouterr().err.splitlines()
                  if line.startswith('[WARN]')]


@pytest.mark.parametrize(('name', 'shown'), [
    *((name, name) for name in ('/a{b}', '/{node}/a', '/{', '/~', '~/a', '/a b', '/é', '/a//b', '/a/', '/1a', '', '/',
                                f'/{"a" * 300}')),
    ('/a\nb', r'/a\nb'), ('/a\x1b[2Jb', r'/a\x1b[2Jb'), ('/a\0b', r'/a\x00b'), ('/\ud800', r'/\ud800'),
])
def test_an_odd_name_costs_that_topic_only(node: ManagedNode, capfd: pytest.CaptureFixture[str], name: str, shown: str):
    """Names that ROS would expand are none of a recording: what is played has the name that was recorded."""
    before, after = TopicInfo('/before', TEXT, 1), TopicInfo('/after', TEXT, 1)
    made, said = warned(node, capfd, before, TopicInfo(name, TEXT, 1), after)
    assert made.topics == ['/before', '/after']
    line, = said
    assert line.startswith(f'topic {shown}: ')


@pytest.mark.parametrize('kind', ['std_msgs/msg/_string', 'std_msgs/msg/__name__', 'std_msgs/msg/__doc__', 'std_msgs',
                                  'std_msgs/msg/', '/msg/String', 'std_msgs/msg/\ud800', '\ud800/msg/String', ''])
def test_an_odd_type_costs_that_topic_only(node: ManagedNode, capfd: pytest.CaptureFixture[str], kind: str):
    made, said = warned(node, capfd, TopicInfo('/odd', kind, 1), TopicInfo('/text', TEXT, 1))
    assert made.topics == ['/text']
    line, = said
    assert line.startswith('topic /odd: message type ')
    assert line.endswith(': expected an installed package, found none')


def test_a_topic_that_the_node_has_with_another_type_costs_itself_only(
        node: ManagedNode, capfd: pytest.CaptureFixture[str]):
    made, said = warned(node, capfd, TopicInfo('/diagnostics', TEXT, 1), TopicInfo('/text', TEXT, 1))
    assert made.topics == ['/text']
    line, = said
    assert line.startswith('topic /diagnostics: ')


def test_the_same_name_with_and_without_a_slash_is_played_on_one_topic(
        node: ManagedNode, capfd: pytest.CaptureFixture[str]):
    made, said = warned(node, capfd, TopicInfo('/text', TEXT, 1), TopicInfo('text', TEXT, 1))
    assert (made.topics, said) == (['/text', 'text'], [])
    node.create_subscription(String, '/text', print, QoSProfile(depth=1))
    assert node.count_publishers('/text') == 2
