"""Rays for RViz: where they point, what their labels are, and that they go away."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from motion_detect_ros.bridge.markers import MarkerWriter
from motion_detect_ros.core.types import empty_detections

HEADER = Header(frame_id='eye')


def objects(*ids: int, ttc: float = np.nan) -> np.ndarray:
    """Straight ahead, one to the right of it (3-4-5 triangle)."""
    records = empty_detections(len(ids))
    records['id'], records['ttc'] = ids, ttc
    records['bearing_x'], records['bearing_y'], records['bearing_z'] = 0.6, 0.0, 0.8
    return records


def summary(message: MarkerArray) -> list[tuple[int, str, int]]:
    return [(marker.action, marker.ns, marker.id) for marker in message.markers]


def test_a_ray_of_one_metre_along_the_bearing_with_its_label():
    message = MarkerWriter().message(objects(7, ttc=2.34), HEADER)
    arrow, label = message.markers
    assert summary(message) == [(Marker.ADD, 'bearing', 7), (Marker.ADD, 'label', 7)]
    assert (arrow.type, label.type) == (Marker.ARROW, Marker.TEXT_VIEW_FACING)
    start, tip = arrow.points
    assert (start.x, start.y, start.z) == (0.0, 0.0, 0.0)
    assert (tip.x, tip.y, tip.z) == pytest.approx((0.6, 0.0, 0.8))
    assert label.text == '7: 2.3 s'
    assert label.pose.position.z > tip.z  # behind the tip, not on it
    assert arrow.pose.orientation.w == 1.0
    assert arrow.color.a == label.color.a == 1.0
    assert arrow.header == label.header == HEADER


def test_labels_show_an_id_as_the_picture_does_and_markers_have_all_of_it():
    """Node ids have nine digits; the overlay's picture shows five."""
    arrow, label = MarkerWriter().message(objects(284853544, ttc=2.34), HEADER).markers
    assert label.text == '53544: 2.3 s'
    assert (arrow.id, label.id) == (284853544, 284853544)


@pytest.mark.parametrize('ttc', [np.nan, np.inf])
def test_unknown_and_endless_times_are_not_written(ttc: float):
    assert MarkerWriter().message(objects(7, ttc=ttc), HEADER).markers[1].text == '7'


def test_vanished_objects_are_deleted_once():
    writer = MarkerWriter()
    writer.message(objects(1, 2), HEADER)
    assert summary(writer.message(objects(2), HEADER)) == [
        (Marker.ADD, 'bearing', 2), (Marker.ADD, 'label', 2),
        (Marker.DELETE, 'bearing', 1), (Marker.DELETE, 'label', 1)]
    assert summary(writer.message(objects(2), HEADER)) == [(Marker.ADD, 'bearing', 2), (Marker.ADD, 'label', 2)]
    writer.clear()
    assert summary(writer.message(objects(), HEADER)) == []


def test_without_calibration_there_are_no_rays():
    assert MarkerWriter().message(empty_detections(2), HEADER).markers == []


def test_boxes_stand_across_the_axis_at_the_distance_asked_for():
    """100 x 60 px around a point 150 px right of the principal one, by a lens of 300 px: at 3 m 1 m x 0.6 m."""
    records = objects(7)
    for name, value in {'u': 320.5 + 150.0, 'v': 240.5, 'width': 100.0, 'height': 60.0}.items():
        records[name] = value
    writer = MarkerWriter(box_distance_m=3.0)
    assert len(writer.message(records, HEADER).markers) == 2  # before there is a calibration
    writer.use_camera(CameraInfo(width=640, height=480, k=[300.0, 0, 320.0, 0, 300.0, 240.0, 0, 0, 1.0]))
    *_, box = writer.message(records, HEADER).markers
    assert (box.type, box.ns, box.header) == (Marker.LINE_STRIP, 'box', HEADER)
    assert [(point.x, point.y, point.z) for point in box.points] == [pytest.approx(corner) for corner in (
        (1.0, -0.3, 3.0), (2.0, -0.3, 3.0), (2.0, 0.3, 3.0), (1.0, 0.3, 3.0), (1.0, -0.3, 3.0))]
    assert (Marker.DELETE, 'box', 7) in summary(writer.message(objects(), HEADER))


def test_boxes_in_rectified_images_are_of_the_rectified_camera():
    """100 px around P's principal point, by its focal length of 200 px: at 1 m half a metre. K and D do not hold."""
    records = objects(7)
    records['u'], records['v'], records['width'], records['height'] = 310.5, 250.5, 100.0, 100.0
    writer = MarkerWriter(box_distance_m=1.0, rectified=True)
    writer.use_camera(CameraInfo(
        width=640, height=480, distortion_model='plumb_bob', d=[-0.3, 0.0, 0.0, 0.0, 0.0],
        k=[300.0, 0, 320.0, 0, 300.0, 240.0, 0, 0, 1.0],
        p=[200.0, 0, 310.0, 0, 0, 200.0, 250.0, 0, 0, 0, 1.0, 0]))
    *_, box = writer.message(records, HEADER).markers
    assert [(point.x, point.y) for point in box.points[:3]] == [
        pytest.approx(corner) for corner in ((-0.25, -0.25), (0.25, -0.25), (0.25, 0.25))]


def test_markers_of_a_detector_that_has_ended_vanish():
    writer = MarkerWriter(box_distance_m=1.0)
    writer.use_camera(CameraInfo(width=640, height=480, k=[300.0, 0, 320.0, 0, 300.0, 240.0, 0, 0, 1.0]))
    assert [marker.lifetime.sec for marker in writer.message(objects(7), HEADER).markers] == [2, 2, 2]


def test_ids_over_int32_fit():
    (arrow, _), = [MarkerWriter().message(objects(2**31 + 5), HEADER).markers]
    assert arrow.id == 5


@pytest.mark.parametrize(('u', 'shown'), [(420.0, True), (590.0, False)])
def test_a_box_is_shown_where_the_lens_has_rays_for_its_corners(u: float, shown: bool):
    """An ideal wide lens, r = f * angle: 90 degrees are 283 px from the axis at u = 320, the box ends at u + 20."""
    writer = MarkerWriter(box_distance_m=1.0)
    writer.use_camera(CameraInfo(width=640, height=480, distortion_model='equidistant', d=[1e-6, 0.0, 0.0, 0.0],
                                 k=[180.0, 0, 320.0, 0, 180.0, 240.0, 0, 0, 1.0]))
    records = objects(7)
    records['u'], records['v'], records['width'], records['height'] = u, 240.0, 40.0, 20.0
    assert ('box' in {marker.ns for marker in writer.message(records, HEADER).markers}) == shown
