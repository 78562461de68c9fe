"""The overlay's other faces: markers, and pictures on compressed images."""

from __future__ import annotations

import cv2
import numpy as np
from peers import image_message, picture, ready
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from motion_detect_ros.bridge.images import flow_to_msg, header_of, image_from_msg, image_to_msg, stamp_ns
from motion_detect_ros.bridge.records import detections_to_msg
from motion_detect_ros.core.types import FlowField, empty_detections
from motion_detect_ros.nodes.overlay import OverlayNode


def seen(stamp: int, *ids: int, bearing: float = 1.0) -> PointCloud2:
    """Objects straight ahead."""
    records = empty_detections(len(ids))
    records['u'], records['v'], records['width'], records['height'] = 100, 80, 60, 40
    records['id'], records['bearing_z'] = ids, bearing
    records['bearing_x'] = records['bearing_y'] = 0.0 * bearing
    return detections_to_msg(records, header_of(stamp, 'front'))


def test_markers_need_no_images_and_go_with_their_objects(peer, start):
    start('overlay')
    boxes = peer.advertise(PointCloud2, 'detections')
    shown = peer.subscribe(MarkerArray, '/overlay/markers')
    assert ready(peer, 'detections')
    assert peer.node.count_subscribers('image_raw') == 0
    for message in (seen(1, 3, 4), seen(2, 4), seen(3, 4, bearing=np.nan)):
        boxes.publish(message)
    assert peer.until(lambda: len(shown) == 3)
    actions = [{(marker.action, marker.id) for marker in message.markers} for message in shown]
    assert actions == [{(Marker.ADD, 3), (Marker.ADD, 4)}, {(Marker.ADD, 4), (Marker.DELETE, 3)}, {(Marker.DELETE, 4)}]
    assert {marker.header.frame_id for marker in shown[0].markers} == {'front'}
    assert stamp_ns(shown[0].markers[0].header) == 1


def test_compressed_images_are_drawn_on(peer, start):
    start('overlay', '-p', 'image_transport:=compressed')
    publisher = peer.advertise(CompressedImage, 'image_raw/compressed')
    boxes = peer.advertise(PointCloud2, 'detections')
    drawn = peer.subscribe(Image, '/overlay/overlay')
    assert ready(peer, 'image_raw/compressed')
    assert ready(peer, 'detections')
    assert peer.node.count_subscribers('image_raw') == 0
    header = image_message(0).header
    _, png = cv2.imencode('.png', picture(0))
    publisher.publish(CompressedImage(header=header, format='png', data=png.tobytes()))
    boxes.publish(seen(stamp_ns(header)))
    assert peer.until(lambda: drawn)
    assert drawn[0].header == header
    np.testing.assert_array_equal(image_from_msg(drawn[0]), picture(0))


def test_flow_is_drawn_where_it_was_measured(peer, start):
    """Between two flows (``optical_flow.every_s``) the messages hold none."""
    start('overlay')
    flows, drawn = peer.advertise(Image, 'flow'), peer.subscribe(Image, '/overlay/flow')
    assert ready(peer, 'flow')

    def publish(stamp: int, value: float) -> None:
        flow = np.full((12, 16, 2), value, np.float32)
        flows.publish(flow_to_msg(FlowField(flow, 64, 48, stamp), header_of(stamp, 'front')))

    publish(1, 3.0)
    assert peer.until(lambda: len(drawn) == 1)
    publish(2, np.nan)
    peer.rest(1.0)
    publish(3, 3.0)
    assert peer.until(lambda: len(drawn) == 2)
    assert [stamp_ns(message.header) for message in drawn] == [1, 3]


def test_images_that_the_detector_leaves_out_are_not_dropped_by_the_overlay(here):
    """One of three is answered; of one the image is lost instead."""
    node = here(OverlayNode)
    for index in range(30):
        stamp = (index + 1) * 10**8
        if index != 15:
            node._join_with('image', image_to_msg(picture(0), header_of(stamp, 'front')))
        if index % 3 == 0:
            node._join_with('detections', seen(stamp))
    summary = node.stats.summary(1)
    assert (summary.left_out, summary.dropped, summary.errors) == (18, 1, 0)
