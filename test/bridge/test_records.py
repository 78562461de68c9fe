"""Records as PointCloud2: the published layout, and tolerance for other people's."""

from __future__ import annotations

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from motion_detect_ros.bridge.records import (
    EGO_DTYPE,
    detections_to_msg,
    ego_from_msg,
    ego_to_msg,
    read_detections,
    records_from_msg,
    records_to_msg,
)
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.core.types import (
    DETECTION_DTYPE,
    EgoMotion,
    EgoStatus,
    MotionModel,
    RelativePose,
    empty_detections,
)

HEADER = Header(stamp=Time(sec=5, nanosec=6), frame_id='eye')
F4, U4, F8, U1 = PointField.FLOAT32, PointField.UINT32, PointField.FLOAT64, PointField.UINT8


def some_detections() -> np.ndarray:
    records = empty_detections(3)
    random = np.random.default_rng(0)
    for name in DETECTION_DTYPE.names:
        records[name] = random.integers(1, 1000, 3) if DETECTION_DTYPE[name].kind == 'u' else random.normal(size=3)
    records['ttc'] = [np.inf, np.nan, 2.5]
    return records


def test_detection_fields_are_the_published_ones():
    published = [
        ('u', F4), ('v', F4), ('width', F4), ('height', F4), ('vel_u', F4), ('vel_v', F4), ('var_u', F4), ('var_v', F4),
        ('score', F4), ('ttc', F4), ('bearing_x', F4), ('bearing_y', F4), ('bearing_z', F4), ('id', U4), ('age', U4),
        ('area', F4), ('cluster', U4)]
    msg = detections_to_msg(some_detections(), HEADER)
    assert [(field.name, field.datatype) for field in msg.fields] == published
    assert (msg.height, msg.width, msg.point_step, msg.row_step) == (1, 3, 68, 204)
    assert not {'x', 'y', 'z'} & {field.name for field in msg.fields}


def test_ego_fields_are_the_published_ones():
    published = ([(f'm{r}{c}', F8) for r in range(3) for c in range(3)] + [(f'c{i:02d}', F8) for i in range(21)] + [
        ('dt', F8), ('inliers', U4), ('tracks', U4), ('residual', F4), ('model', U1), ('status', U1),
        ('prev_sec', U4), ('prev_nanosec', U4)] + [(f'r{r}{c}', F8) for r in range(3) for c in range(3)] + [
        (name, F8) for name in ('t0', 't1', 't2', 'e0', 'e1', 'g0', 'g1', 'g2')] + [('load_step', U1)])
    ego = EgoMotion(np.eye(3), np.eye(6), EgoStatus.OK, 2, 1)
    assert [(field.name, field.datatype) for field in ego_to_msg(ego, HEADER).fields] == published


@pytest.mark.parametrize('count', [0, 3])
def test_detections_survive_the_wire(count):
    sent = some_detections()[:count]
    msg = deserialize_message(serialize_message(detections_to_msg(sent, HEADER)), PointCloud2)
    assert read_detections(msg).tobytes() == sent.tobytes()


def test_other_order_extra_fields_and_big_endian_are_read():
    sent = some_detections()
    names = [*reversed(DETECTION_DTYPE.names), 'extra']
    kinds = [DETECTION_DTYPE[name] if name != 'extra' else np.dtype('<f8') for name in names]
    foreign = np.dtype([(name, kind.newbyteorder('>')) for name, kind in zip(names, kinds, strict=True)])
    records = np.zeros(3, foreign)
    for name in DETECTION_DTYPE.names:
        records[name] = sent[name]
    msg = records_to_msg(records, HEADER)
    msg.is_bigendian = True
    assert read_detections(msg).tobytes() == sent.tobytes()


def test_records_of_older_versions_lack_later_fields():
    """As old bags hold them: a layout that has since grown by three fields."""
    older = np.zeros(2, [('u', '<f4'), ('id', '<u4')])
    older['u'], older['id'] = (1.5, 2.5), (7, 8)
    grown = np.dtype([('u', '<f4'), ('r00', '<f8'), ('id', '<u4'), ('background', 'u1'), ('focal', '<f4')])
    later = ('r00', 'background', 'focal')
    read = records_from_msg(records_to_msg(older, HEADER), grown, later)
    assert (read['u'].tolist(), read['id'].tolist(), read['background'].tolist()) == ([1.5, 2.5], [7, 8], [0, 0])
    assert np.isnan(read['r00']).all()
    assert np.isnan(read['focal']).all()
    with pytest.raises(MessageError, match='expected fields r00, focal, got u, id'):
        records_from_msg(records_to_msg(older, HEADER), grown, ('background',))
    full = np.ones(1, grown)
    assert records_from_msg(records_to_msg(full, HEADER), grown, later) == full


def test_the_first_ego_motion_records_are_still_read():
    """Whatever has been added since: the 38 fields of the first version, and nothing else."""
    sent = EgoMotion(np.diag([1.0, 2.0, 1.0]), np.eye(6), EgoStatus.OK, 5_000_000_006, 4_000_000_000, 3, 4, 0.5)
    msg = ego_to_msg(sent, HEADER)
    first = [f'm{r}{c}' for r in range(3) for c in range(3)] + [f'c{i:02d}' for i in range(21)] + [
        'dt', 'inliers', 'tracks', 'residual', 'model', 'status', 'prev_sec', 'prev_nanosec']
    msg.fields = [field for field in msg.fields if field.name in first]
    got = ego_from_msg(msg)
    np.testing.assert_array_equal(got.matrix, sent.matrix)
    assert (got.status, got.prev_stamp_ns, got.inliers, got.residual_px) == (EgoStatus.OK, 4_000_000_000, 3, 0.5)
    assert (got.camera, got.load_step) == (None, 0)


def test_records_before_the_load_step_are_of_full_work():
    """As recordings have them that know the camera's motion already."""
    camera = RelativePose(np.eye(3), np.array([0.0, 0.6, 0.8]), np.array([3.0, 4.0]))
    msg = ego_to_msg(EgoMotion(np.eye(3), np.eye(6), EgoStatus.OK, 2, 1, camera=camera, load_step=3), HEADER)
    msg.fields = [field for field in msg.fields if field.name != 'load_step']
    got = ego_from_msg(msg)
    assert got.load_step == 0
    assert got.camera is not None
    np.testing.assert_array_equal(got.camera.direction, [0.0, 0.6, 0.8])


@pytest.mark.parametrize('number', range(5))
def test_the_load_step_of_an_image_survives_the_wire(number):
    msg = ego_to_msg(EgoMotion(np.eye(3), np.eye(6), EgoStatus.OK, 2, 1, load_step=number), HEADER)
    assert ego_from_msg(deserialize_message(serialize_message(msg), PointCloud2)).load_step == number


@pytest.mark.parametrize('number', [5, 255])
def test_a_load_step_that_is_not_known_is_refused(number):
    """As of a later version: at which width to work is not known."""
    msg = ego_to_msg(EgoMotion(np.eye(3), np.eye(6), EgoStatus.OK, 2, 1, load_step=number), HEADER)
    with pytest.raises(MessageError, match=f'^ego_motion: expected load_step 0 to 4, got {number}$'):
        ego_from_msg(msg)


def test_missing_fields_and_bytes_are_named():
    msg = detections_to_msg(some_detections(), HEADER)
    msg.fields = [field for field in msg.fields if field.name not in ('id', 'ttc')]
    with pytest.raises(MessageError, match='expected fields ttc, id, got u, v, '):
        read_detections(msg)
    msg = detections_to_msg(some_detections(), HEADER)
    msg.data = msg.data[:-1]
    with pytest.raises(MessageError, match='expected 204 bytes, got 203'):
        read_detections(msg)


def test_padding_after_each_row_is_skipped():
    sent = some_detections()[:2]
    msg = detections_to_msg(sent, HEADER)
    msg.height, msg.width, msg.row_step = 2, 1, 80
    msg.data = sent[:1].tobytes() + bytes(12) + sent[1:].tobytes() + bytes(12)
    assert read_detections(msg).tobytes() == sent.tobytes()
    msg.row_step = 60
    with pytest.raises(MessageError, match='expected row_step of at least 68 bytes, got 60'):
        read_detections(msg)


@pytest.mark.parametrize(('change', 'words'), [
    (lambda msg: setattr(msg, 'point_step', 60), 'point_step of at least 68 bytes for field cluster, got 60'),
    (lambda msg: setattr(msg, 'point_step', 0), 'point_step of at least 68 bytes for field cluster, got 0'),
    (lambda msg: setattr(msg.fields[0], 'offset', 4000), 'point_step of at least 4004 bytes for field u, got 68'),
    (lambda msg: setattr(msg.fields[0], 'datatype', 99), 'field u of datatype 1 to 8, got 99'),
])
def test_layouts_that_cannot_be_are_refused(change, words):
    msg = detections_to_msg(some_detections(), HEADER)
    change(msg)
    with pytest.raises(MessageError, match=words):
        read_detections(msg)


def test_what_is_odd_in_foreign_extra_fields_does_not_matter():
    sent = some_detections()
    msg = detections_to_msg(sent, HEADER)
    msg.fields = [*msg.fields, PointField(name='odd', offset=9999, datatype=99, count=7),
                  PointField(name='odd', offset=0, datatype=F4, count=0)]
    assert read_detections(msg).tobytes() == sent.tobytes()


def test_times_before_1970_do_not_fit_the_record():
    ego = EgoMotion(np.eye(3), np.eye(6), EgoStatus.FIRST_FRAME, 0, -1)
    with pytest.raises(MessageError, match='expected a stamp of at least 0 ns, got -1'):
        ego_to_msg(ego, HEADER)


def test_ego_motion_survives_the_wire():
    random = np.random.default_rng(1)
    root = random.normal(size=(6, 6))
    sent = EgoMotion(random.normal(size=(3, 3)), root @ root.T, EgoStatus.OK, 5_000_000_006, 4_999_000_000, 300, 400,
                     0.125, MotionModel.AFFINE)
    got = ego_from_msg(deserialize_message(serialize_message(ego_to_msg(sent, HEADER)), PointCloud2))
    np.testing.assert_array_equal(got.matrix, sent.matrix)
    np.testing.assert_array_equal(got.covariance, sent.covariance)
    assert (got.status, got.stamp_ns, got.prev_stamp_ns, got.inliers, got.tracks, got.residual_px, got.model) == (
        sent.status, sent.stamp_ns, sent.prev_stamp_ns, 300, 400, 0.125, MotionModel.AFFINE)
    assert got.dt_s == pytest.approx(0.001000006)


@pytest.mark.parametrize('ground', [None, np.array([0.01, 0.6, -0.02])])
@pytest.mark.parametrize('epipole', [np.array([320.5, 180.25]), np.array([np.inf, np.nan])])
def test_camera_motion_survives_the_wire(epipole, ground):
    rotation = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    camera = RelativePose(rotation, np.array([0.6, 0.0, -0.8]), epipole, ground)
    msg = ego_to_msg(EgoMotion(np.eye(3), np.eye(6), EgoStatus.OK, 2, 1, camera=camera), HEADER)
    got = ego_from_msg(deserialize_message(serialize_message(msg), PointCloud2)).camera
    for name in ('rotation', 'direction', 'epipole'):
        np.testing.assert_array_equal(getattr(got, name), getattr(camera, name))
    assert got.ground is None if ground is None else got.ground.tolist() == ground.tolist()
    # As another program reads it, by name.
    record, = records_from_msg(msg, np.dtype([(name, '<f8') for name in ('r01', 'r10', 't2', 'e0', 'g1')]))
    assert record.tolist()[:4] == (-1.0, 1.0, -0.8, epipole[0])
    assert np.isnan(record['g1']) if ground is None else record['g1'] == 0.6


def test_unknown_camera_motion_is_nan_on_the_wire():
    msg = ego_to_msg(EgoMotion(np.eye(3), np.eye(6), EgoStatus.OK, 2, 1), HEADER)
    record, = records_from_msg(msg, np.dtype([(name, '<f8') for name in ('r00', 't0', 'e0', 'g2')]))
    assert np.isnan(record.tolist()).all()
    assert ego_from_msg(msg).camera is None


@pytest.mark.parametrize(('status', 'count', 'words'), [(77, 1, '77'), (0, 2, 'expected one record, got 2')])
def test_nonsense_ego_motion_is_refused(status, count, words):
    records = np.zeros(count, EGO_DTYPE)
    records['status'] = status
    with pytest.raises(MessageError, match=words):
        ego_from_msg(records_to_msg(records, HEADER))
