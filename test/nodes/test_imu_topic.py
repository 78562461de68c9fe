"""Angular rates through the real nodes: as the replay feeds them, and as geometry says."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from peers import TIMEOUT_S, image_message, lossless, picture, ready, small
from rclpy.duration import Duration
from sensor_msgs.msg import Image, Imu, PointCloud2

from motion_detect_ros.__main__ import main
from motion_detect_ros.bridge.images import header_of, stamp_ns
from motion_detect_ros.bridge.records import ego_from_msg
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import CameraModel, EgoMotion
from motion_detect_ros.sources.bags import BagFrames, BagWriter
from motion_detect_ros.sources.inertial import GyroReplay
from motion_detect_ros.sources.messages import IMU, header, make

FRAMES, PERIOD_NS, IMU_PERIOD_NS = 12, 100_000_000, 5_000_000
CAMERA = CameraModel(320, 240, 300.0, 300.0, 160.0, 120.0)
#: Turning right about the optical y axis, faster and slower, rad/s; the angle is its integral.
MEAN, SWING, PULSE = 0.2, 0.15, 7.0
BLANK = np.full((240, 320, 3), 128, np.uint8)
USED = {'preprocessing.max_width_px': 320, 'imu.use': True}


def rate(seconds: float) -> float:
    return MEAN + SWING * math.sin(PULSE * seconds)


def angle(seconds: float) -> float:
    return MEAN * seconds - SWING / PULSE * math.cos(PULSE * seconds)


def write_flight(path: Path, imu_topic: str = '/imu') -> None:
    """Textured pictures, then blank ones, under a camera that turns right."""
    with BagWriter(path, compress=False) as bag:
        events = [(PERIOD_NS * (index + 1) + 1_700_000, index) for index in range(FRAMES)]
        events += [(IMU_PERIOD_NS * index, None) for index in range((FRAMES + 2) * PERIOD_NS // IMU_PERIOD_NS)]
        for stamp, index in sorted(events, key=lambda event: event[0]):
            if index is None:
                vector = make('geometry_msgs/msg/Vector3', x=0.0, y=rate(stamp * 1e-9), z=0.0)
                bag.write(imu_topic, make(IMU, header=header(stamp, 'imu'), angular_velocity=vector), stamp)
            else:
                bag.write_camera_info(CAMERA, stamp)
                bag.write_image(picture(index) if index < 3 else BLANK, stamp)


def offline(path: Path) -> list[EgoMotion]:
    frames = BagFrames(path)
    gyro = GyroReplay(frames.gyro())
    pipeline = MotionPipeline(with_settings(PipelineConfig(), USED), frames.camera)
    found = []
    for frame in frames:
        for sample in gyro.take(frame.stamp_ns):
            pipeline.add_gyro(sample.stamp_ns, np.array(sample.rate))
        found.append(pipeline.process(frame.image, frame.stamp_ns).ego)
    return found


@pytest.mark.parametrize('node', ['ego_motion', 'pipeline'])
def test_node_and_replay_agree_and_blank_pictures_turn_as_the_gyro_measures(peer, start, tmp_path, node):
    write_flight(tmp_path / 'flight.mcap')
    answers = peer.subscribe(PointCloud2, 'ego_motion')
    nothing_lost = [*lossless('image_raw', 'imu', 'camera_info', 'ego_motion'),
                    '-p', 'qos_overrides./imu.subscription.reliability:=reliable']
    start(node, *small('imu.use:=true', 'queue_size:=30'), *nothing_lost)
    rates = peer.advertise(Imu, 'imu')
    assert ready(peer, 'imu')
    # Before the images, and read while the player starts: an image waits 0.1 s for its rates, a busy machine longer.
    for sample in BagFrames(tmp_path / 'flight.mcap').gyro():
        message = Imu(header=header_of(sample.stamp_ns, 'imu'))
        message.angular_velocity.x, message.angular_velocity.y, message.angular_velocity.z = sample.rate
        rates.publish(message)
    assert rates.wait_for_all_acked(Duration(seconds=TIMEOUT_S))
    player = start('bag_player', '-p', f'bag:={tmp_path / "flight.mcap"}', '-p', 'wait_for_subscribers:=1',
                   '-p', 'topics:=/image_raw,/camera_info', *nothing_lost)
    assert peer.until(lambda: player.poll() is not None)
    assert peer.until(lambda: len(answers) == FRAMES)
    live, replayed = [ego_from_msg(message) for message in answers], offline(tmp_path / 'flight.mcap')
    for one, other in zip(live, replayed, strict=True):
        assert (one.stamp_ns, one.status, one.inliers) == (other.stamp_ns, other.status, other.inliers)
        np.testing.assert_array_equal(one.matrix, other.matrix)
    for ego in live[4:]:  # pictures before and after are blank
        turned = angle(ego.stamp_ns * 1e-9) - angle(ego.prev_stamp_ns * 1e-9)
        assert ego.ok
        u, v, w = ego.matrix @ (CAMERA.cx, CAMERA.cy, 1.0)
        np.testing.assert_allclose((u / w, v / w), (CAMERA.cx - CAMERA.fx * math.tan(turned), CAMERA.cy), atol=0.02)


def test_best_effort_imu_is_received_and_its_absence_reported(peer, start):
    from test_health import WARN, Health
    start('ego_motion', *small('imu.use:=true'))
    answers, health = peer.subscribe(PointCloud2, 'ego_motion'), Health(peer)
    images, rates = peer.advertise(Image, 'image_raw'), peer.advertise(Imu, 'imu', best_effort=True)
    assert ready(peer, 'image_raw')
    assert ready(peer, 'imu')
    images.publish(image_message(0))
    assert peer.until(lambda: len(answers) == 1)
    assert health.reported(WARN, 'nothing received on imu yet')
    for _ in range(20):
        rates.publish(Imu(header=answers[0].header, angular_velocity_covariance=[-1.0] + [0.0] * 8))
        peer.until(lambda: False, 0.001)
    before = len(health.reports)
    assert peer.until(lambda: len(health.reports) > before + 2)
    assert 'nothing received on imu yet' in health.reports[-1][1], 'these say that they have no angular velocity'
    for index in range(60):
        rates.publish(Imu(header=header_of(stamp_ns(answers[0].header) + index * IMU_PERIOD_NS, 'imu')))
        peer.until(lambda: False, 0.001)
    before = len(health.reports)
    images.publish(image_message(1))
    assert peer.until(lambda: len(answers) == 2)
    assert peer.until(lambda: len(health.reports) > before + 1)
    assert 'imu' not in health.reports[-1][1]  # the first report after it may have been on its way before the image


def test_replay_uses_the_rates_and_refuses_where_there_are_none(tmp_path, capsys):
    write_flight(tmp_path / 'flight.mcap', '/drone/imu/data')
    with BagWriter(tmp_path / 'bare.mcap') as bag:
        bag.write_image(picture(0), PERIOD_NS)
    settings = tmp_path / 'imu.yaml'
    settings.write_text('/**:\n  ros__parameters:\n    imu: {use: true}\n    preprocessing: {max_width_px: 320}\n')
    words = ['--config', str(settings), '-o', str(tmp_path / 'out')]
    assert main(['replay', str(tmp_path / 'flight.mcap'), *words]) == 0
    assert '"ok": 11' in (tmp_path / 'out' / 'summary.json').read_text()
    capsys.readouterr()
    assert main(['replay', str(tmp_path / 'bare.mcap'), *words, '--force']) == 2
    assert 'bare: imu.use expects angular rates (a topic of type Imu, oxts), found none' in capsys.readouterr().err
