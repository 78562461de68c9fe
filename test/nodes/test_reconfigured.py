"""Settings, calibration and lifecycle that change while a node works: what holds on, and what is forgotten."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from peers import PATIENT, Peer, found_each_other, picture, ready, set_parameters, small
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, Imu, PointCloud2
from std_srvs.srv import Trigger
from test_load import GRID_PX, SLOW_S, WIDTH, Graph, reported_while_publishing
from test_load_watch import a_second
from test_stage_nodes import change

from motion_detect_ros.bridge import stage_node
from motion_detect_ros.bridge.images import header_of, image_to_msg, stamp_ns
from motion_detect_ros.bridge.records import ego_from_msg, read_detections
from motion_detect_ros.core.types import EgoStatus
from motion_detect_ros.nodes.ego_motion import EgoMotionNode
from motion_detect_ros.nodes.pipeline import PipelineNode

pytestmark = pytest.mark.messages

K = [300.0, 0.0, 160.0, 0.0, 300.0, 120.0, 0.0, 0.0, 1.0]
CALIBRATED, UNCALIBRATED = CameraInfo(width=320, height=240, k=K), CameraInfo(width=320, height=240)
STAGES = ('ego_motion', 'optical_flow', 'art2_clustering')
PERIOD_NS, IMU_PERIOD_NS = 100_000_000, 10_000_000
TRANSITIONS = (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP, Transition.TRANSITION_CONFIGURE,
               Transition.TRANSITION_ACTIVATE)


def as_if_just_made(peer: Peer, node: str) -> None:
    for transition in TRANSITIONS:
        change(peer, node, transition)


def test_three_nodes_work_with_another_grid_of_the_flow(peer, start):
    for node in STAGES:
        start(node, *small('optical_flow.grid_px:=8', *PATIENT))
    answers, reports = peer.subscribe(PointCloud2, 'detections'), peer.subscribe(DiagnosticArray, '/diagnostics')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw', len(STAGES))
    found_each_other(peer, STAGES, reports, answers, lambda number: publisher.publish(
        image_to_msg(picture(number % 20), header_of((number + 1) * PERIOD_NS, 'front'))))
    answers.clear()
    for index in range(40):
        publisher.publish(image_to_msg(picture(index % 20), header_of(10 ** 12 + index * PERIOD_NS, 'front')))
    assert peer.until(lambda: len(answers) == 40, 60.0)
    assert any(len(read_detections(message)) for message in answers)


def test_the_gyroscope_goes_on_after_history_was_cleared(peer, start):
    start('ego_motion', *small('imu.use:=true'))
    answers = peer.subscribe(PointCloud2, 'ego_motion')
    images, rates, infos = (peer.advertise(kind, name) for kind, name in (
        (Image, 'image_raw'), (Imu, 'imu'), (CameraInfo, 'camera_info')))
    for topic in ('image_raw', 'imu', 'camera_info'):
        assert ready(peer, topic)
    infos.publish(CALIBRATED)
    peer.rest(0.3)
    blank = np.full((240, 320), 90, np.uint8)

    def statuses(indexes: range) -> list[EgoStatus]:
        """Pictures without texture: their motion is known by the rates alone."""
        answers.clear()
        for index in indexes:
            stamp = (index + 1) * PERIOD_NS
            for sample in range(stamp - 12 * IMU_PERIOD_NS, stamp + 3 * IMU_PERIOD_NS, IMU_PERIOD_NS):
                message = Imu(header=header_of(sample, 'imu'))
                message.angular_velocity.y = 0.3
                rates.publish(message)
            peer.rest(0.1)
            images.publish(image_to_msg(blank, header_of(stamp, 'front')))
            assert peer.until(lambda index=index: len(answers) > index - indexes.start)
        return [ego_from_msg(message).status for message in answers]

    assert statuses(range(6))[1:] == [EgoStatus.OK] * 5
    assert set_parameters(peer, 'ego_motion', ego_motion__model='homography') == ['']
    assert statuses(range(6, 12))[1:] == [EgoStatus.OK] * 5


def test_a_calibration_from_before_is_not_used_once_history_is_cleared(peer, start):
    start('pipeline', *small('queue_size:=1000'))
    answers, reports = peer.subscribe(PointCloud2, 'detections'), peer.subscribe(DiagnosticArray, '/diagnostics')
    publisher, infos = peer.advertise(Image, 'image_raw'), peer.advertise(CameraInfo, 'camera_info')
    assert ready(peer, 'image_raw')
    assert ready(peer, 'camera_info')
    shown = 0

    def bearings(info: CameraInfo | None) -> tuple[list[bool], str]:
        """Whether they are known of what the last five of 14 pictures show, and what the node says of it."""
        nonlocal shown
        if info is not None:
            infos.publish(info)
            peer.rest(0.3)
        answers.clear()
        for index in range(14):
            shown += 1
            publisher.publish(image_to_msg(picture(index), header_of(shown * PERIOD_NS, 'front')))
            assert peer.until(lambda index=index: len(answers) > index)
        seen = len(reports)
        assert peer.until(lambda: len(reports) > seen + 1)
        values = {pair.key: pair.value for pair in reports[-1].status[0].values}
        found = [record for message in answers[-5:] for record in read_detections(message)]
        assert found
        return [bool(np.isfinite(record['bearing_z'])) for record in found], values['calibration'].split()[0]

    known, state = bearings(CALIBRATED)
    assert (all(known), state) == (True, 'used')
    assert set_parameters(peer, 'pipeline', optical_flow__baseline_s=0.1) == ['']
    known, state = bearings(UNCALIBRATED)
    assert (any(known), state) == (False, 'refused')
    known, state = bearings(CALIBRATED)
    assert (all(known), state) == (True, 'used')
    as_if_just_made(peer, 'pipeline')
    assert ready(peer, 'image_raw')
    known, state = bearings(None)
    assert (any(known), state) == (False, 'none')


@pytest.fixture
def overloaded(peer, start) -> tuple[Callable[[int], list[Any]], list[Any]]:
    """A node that leaves images out, as it has had several times too many: shows it images slowly and returns its
    answers; its reports.
    """
    start('pipeline', '-p', 'load.adapt:=true', '-p', 'queue_size:=1', '-p', 'trajectories.use:=true',
          '-p', 'preprocessing.min_width_px:=640', '-p', 'preprocessing.max_width_px:=640')
    publisher, answers = peer.advertise(Image, 'image_raw'), peer.subscribe(PointCloud2, 'detections')
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    assert ready(peer, 'image_raw')
    index = reported_while_publishing(peer, publisher, reports, '1 image of', 0.002)
    assert index

    def show(count: int) -> list[Any]:
        nonlocal index
        assert ready(peer, 'image_raw')
        answers.clear()
        for _ in range(count):
            index += 1
            publisher.publish(image_to_msg(picture(index % 40), header_of(PERIOD_NS * index, 'front')))
            peer.rest(0.3)
        return answers

    return show, reports


def test_less_work_goes_on_after_a_setting(peer, overloaded):
    show, reports = overloaded
    show(5)
    assert set_parameters(peer, 'pipeline', tracks__coast_s=0.2) == ['']
    reports.clear()
    show(6)
    assert reports and all('load reduced' in each.status[0].message for each in reports)


def test_less_work_ends_with_a_clean_up(peer, overloaded):
    show, _ = overloaded
    as_if_just_made(peer, 'pipeline')
    assert len(show(9)) == 9


def test_separate_stages_do_all_of_the_work_once_the_first_may_not_do_less(peer, start):
    """A stage that is made anew goes on at the step of the images; the setting of the others does not count."""
    graph = Graph(peer, start, 'load.adapt:=true', *PATIENT)
    assert graph.overload()
    assert graph.settled()
    for node in ('optical_flow', 'art2_clustering'):
        as_if_just_made(peer, node)
    graph.await_stages()
    reduced = graph.index
    assert graph.steps[reduced] > 0
    assert graph.widths[reduced] < WIDTH // GRID_PX and reduced in graph.detections
    assert set_parameters(peer, 'ego_motion', load__adapt=False) == ['']
    graph.publish(10, SLOW_S)
    assert graph.settled()
    after = range(reduced + 1, graph.index + 1)
    assert [graph.steps[index] for index in after] == [0] * len(after)
    assert [graph.widths[index] for index in after] == [WIDTH // GRID_PX] * len(after)
    assert set(after) <= set(graph.detections)


def test_images_that_are_left_out_by_a_setting_leave_time_for_the_others(here):
    """A camera of 30 Hz of which every third image is used, at 50 ms each: half of the time is left."""
    node = here(PipelineNode, 'load.adapt:=true', 'load.decimation_of:=3', 'preprocessing.max_width_px:=320')
    for second in range(1, 9):
        a_second(node, second, 50.0)
        assert node.condition().concern == ''
    a_second(node, 9, 150.0)
    assert 'load reduced' in node.condition().concern


def test_work_from_before_a_clean_up_is_no_load_after_it(here):
    node = here(PipelineNode, 'load.adapt:=true', 'preprocessing.max_width_px:=320')
    for _ in range(10):
        node._load.add(200.0)
    for transition in (node.trigger_deactivate, node.trigger_cleanup, node.trigger_configure, node.trigger_activate):
        transition()
    node._load.look(time.monotonic() + 1.0, 30)
    assert node.active and node.condition().concern == ''


def test_a_stage_warms_up_no_more_kernels_for_other_settings_than_it_needs(here, monkeypatch):
    node = here(EgoMotionNode, 'preprocessing.max_width_px:=320')
    asked: list[bool] = []
    monkeypatch.setattr(stage_node, 'warm_up_ahead', lambda _config, detects, _tell: asked.append(detects))
    assert node.set_parameters([Parameter('ego_motion.model', value='homography')])[0].successful
    assert asked == [False]


def test_a_reset_forgets_how_bright_samples_of_16_bits_were(peer, start):
    """After one sample of 65535 all that a sensor of 12 bits shows is a sixteenth as bright."""
    start('pipeline', *small())
    egos, publisher = peer.subscribe(PointCloud2, 'ego_motion'), peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')

    def tracks(indexes: range, largest: int = 4095) -> int:
        egos.clear()
        for index in indexes:
            samples = picture(index)[..., 0].astype(np.uint16)  # of a dark scene
            samples[0, 0] = largest
            message = Image(header=header_of((index + 1) * PERIOD_NS, 'front'), height=240, width=320, step=640,
                            encoding='mono16', data=samples.tobytes())
            publisher.publish(message)
            assert peer.until(lambda index=index: len(egos) > index - indexes.start)
        assert stamp_ns(egos[-1].header) == indexes.stop * PERIOD_NS
        return ego_from_msg(egos[-1]).tracks

    before = tracks(range(4))
    tracks(range(4, 5), 65535)
    assert tracks(range(5, 9)) < 0.5 * before
    assert peer.call(Trigger, '/pipeline/reset').success
    assert tracks(range(9, 13)) > 0.9 * before
