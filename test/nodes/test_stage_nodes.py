"""What a stage node promises beside its answers: lifecycle, reset, diagnostics, inputs of every kind."""

from __future__ import annotations

import math
import signal

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from peers import TIMEOUT_S, all_came, image_message, lossless, picture, ready, small
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from std_srvs.srv import Trigger

from motion_detect_ros.bridge.images import header_of, stamp_ns
from motion_detect_ros.bridge.records import ego_from_msg, read_detections
from motion_detect_ros.core.types import EgoStatus

FRAMES = 12
PERIOD_NS = 100_000_000


def play(peer, publisher, answers, indexes, make=image_message):
    """One picture after the other, each after the answer to the one before."""
    for index in indexes:
        wanted = len(answers) + 1
        publisher.publish(make(index))
        assert peer.until(lambda wanted=wanted: len(answers) >= wanted), f'no answer to image {index}'


def test_answers_carry_stamp_and_frame_of_their_image(peer, start):
    start('pipeline', *small(), *lossless('detections', 'ego_motion', 'flow'))
    detections, egos, flows = (
        peer.subscribe(kind, name) for kind, name in
        ((PointCloud2, 'detections'), (PointCloud2, 'ego_motion'), (Image, 'flow')))
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    play(peer, publisher, detections, range(FRAMES))
    for messages in (detections, egos, flows):
        all_came(peer, messages, [(i + 1) * PERIOD_NS for i in range(FRAMES)])
        assert {m.header.frame_id for m in messages} == {'front'}
    # The camera moves right by 2 pixels a frame, so the ground moves left by 2; the very first frame knows nothing.
    first, *later = [ego_from_msg(m) for m in egos]
    assert first.status == EgoStatus.FIRST_FRAME
    np.testing.assert_array_equal(first.matrix, np.eye(3))
    for ego in later[3:]:
        np.testing.assert_allclose(ego.matrix @ (160, 120, 1), (158, 120, 1), atol=0.1)
        assert ego.dt_s == pytest.approx(0.1)
    flow = np.frombuffer(flows[-1].data, np.float32).reshape(flows[-1].height, flows[-1].width, 2)
    assert flows[-1].encoding == '32FC2'
    np.testing.assert_allclose(np.nanmedian(flow, axis=(0, 1)), (-2.0, 0.0), atol=0.1)


def change(peer, node: str, transition: int) -> None:
    assert peer.call(ChangeState, f'/{node}/change_state', transition=Transition(id=transition)).success


def test_lifecycle_waits_works_rests_and_works_again(peer, start):
    start('ego_motion', *small('autostart:=false'))
    answers = peer.subscribe(PointCloud2, 'ego_motion')
    publisher = peer.advertise(Image, 'image_raw')

    def state() -> int:
        return peer.call(GetState, '/ego_motion/get_state').current_state.id

    assert state() == State.PRIMARY_STATE_UNCONFIGURED
    assert not peer.call(Trigger, '/ego_motion/reset').success
    assert peer.node.count_subscribers('image_raw') == 0
    for _ in range(2):
        change(peer, 'ego_motion', Transition.TRANSITION_CONFIGURE)
        assert state() == State.PRIMARY_STATE_INACTIVE
        assert peer.until(lambda: peer.node.count_publishers('ego_motion') == 1)
        change(peer, 'ego_motion', Transition.TRANSITION_ACTIVATE)
        assert ready(peer, 'image_raw')
        play(peer, publisher, answers, range(3))
        assert [ego_from_msg(m).status for m in answers] == [EgoStatus.FIRST_FRAME, EgoStatus.OK, EgoStatus.OK]
        answers.clear()
        change(peer, 'ego_motion', Transition.TRANSITION_DEACTIVATE)
        assert peer.until(lambda: publisher.get_subscription_count() == 0)
        change(peer, 'ego_motion', Transition.TRANSITION_CLEANUP)
        assert state() == State.PRIMARY_STATE_UNCONFIGURED
        assert peer.until(lambda: peer.node.count_publishers('ego_motion') == 0)


def test_reset_forgets_the_past_and_no_id_comes_twice(peer, start):
    start('pipeline', *small(), *lossless('detections', 'ego_motion'))
    answers, egos = peer.subscribe(PointCloud2, 'detections'), peer.subscribe(PointCloud2, 'ego_motion')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    play(peer, publisher, answers, range(FRAMES))
    all_came(peer, egos, [(i + 1) * PERIOD_NS for i in range(FRAMES)])  # they come after the detections
    before = {int(i) for m in answers for i in read_detections(m)['id']}
    assert before
    assert peer.call(Trigger, '/pipeline/reset').success
    answers.clear()
    egos.clear()
    play(peer, publisher, answers, range(FRAMES, 2 * FRAMES))
    all_came(peer, egos, [(i + 1) * PERIOD_NS for i in range(FRAMES, 2 * FRAMES)])
    assert ego_from_msg(egos[0]).status == EgoStatus.FIRST_FRAME
    after = {int(i) for m in answers for i in read_detections(m)['id']}
    assert after
    assert not before & after


def test_no_id_comes_twice_after_clean_up(peer, start):
    start('pipeline', *small())
    answers, egos = peer.subscribe(PointCloud2, 'detections'), peer.subscribe(PointCloud2, 'ego_motion')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    play(peer, publisher, answers, range(FRAMES))
    before = {int(i) for m in answers for i in read_detections(m)['id']}
    for name in ('DEACTIVATE', 'CLEANUP', 'CONFIGURE', 'ACTIVATE'):
        change(peer, 'pipeline', getattr(Transition, f'TRANSITION_{name}'))
        if name == 'DEACTIVATE':
            assert peer.until(lambda: publisher.get_subscription_count() == 0)
    answers.clear()
    egos.clear()
    assert ready(peer, 'image_raw')
    play(peer, publisher, answers, range(FRAMES))
    after = {int(i) for m in answers for i in read_detections(m)['id']}
    assert ego_from_msg(egos[0]).status == EgoStatus.FIRST_FRAME
    assert (len(before), len(after), len(before & after)) == (1, 1, 0)


def test_time_that_jumps_back_is_a_new_start_with_its_label(peer, start):
    start('ego_motion', *small())
    answers = peer.subscribe(PointCloud2, 'ego_motion')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    play(peer, publisher, answers, [5, 6, 2, 3])
    statuses = [ego_from_msg(m).status for m in answers]
    assert statuses == [EgoStatus.FIRST_FRAME, EgoStatus.OK, EgoStatus.TIME_JUMP, EgoStatus.OK]


def test_diagnostics_count_what_was_sent(peer, start):
    start('pipeline', *small())
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    answers = peer.subscribe(PointCloud2, 'detections')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    play(peer, publisher, answers, range(FRAMES))
    broken = image_message(FRAMES)
    broken.step = 10
    publisher.publish(broken)

    def latest() -> dict[str, str]:
        return {pair.key: pair.value for pair in reports[-1].status[0].values} if reports else {}

    assert peer.until(lambda: latest().get('errors') == '1'), latest()
    values = latest()
    assert (values['received'], values['processed'], values['dropped']) == (str(FRAMES + 1), str(FRAMES), '0')
    assert 'expected at least 960 bytes' in values['last_error']
    assert 0.0 < float(values['latency_p50_ms']) <= float(values['latency_p95_ms'])
    assert reports[-1].status[0].name == '/pipeline'


@pytest.mark.timing
def test_diagnostics_come_once_a_second(peer, start):
    start('ego_motion', *small())
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    assert peer.until(lambda: len(reports) >= 5)
    times = [stamp_ns(m.header) * 1e-9 for m in reports[:5]]
    assert np.diff(times) == pytest.approx([1.0] * 4, abs=0.3)


def jpeg(index: int) -> CompressedImage:
    _, data = cv2.imencode('.png', picture(index))
    return CompressedImage(header=header_of((index + 1) * PERIOD_NS, 'front'), format='png', data=data.tobytes())


def test_compressed_images_give_the_same_answer(peer, start):
    start('pipeline', *small('image_transport:=compressed'), '-r', '__node:=from_png')
    start('ego_motion', *small(), '-r', 'ego_motion:=raw_ego')
    compressed, raw = peer.subscribe(PointCloud2, 'ego_motion'), peer.subscribe(PointCloud2, 'raw_ego')
    png, plain = peer.advertise(CompressedImage, 'image_raw/compressed'), peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw/compressed')
    assert ready(peer, 'image_raw')
    for index in range(4):
        png.publish(jpeg(index))
        plain.publish(image_message(index))
        assert peer.until(lambda index=index: len(compressed) > index and len(raw) > index)
    assert [bytes(m.data) for m in compressed] == [bytes(m.data) for m in raw]


def test_best_effort_camera_namespace_and_calibration(peer, start):
    start('pipeline', *small('image_reliability:=best_effort'), '-r', '__ns:=/front')
    answers = peer.subscribe(PointCloud2, '/front/detections')
    publisher = peer.advertise(Image, '/front/image_raw', best_effort=True)
    infos = peer.advertise(CameraInfo, '/front/camera_info')
    assert ready(peer, '/front/image_raw')
    assert ready(peer, '/front/camera_info')
    info = CameraInfo(width=320, height=240)
    info.k = [300.0, 0.0, 160.0, 0.0, 300.0, 120.0, 0.0, 0.0, 1.0]
    infos.publish(info)
    play(peer, publisher, answers, range(FRAMES))
    records = read_detections(answers[-1])
    assert len(records) == 1
    ray = np.array([(records['u'][0] - 160.5) / 300, (records['v'][0] - 120.5) / 300, 1.0])  # u, v count from the edge
    got = [float(records[name][0]) for name in ('bearing_x', 'bearing_y', 'bearing_z')]
    np.testing.assert_allclose(got, ray / math.sqrt(ray @ ray), atol=1e-5)


def test_parameters_tell_unit_range_and_meaning(peer, start):
    start('ego_motion', *small())
    asked = ['ego_motion.forward_backward_px', 'ego_motion.max_corners', 'ego_motion.smoothing']
    answer = peer.call(DescribeParameters, '/ego_motion/describe_parameters', names=asked)
    error, corners, smoothing = answer.descriptors
    assert error.type == ParameterType.PARAMETER_DOUBLE
    assert (error.floating_point_range[0].from_value, error.floating_point_range[0].to_value) == (0.01, 10.0)
    assert '[px]' in error.description
    assert (corners.integer_range[0].from_value, corners.integer_range[0].to_value) == (48, 5000)
    assert 'kalman' in smoothing.additional_constraints


@pytest.mark.parametrize(('rectified', 'focal'), [('false', 300.0), ('true', 200.0)])
def test_calibration_is_that_of_the_images_as_they_are(peer, start, tmp_path, rectified, focal):
    start('pipeline', *small(f'rectified:={rectified}'))
    answers = peer.subscribe(PointCloud2, 'detections')
    publisher, infos = peer.advertise(Image, 'image_raw'), peer.advertise(CameraInfo, 'camera_info')
    assert ready(peer, 'image_raw')
    assert ready(peer, 'camera_info')
    infos.publish(CameraInfo(
        width=320, height=240, distortion_model='plumb_bob', d=[0.1, 0.0, 0.0, 0.0, 0.0],
        k=[300.0, 0.0, 160.0, 0.0, 300.0, 120.0, 0.0, 0.0, 1.0],
        p=[200.0, 0.0, 160.0, 0.0, 0.0, 200.0, 120.0, 0.0, 0.0, 0.0, 1.0, 0.0]))
    play(peer, publisher, answers, range(FRAMES))
    record, = read_detections(answers[-1])
    ray = np.array([record[f'bearing_{axis}'] for axis in 'xyz'], float)
    lens = (0.1, 0.0, 0.0, 0.0, 0.0) if rectified == 'false' else None
    matrix = np.array([[focal, 0.0, 160.0], [0.0, focal, 120.0], [0.0, 0.0, 1.0]])
    pixel, _ = cv2.projectPoints(ray.reshape(1, 1, 3), np.zeros(3), np.zeros(3), matrix, lens and np.array(lens))
    assert pixel.ravel() + 0.5 == pytest.approx([record['u'], record['v']], abs=1e-2)


@pytest.mark.parametrize('stop', [signal.SIGINT, signal.SIGTERM], ids=['SIGINT', 'SIGTERM'])
def test_clean_end_while_kernels_are_compiled(peer, start, stop, tmp_path, monkeypatch):
    cold = tmp_path / 'cold'
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(cold))
    process = start('art2_clustering')
    # its name alone may be that of a node of an earlier test, of which the end is still under way
    assert peer.until(lambda: 'art2_clustering' in peer.node.get_node_names() and any(cold.rglob('*.nbi')))
    process.send_signal(stop)
    assert process.wait(TIMEOUT_S) == 0
