"""The topic ``load``: the published layout, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from motion_detect_ros.bridge.load import LOAD_DTYPE, Stage, StageTime, load_from_msg, load_to_msg
from motion_detect_ros.bridge.recorded_results import is_result
from motion_detect_ros.bridge.records import records_to_msg
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.sources.raw import TopicInfo

HEADER = Header(stamp=Time(sec=5, nanosec=6), frame_id='eye')


def record(**values: float) -> np.ndarray:
    one = np.zeros(1, LOAD_DTYPE)
    for name, value in {'compute_ms': 7.5, 'load_step': 2, 'stage': 1, **values}.items():
        one[name] = value
    return one


def test_fields_are_the_published_ones():
    msg = load_to_msg(StageTime(Stage.OPTICAL_FLOW, 12.25, 3), HEADER)
    assert [(field.name, field.datatype, field.offset) for field in msg.fields] == [
        ('compute_ms', PointField.FLOAT32, 0), ('load_step', PointField.UINT8, 4), ('stage', PointField.UINT8, 5)]
    assert (msg.width, msg.height, msg.header) == (1, 1, HEADER)
    assert bytes(msg.data) == np.float32(12.25).tobytes() + bytes((3, 1))


@pytest.mark.parametrize('stage', Stage)
def test_times_survive_the_wire(stage):
    sent = StageTime(stage, 0.5, 4)
    assert load_from_msg(deserialize_message(serialize_message(load_to_msg(sent, HEADER)), PointCloud2)) == sent


@pytest.mark.parametrize(('values', 'words'), [
    ({'load_step': 5}, '^load: expected load_step 0 to 4, got 5$'),
    ({'compute_ms': np.nan}, '^load: expected compute_ms of at least 0, got nan$'),
    ({'compute_ms': np.inf}, '^load: expected compute_ms of at least 0, got inf$'),
    ({'compute_ms': -1.0}, '^load: expected compute_ms of at least 0, got -1$'),
    ({'stage': 0}, '^load: expected stage 1 to 2, got 0$'),
    ({'stage': 3}, '^load: expected stage 1 to 2, got 3$'),
])
def test_nonsense_is_refused(values, words):
    with pytest.raises(MessageError, match=words):
        load_from_msg(records_to_msg(record(**values), HEADER))


@pytest.mark.parametrize('count', [0, 2])
def test_one_record_is_expected(count):
    with pytest.raises(MessageError, match=f'^load: expected one record, got {count}$'):
        load_from_msg(records_to_msg(np.repeat(record(), count), HEADER))


def test_a_missing_field_is_named():
    msg = records_to_msg(record(), HEADER)
    msg.fields = [field for field in msg.fields if field.name != 'stage']
    with pytest.raises(MessageError, match='expected fields stage, got compute_ms, load_step'):
        load_from_msg(msg)


@pytest.mark.parametrize(('kind', 'result'), [('sensor_msgs/msg/PointCloud2', True), ('std_msgs/msg/Float32', False)])
def test_a_recorded_one_is_not_played_to_a_running_detector(kind, result):
    assert is_result(TopicInfo('/front/load', kind, 1)) == result
