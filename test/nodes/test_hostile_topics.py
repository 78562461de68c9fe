"""What a subscriber does with detections that nobody of ours sends."""

from __future__ import annotations

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import image_message, ready
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from motion_detect_ros.bridge.records import detections_to_msg
from motion_detect_ros.core.types import DETECTION_DTYPE

OBJECTS = 10_000


def many(header) -> PointCloud2:
    """Ten thousand objects, every tenth with values that are none."""
    records = np.zeros(OBJECTS, DETECTION_DTYPE)
    records['id'] = np.arange(1, OBJECTS + 1)
    for name in ('u', 'v', 'width', 'height', 'score', 'bearing_z'):
        records[name] = 20.0
    for name in ('u', 'width', 'vel_u', 'ttc', 'bearing_z'):
        records[name][::10] = [np.nan, np.inf, -np.inf, 1e38, -1e38] * (OBJECTS // 50)
    return detections_to_msg(records, header)


def test_overlay_survives_them_names_them_and_goes_on(peer, start, shown):
    start('overlay')
    images, detections = peer.advertise(Image, 'image_raw'), peer.advertise(PointCloud2, 'detections')
    drawn, markers = peer.subscribe(Image, 'overlay/overlay'), peer.subscribe(MarkerArray, 'overlay/markers')
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    assert ready(peer, 'image_raw')
    assert ready(peer, 'detections')

    def warned() -> str:
        return next((status.message for report in reports for status in report.status
                     if status.level == DiagnosticStatus.WARN and 'records: expected fields' in status.message), '')

    sent = 0

    def show(message: PointCloud2) -> None:
        nonlocal sent
        sent += 1
        image = image_message(sent)
        message.header = image.header
        images.publish(image)
        detections.publish(message)

    def until(condition, message) -> bool:
        def tried() -> object:
            show(message())
            peer.rest(0.2)
            return condition()

        return peer.until(tried)

    assert until(lambda: len(markers) > 1 and len(drawn) > 1, lambda: many(image_message(0).header))
    wrong = PointCloud2(height=1, width=3, point_step=4, row_step=12, data=bytes(12))
    assert until(warned, lambda: wrong)
    before = len(drawn)
    empty = detections_to_msg(np.zeros(0, DETECTION_DTYPE), image_message(0).header)
    assert until(lambda: len(drawn) > before + 2, lambda: empty)
    shown('detections of 10,000 objects, with infinite values, and with wrong fields',
          'overlay draws what it can, names what it cannot (WARN), goes on', 'drawn, named')
