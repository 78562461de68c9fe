"""Which step follows from what the stages say they took for an image."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from peers import Peer, picture, ready, set_parameters, small
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge.images import header_of, image_to_msg, stamp_ns
from motion_detect_ros.bridge.load import Stage, StageTime, load_from_msg, load_to_msg
from motion_detect_ros.bridge.records import ego_to_msg
from motion_detect_ros.core.types import EgoMotion, EgoStatus
from motion_detect_ros.nodes.ego_motion import EgoMotionNode

ADAPT = ('load.adapt:=true', 'preprocessing.max_width_px:=320')
RATE_HZ, PERIOD_NS = 30, 100_000_000


def tell(node: Any, stage: Stage, compute_ms: float, step: int) -> None:
    node._load._on_load(load_to_msg(StageTime(stage, compute_ms, step), header_of(1, 'front')))


def a_second(node: Any, number: int, own_ms: float, **told: tuple[float, int]) -> None:
    """The ``number``-th second, from 1 on, in which 30 images came; told: time and step of the other stages."""
    if number == 1:
        node.start_s = time.monotonic()
        node._load.look(node.start_s, 0)
    for _ in range(5):
        node._load.add(own_ms)
        for name, (compute_ms, step) in told.items():
            tell(node, Stage[name.upper()], compute_ms, step)
    node._load.look(node.start_s + number, RATE_HZ * number)


def test_the_slowest_stage_decides(here):
    """80 ms an image of 33: 2.4 times too long, and 0.82 at half the width and one image of two."""
    node = here(EgoMotionNode, *ADAPT)
    a_second(node, 1, 5.0, optical_flow=(80.0, 0), art2_clustering=(20.0, 0))
    assert node.load_step == 3
    assert node.condition().concern == 'load reduced: 50% of the working width, 1 image of 2'
    assert ('load_cost', '0.34') in node.extra_diagnostics()


def test_stages_in_processes_of_their_own_work_at_once(here):
    """Each of three has the whole period, 33 ms."""
    node = here(EgoMotionNode, *ADAPT)
    for second in range(1, 9):
        a_second(node, second, 25.0, optical_flow=(25.0, 0), art2_clustering=(25.0, 0))
        assert node.load_step == 0


def test_what_comes_late_of_images_before_a_change_does_not_count(here):
    """The flow works off what had piled up; there is room for more work only as far as it tells of the new step."""
    node = here(EgoMotionNode, *ADAPT)
    a_second(node, 1, 5.0, optical_flow=(80.0, 0))
    for second in range(2, 10):
        a_second(node, second, 5.0, optical_flow=(80.0, 0))
        assert node.load_step == 3
    steps = []
    for second in range(10, 14):
        a_second(node, second, 5.0, optical_flow=(12.0, 3))
        steps.append(node.load_step)
    assert steps == [3, 3, 2, 2]


def test_a_stage_that_has_gone_is_not_waited_for(here):
    node = here(EgoMotionNode, *ADAPT)
    a_second(node, 1, 5.0, optical_flow=(80.0, 0))
    for second in range(2, 20):
        a_second(node, second, 5.0)
    assert node.load_step == 0


def test_a_pause_of_the_images_is_no_time_to_spare(here):
    """Where nothing comes nothing is decided, and the first images after it are not spread over it."""
    node = here(EgoMotionNode, *ADAPT)
    a_second(node, 1, 80.0)
    assert node.load_step == 3
    for quiet in range(2, 60):
        node._load.look(node.start_s + quiet, RATE_HZ)
    for _ in range(5):
        node._load.add(40.0)
    for second in range(60, 70):
        node._load.add(60.0)  # of 67 at one image of two
        node._load.look(node.start_s + second, RATE_HZ * (second - 58))
        assert node.load_step == 3


def test_full_work_again_without_the_setting(here):
    node = here(EgoMotionNode, *ADAPT)
    a_second(node, 1, 80.0)
    assert node.load_step == 3
    assert node.set_parameters([Parameter('load.adapt', value=False)])[0].successful
    assert (node.load_step, node.condition().concern) == (0, '')
    a_second(node, 1, 80.0)
    assert node.load_step == 0


def test_a_threshold_keeps_the_step_and_another_resolution_ends_it(here):
    node = here(EgoMotionNode, *ADAPT)
    a_second(node, 1, 80.0)
    assert node.set_parameters([Parameter('ego_motion.max_corners', value=500)])[0].successful
    assert node.load_step == 3 and node._decimation.active
    assert node.set_parameters([Parameter('preprocessing.max_width_px', value=256)])[0].successful
    assert node.load_step == 0 and not node._decimation.active


def test_a_time_that_is_none_costs_itself(here):
    node = here(EgoMotionNode, *ADAPT)
    a_second(node, 1, 5.0)
    tell(node, Stage.OPTICAL_FLOW, float('nan'), 0)
    assert node.stats.summary(1).last_error == '/load: load: expected compute_ms of at least 0, got nan'
    a_second(node, 2, 80.0)
    assert node.load_step == 3


@pytest.fixture
def flow_of(peer: Peer, start) -> Any:
    """``flow_of(index, load_step)``: size of the flow of an image that comes with such an ego-motion, None = none."""
    start('optical_flow', *small('load.adapt:=true'))
    images, egos = peer.advertise(Image, 'image_raw'), peer.advertise(PointCloud2, 'ego_motion')
    flows, times = peer.subscribe(Image, 'flow'), peer.subscribe(PointCloud2, 'load')
    assert ready(peer, 'image_raw') and ready(peer, 'ego_motion')

    def show(index: int, load_step: int) -> tuple[int, int] | None:
        stamp = PERIOD_NS * (index + 1)
        motion = EgoMotion(np.array([[1.0, 0.0, -2.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.eye(6), EgoStatus.OK,
                           stamp, stamp - PERIOD_NS, load_step=load_step)
        flows.clear()
        times.clear()
        egos.publish(ego_to_msg(motion, header_of(stamp, 'front')))
        images.publish(image_to_msg(picture(index), header_of(stamp, 'front')))
        if load_step > 4:
            peer.rest(1.0)
            return None if not flows else (flows[0].width, flows[0].height)
        assert peer.until(lambda: flows and times)
        assert [stamp_ns(message.header) for message in (*flows, *times)] == [stamp, stamp]
        told = load_from_msg(times[0])
        assert (told.stage, told.load_step) == (Stage.OPTICAL_FLOW, load_step)
        assert told.compute_ms > 0.0
        return flows[0].width, flows[0].height

    return show


def test_the_flow_has_the_cells_of_the_step_that_came_with_the_image(peer: Peer, flow_of):
    """Cells of 4 pixels of images of 320x240, 240x180 and 160x120."""
    sizes = [flow_of(index, step) for index, step in enumerate((0, 1, 4, 2, 3, 0))]
    assert sizes == [(80, 60), (60, 45), (40, 30), (40, 30), (40, 30), (80, 60)]


def test_a_new_start_of_the_flow_keeps_the_step_of_the_images(peer: Peer, flow_of):
    assert flow_of(0, 2) == (40, 30)
    assert set_parameters(peer, 'optical_flow', optical_flow__baseline_s=0.1) == ['']
    assert flow_of(1, 2) == (40, 30)


def test_an_image_of_an_unknown_step_costs_itself(peer: Peer, flow_of):
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    assert flow_of(0, 0) == (80, 60)
    assert flow_of(1, 9) is None
    assert flow_of(2, 0) == (80, 60)
    reports.clear()
    assert peer.until(lambda: reports)
    values = {pair.key: pair.value for pair in reports[0].status[0].values}
    assert values['last_error'] == '/ego_motion: ego_motion: expected load_step 0 to 4, got 9'
