"""Parameters of a real node: what is declared, what is taken, what is refused and in which words."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
import rclpy
from rcl_interfaces.msg import ParameterType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSReliabilityPolicy
from sensor_msgs.msg import Image

from motion_detect_ros.bridge.params import LiveParameters, declare_config, declare_simple, unknown_parameters
from motion_detect_ros.bridge.qos import image_qos, overridable, record_qos
from motion_detect_ros.bridge.track_ids import declare_first_id, first_id
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.settings import settings
from motion_detect_ros.core.types import MAX_ID

MakeNode = Callable[..., Node]


@pytest.fixture(scope='module')
def context() -> Iterator[Context]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        one = Context()
        rclpy.init(context=one, domain_id=own_domain())
        yield one
        rclpy.try_shutdown(context=one)


@pytest.fixture
def make_node(context: Context) -> Iterator[MakeNode]:
    """``make_node(name=value)`` is a node that was given these parameters; dots written as double underscores."""
    made: list[Node] = []

    def make(**given: object) -> Node:
        overrides = [Parameter(name.replace('__', '.'), value=value) for name, value in given.items()]
        made.append(Node('under_test', context=context, parameter_overrides=overrides))
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()


def test_without_parameters_it_is_the_default_preset(make_node: MakeNode):
    assert declare_config(make_node()) == PipelineConfig()


def test_every_setting_is_declared_with_meaning_and_range(make_node: MakeNode):
    node = make_node()
    declare_config(node)
    for name, default, metadata in settings(PipelineConfig()):
        descriptor = node.describe_parameter(name)
        assert descriptor.description.startswith(metadata['doc']), name
        assert descriptor.read_only == (name in {'imu.use', 'imu.time_offset_s', 'load.threads'}), name
        limits = [*descriptor.floating_point_range, *descriptor.integer_range]
        if metadata['low'] is not None:
            assert (limits[0].from_value, limits[0].to_value) == (metadata['low'], metadata['high']), name
        assert type(node.get_parameter(name).value) is type(default), name


def test_a_stage_declares_what_it_uses_and_knows_the_settings_of_others(make_node: MakeNode):
    node = make_node(art2__vigilance=0.3, tracks__coast_s=0.5, tracks__coast=0.5)
    config = declare_config(node, ('art2.', 'optical_flow.baseline_s'))
    assert config.art2.vigilance == 0.3
    assert config.tracks == PipelineConfig().tracks
    assert {name for name, _, _ in settings(PipelineConfig()) if node.has_parameter(name)} == {
        name for name, _, _ in settings(PipelineConfig()) if name.startswith('art2.')} | {'optical_flow.baseline_s'}
    assert unknown_parameters(node) == {'tracks.coast': 'tracks.coast_s'}


def test_values_that_the_user_gives_are_taken(make_node: MakeNode):
    config = declare_config(make_node(art2__vigilance=0.75, art2__max_neurons=70, ego_motion__smoothing='none'))
    assert (config.art2.vigilance, config.art2.max_neurons, config.ego_motion.smoothing) == (0.75, 70, 'none')
    assert config.tracks == PipelineConfig().tracks


@pytest.mark.parametrize(('given', 'words'), [
    ({'art2__vigilance': 2}, r'parameter art2.vigilance: expected float from 0.0 to 1.0: .*2.0'),
    ({'art2__vigilance': True}, r'parameter art2.vigilance: expected float from 0.0 to 1.0: .*BOOL'),
    ({'art2__vigilance': 'half'}, r'parameter art2.vigilance: expected float from 0.0 to 1.0: .*STRING'),
    ({'art2__vigilance': 2.0}, r'parameter art2.vigilance: expected float from 0.0 to 1.0: .*2.0'),
    ({'art2__vigilance': float('nan')}, r'parameter art2.vigilance: expected float from 0.0 to 1.0: .*nan'),
    ({'art2__max_neurons': 1000}, 'parameter art2.max_neurons: expected int from 2 to 200: .*1000'),
    ({'art2__max_neurons': 25.0}, 'parameter art2.max_neurons: expected int from 2 to 200: .*DOUBLE'),
    ({'ego_motion__smoothing': 'magic'},
     "parameter ego_motion.smoothing: expected one of kalman, autoregressive, none, got 'magic'"),
    ({'ego_motion__smoothing': 3},
     "parameter ego_motion.smoothing: expected one of kalman, autoregressive, none, got '3'"),
    ({'ego_motion__smoothing': 3.5}, 'parameter ego_motion.smoothing: expected str: .*DOUBLE'),
])
def test_refusals_are_one_line_with_expected_and_actual(make_node: MakeNode, given: dict[str, object], words: str):
    with pytest.raises(ConfigError, match=words) as caught:
        declare_config(make_node(**given))
    assert '\n' not in str(caught.value)


def test_integers_are_taken_for_floats_and_texts_and_stay_what_was_declared(make_node: MakeNode):
    node = make_node(rate=2, source=0, art2__vigilance=1)
    assert declare_simple(node, 'rate', 1.0, 'doc', 0.5, 10.0) == 2.0
    assert declare_simple(node, 'source', '', 'doc') == '0'
    assert declare_config(node).art2.vigilance == 1.0
    types = [node.describe_parameter(name).type for name in ('rate', 'source', 'art2.vigilance')]
    assert types == [ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_STRING, ParameterType.PARAMETER_DOUBLE]
    assert (type(node.get_parameter('rate').value), node.get_parameter('source').value) == (float, '0')
    assert node.describe_parameter('rate').floating_point_range[0].to_value == 10.0
    assert not node.set_parameters([Parameter('rate', value=3.0)])[0].successful


def test_the_first_id_is_the_one_given_or_by_the_clock(make_node: MakeNode):
    assert declare_first_id(make_node(first_id=7)) == 7
    assert declare_first_id(make_node(first_id=MAX_ID)) == MAX_ID
    for given in ({}, {'first_id': 0}):
        before = first_id(time.time())
        assert before <= declare_first_id(make_node(**given)) <= first_id(time.time())
    for beyond in (-1, MAX_ID + 1):
        with pytest.raises(ConfigError, match='parameter first_id: expected int from 0 to 4294967295'):
            declare_first_id(make_node(first_id=beyond))


def test_misspelt_names_are_found_known_ones_are_not(make_node: MakeNode):
    node = make_node(art2__vigilanse=0.3, bag='of another node', **{'qos_overrides./image_raw.publisher.depth': 3})
    declare_config(node)
    assert unknown_parameters(node) == {'art2.vigilanse': 'art2.vigilance'}


def test_what_is_set_together_is_checked_together_and_applied_as_declared(make_node: MakeNode):
    node, taken = make_node(), []
    for name, default in {'a': 1.0, 'b': 2.0, 'c': 'x'}.items():
        declare_simple(node, name, default, 'doc', *((0.0, 9.0) if name != 'c' else ()), live=True)

    def check(values: dict[str, object]) -> None:
        if values.get('a', 0.0) > values.get('b', 9.0):
            raise ConfigError(f'a: expected at most b, got {values}')

    live = LiveParameters(node)
    live.add(['a', 'b'], taken.append, check)
    live.add(['c'], taken.append)
    result = node.set_parameters_atomically([Parameter('a', value=8), Parameter('b', value=7.0)])
    assert (result.successful, result.reason) == (False, "a: expected at most b, got {'a': 8.0, 'b': 7.0}")
    assert (node.get_parameter('a').value, taken) == (1.0, [])
    assert node.set_parameters_atomically([Parameter('a', value=3), Parameter('c', value='y')]).successful
    assert taken == [{'a': 3.0}, {'c': 'y'}]
    assert type(node.get_parameter('a').value) is float
    assert not node.set_parameters([Parameter('a', value=10.0)])[0].successful
    assert not node.set_parameters([Parameter('c', value=3)])[0].successful
    assert len(taken) == 2


def test_node_parameters_know_their_choices_and_limits(make_node: MakeNode):
    node = make_node(image_reliability='maybe', queue_size=0)
    with pytest.raises(ConfigError, match="image_reliability: expected one of reliable, best_effort, got 'maybe'"):
        declare_simple(node, 'image_reliability', 'reliable', 'doc', choices=('reliable', 'best_effort'))
    with pytest.raises(ConfigError, match='queue_size: expected int from 1 to 1000: .*0'):
        declare_simple(node, 'queue_size', 2, 'doc', 1, 1000)


def test_quality_of_service_is_as_documented():
    assert (image_qos().depth, image_qos().reliability) == (1, QoSReliabilityPolicy.RELIABLE)
    assert image_qos('best_effort', 4).reliability == QoSReliabilityPolicy.BEST_EFFORT
    assert (image_qos('best_effort', 4).depth, record_qos().depth) == (4, 5)
    assert record_qos().reliability == QoSReliabilityPolicy.RELIABLE


def test_users_override_quality_of_service_by_the_standard_parameters(make_node: MakeNode):
    prefix = 'qos_overrides./image_raw.publisher'
    node = make_node(**{f'{prefix}.depth': 9, f'{prefix}.reliability': 'best_effort'})
    publisher = node.create_publisher(Image, 'image_raw', image_qos(), qos_overriding_options=overridable())
    offered = node.get_publishers_info_by_topic('/image_raw')[0].qos_profile
    assert offered.reliability == QoSReliabilityPolicy.BEST_EFFORT
    assert node.get_parameter(f'{prefix}.depth').value == 9
    node.destroy_publisher(publisher)
