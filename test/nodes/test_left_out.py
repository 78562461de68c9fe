"""Images that the first stage leaves out on purpose count as left out behind it, too, however late the stages are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from peers import picture

from motion_detect_ros.bridge import sync
from motion_detect_ros.bridge.images import flow_to_msg, header_of, image_to_msg
from motion_detect_ros.bridge.records import ego_to_msg
from motion_detect_ros.core.types import EgoMotion, EgoStatus, FlowField
from motion_detect_ros.nodes.art2_clustering import Art2ClusteringNode
from motion_detect_ros.nodes.ego_motion import EgoMotionNode
from motion_detect_ros.nodes.optical_flow import OpticalFlowNode

PERIOD_NS = 100_000_000
SMALL = ('load.adapt:=true', 'preprocessing.max_width_px:=320', 'queue_size:=100')


def show(node: Any, index: int, step: int | None) -> None:
    """Image ``index`` reaches a stage, and what the stages before it made of it at this step; None = nothing."""
    stamp_ns = PERIOD_NS * (index + 1)
    header = header_of(stamp_ns, 'front')
    node._on_input('image', image_to_msg(picture(index), header))
    if step is None:
        return
    motion = EgoMotion(np.eye(3), np.eye(6), EgoStatus.OK, stamp_ns, stamp_ns - PERIOD_NS, load_step=step)
    node._on_input('ego_motion', ego_to_msg(motion, header))
    if isinstance(node, Art2ClusteringNode):
        node._on_input('flow', flow_to_msg(FlowField(np.zeros((60, 80, 2), np.float32), 80, 60, stamp_ns), header))


def counted(node: Any) -> tuple[int, int]:
    """Left out on purpose, and dropped."""
    summary = node.stats.summary(1)
    return summary.left_out, summary.dropped


@pytest.mark.parametrize('kind', [OpticalFlowNode, Art2ClusteringNode])
@pytest.mark.parametrize(('steps', 'left_out', 'dropped'), [
    ((0, 3, None, 3, None, 3, None, 3), 3, 0),              # 1 image of 2
    ((0, 4, None, None, 4, None, None, 4), 4, 0),           # 1 of 3
    ((4, None, None, 0, 0, 0), 2, 0),                       # the last ones of the step before
    ((0, None, 3, None, 3), 2, 0),                          # the step counts from the image that brings it on
    ((0, None, 0, 0), 0, 1),                                # at full work none is left out on purpose
    ((3, None, None, None, 3, None, 3), 3, 1),              # of three in a row one was to be worked on
    ((4, None, None, None, None, None, None, None, None, 4), 6, 2),
])
def test_while_the_stage_is_busy(
    here: Any, kind: type, steps: tuple[int | None, ...], left_out: int, dropped: int,
) -> None:
    """Nothing is worked on meanwhile, so the stage itself is not yet at the step of what comes."""
    node = here(kind, *SMALL)
    with node._busy:
        for index, step in enumerate(steps):
            show(node, index, step)
        assert counted(node) == (left_out, dropped)


def test_settings_leave_out_too(here: Any) -> None:
    """The first 2 of 5."""
    node = here(OpticalFlowNode, *SMALL, 'load.decimation_keep:=2', 'load.decimation_of:=5')
    with node._busy:
        for index in range(16):
            show(node, index, 0 if index % 5 < 2 else None)
        assert counted(node) == (9, 0)


def test_nothing_from_the_first_stage_for_long_is_no_purpose(here: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """At 1 image of 3, so many without an ego-motion that the join gives up the oldest: a third of them is missing."""
    monkeypatch.setattr(sync, 'ROOM_BYTES', 0)  # as of pictures that fill it
    node = here(OpticalFlowNode, 'load.adapt:=true', 'queue_size:=1')  # ten wait
    with node._busy:
        show(node, 0, 4)
        for index in range(1, 20):
            show(node, index, None)
        assert counted(node) == (6, 3)
        show(node, 20, 4)
        assert counted(node) == (13, 6)


def test_an_image_that_came_and_its_flow_did_not_is_dropped(here: Any) -> None:
    node = here(Art2ClusteringNode, *SMALL)
    with node._busy:
        show(node, 0, 3)
        stamp_ns = PERIOD_NS * 3
        header = header_of(stamp_ns, 'front')
        show(node, 1, None)
        node._on_input('image', image_to_msg(picture(2), header))
        node._on_input('ego_motion', ego_to_msg(
            EgoMotion(np.eye(3), np.eye(6), EgoStatus.OK, stamp_ns, PERIOD_NS, load_step=3), header))
        show(node, 3, None)
        show(node, 4, 3)
        assert counted(node) == (2, 1)


def test_the_first_stage_counts_what_it_leaves_out(here: Any) -> None:
    node = here(EgoMotionNode, *SMALL, 'load.decimation_keep:=1', 'load.decimation_of:=3')
    for index in range(9):
        show(node, index, None)
    assert counted(node) == (6, 0)
    values = {pair.key: pair.value for pair in node._reporter.report(
        1, node.condition(), header_of(1, '').stamp, node.extra_diagnostics()).status[0].values}
    assert (values['received'], values['left_out'], values['dropped']) == ('9', '6', '0')
