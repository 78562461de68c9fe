"""The camera's motion in space, over DDS."""

from __future__ import annotations

import numpy as np
from peers import ready, small
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from motion_detect_ros.bridge.images import header_of, image_to_msg
from motion_detect_ros.bridge.records import ego_from_msg


def shelves(index: int) -> np.ndarray:
    """Four depths, passed sideways: each moves left by a whole number of pixels a frame."""
    picture = np.zeros((240, 320), np.uint8)
    for row, step in zip(range(0, 240, 60), (1, 3, 6, 10), strict=True):
        texture = np.random.default_rng(step).integers(0, 256, (12, 100), np.uint8)
        picture[row:row + 60] = np.kron(texture, np.ones((5, 5), np.uint8))[:, step * index:step * index + 320]
    return np.repeat(picture[:, :, None], 3, axis=2)


def test_a_camera_that_goes_right_is_measured_so(peer, start):
    start('ego_motion', *small('ego_motion.relative_pose:=true'))
    answers = peer.subscribe(PointCloud2, 'ego_motion')
    images, infos = peer.advertise(Image, 'image_raw'), peer.advertise(CameraInfo, 'camera_info')
    assert ready(peer, 'image_raw')
    assert ready(peer, 'camera_info')
    infos.publish(CameraInfo(width=320, height=240, k=[300.0, 0.0, 159.5, 0.0, 300.0, 119.5, 0.0, 0.0, 1.0]))
    for index in range(3):
        images.publish(image_to_msg(shelves(index), header_of((index + 1) * 50_000_000, 'front')))
        assert peer.until(lambda index=index: len(answers) > index)
    assert ego_from_msg(answers[0]).camera is None
    camera = ego_from_msg(answers[-1]).camera
    assert camera.direction[0] < -0.99  # static points go left
    np.testing.assert_allclose(camera.rotation, np.eye(3), atol=0.01)
