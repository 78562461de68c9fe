"""Bearings follow the calibration of these very images, or are unknown, and the diagnostics say why."""

from __future__ import annotations

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from peers import image_message, ready, small
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from motion_detect_ros.bridge.records import read_detections

K = [300.0, 0.0, 160.0, 0.0, 300.0, 120.0, 0.0, 0.0, 1.0]
NAN_K = [float('nan')] * 9
FRAMES = 30
CASES = {
    'none': (None, 'none', 'no camera_info: bearings are NaN'),
    'its own': (CameraInfo(width=320, height=240, k=K), 'used', ''),
    'without a size': (CameraInfo(k=K), 'used', ''),
    'binned by the driver': (CameraInfo(width=640, height=480, binning_x=2, binning_y=2, k=K), 'used', ''),
    'of one pixel': (CameraInfo(width=1, height=1, k=K), 'refused (camera_info is of 1x1 px, the images of 320x240)',
                     'bearings are NaN'),
    'of other images': (CameraInfo(width=640, height=480, k=K),
                        'refused (camera_info is of 640x480 px, the images of 320x240)', 'bearings are NaN'),
    'all zero': (CameraInfo(width=320, height=240), 'refused (camera_info holds no calibration', 'bearings are NaN'),
    'not a number': (CameraInfo(width=320, height=240, k=NAN_K), 'refused (camera_info holds no calibration',
                     'bearings are NaN'),
}


@pytest.fixture
def played(peer, start, tmp_path):
    """Detections, diagnostics and output of a pipeline whose camera_info changes from case to case."""
    start('pipeline', *small('queue_size:=1000'))
    answers, reports = peer.subscribe(PointCloud2, 'detections'), peer.subscribe(DiagnosticArray, '/diagnostics')
    publisher, infos = peer.advertise(Image, 'image_raw'), peer.advertise(CameraInfo, 'camera_info')
    assert ready(peer, 'image_raw')
    assert ready(peer, 'camera_info')

    def play(info: CameraInfo | None, number: int):
        if info is not None:
            infos.publish(info)
            peer.rest(0.3)  # nothing answers a camera_info; the executor takes it long before the thirtieth image
        answers.clear()
        for index in range(FRAMES):
            image = image_message(index)
            image.header.stamp.sec += 60 * number
            publisher.publish(image)
            assert peer.until(lambda index=index: len(answers) > index)
        found = [record for message in answers[-5:] for record in read_detections(message)]
        seen = len(reports)
        assert peer.until(lambda: len(reports) > seen + 1)
        values = {pair.key: pair.value for pair in reports[-1].status[0].values}
        return found, values['calibration'], (tmp_path / 'pipeline.log').read_text()

    return play


def test_bearings_and_what_is_said_of_the_calibration(played, shown):
    for number, (name, (info, state, warning)) in enumerate(CASES.items()):
        found, said, printed = played(info, number)
        assert found, name
        assert said.startswith(state), (name, said)
        assert warning in printed, name
        known = np.isfinite([record['bearing_z'] for record in found])
        assert known.all() if state == 'used' else not known.any(), name
    # 'not a number' comes after 'all zero' and has the same reason.
    assert printed.count('bearings are NaN') == sum(bool(warning) for _, _, warning in CASES.values()) - 1
    shown('camera_info of another size, all zero, not a number, or none',
          'bearings are NaN, one warning, `calibration` in the diagnostics says why', f'{len(CASES)} cases')
