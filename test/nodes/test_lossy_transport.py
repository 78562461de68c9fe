"""Images that do not arrive: estimated from those that do, and named with what helps."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import lossless, picture, ready, small
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.bridge.images import header_of, image_to_msg

pytestmark = pytest.mark.messages

PERIOD_NS = 100_000_000


def reported(reports, words: str) -> bool:
    return any(message.status[0].level == DiagnosticStatus.WARN and words in message.status[0].message
               for message in reports)


def test_a_stage_that_gets_one_image_in_three_names_the_rate_and_the_cure(peer, start, shown):
    start('pipeline', *small('queue_size:=1000'), *lossless('image_raw'))
    reports, answers = peer.subscribe(DiagnosticArray, '/diagnostics'), peer.subscribe(PointCloud2, 'detections')
    publisher = peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    arriving = [index for index in range(120) if index % 7 in {0, 1, 4}]
    for index in arriving:
        publisher.publish(image_to_msg(picture(index % 40), header_of((index + 1) * PERIOD_NS, '')))
    assert peer.until(lambda: len(answers) == len(arriving))
    assert peer.until(lambda: reported(reports, 'of the images do not arrive (published at 10.0 Hz by their stamps)'))
    assert reported(reports, 'set image_transport:=compressed')
    values = {pair.key: pair.value for pair in reports[-1].status[0].values}
    lost = 1.0 - (len(arriving) - 1) / (arriving[-1] - arriving[0])
    assert abs(float(values['lost_share']) - lost) < 0.05
    shown('images are lost between driver and node', 'WARN with the share, the publisher\'s rate and the cure',
          f'{lost:.0%} lost, estimated {float(values["lost_share"]):.0%}')


def test_a_best_effort_camera_and_a_reliable_stage_are_named_with_the_cure(peer, start, tmp_path, shown):
    start('pipeline', *small('image_reliability:=reliable'))
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    peer.advertise(Image, 'image_raw', best_effort=True)
    words = 'a publisher of /image_raw offers another reliability than RELIABLE; set image_reliability:=best_effort'
    assert peer.until(lambda: reported(reports, words))
    assert words in (tmp_path / 'pipeline.log').read_text()
    shown('a best-effort camera, a reliable stage', 'topic, policy and cure in log and diagnostics', 'named')


def test_left_to_itself_a_stage_takes_what_the_driver_offers(peer, start, tmp_path, shown):
    start('pipeline', *small())
    reports, answers = peer.subscribe(DiagnosticArray, '/diagnostics'), peer.subscribe(PointCloud2, 'detections')
    peer.known_to('pipeline')
    publisher = peer.advertise(Image, 'image_raw', best_effort=True)
    log = tmp_path / 'pipeline.log'
    assert peer.until(lambda: '/image_raw has a best-effort publisher' in log.read_text())
    index = 0

    def answered() -> bool:
        nonlocal index
        index += 1
        publisher.publish(image_to_msg(picture(index % 40), header_of(index * PERIOD_NS, '')))
        peer.rest(0.1)
        return len(answers) >= 5

    assert peer.until(answered)
    reports.clear()
    assert peer.until(lambda: reports and 'offers another' not in reports[-1].status[0].message)
    shown('a best-effort camera, a stage left to itself', 'it subscribes best effort too, and answers', 'answered')


def test_a_flow_of_another_grid_is_refused_and_named(peer, start, shown):
    start('ego_motion', *small())
    start('art2_clustering', *small())
    reports, egos = peer.subscribe(DiagnosticArray, '/diagnostics'), peer.subscribe(PointCloud2, 'ego_motion')
    images, flows = peer.advertise(Image, 'image_raw'), peer.advertise(Image, 'flow')
    assert ready(peer, 'image_raw', 2)
    assert ready(peer, 'flow')
    sent = 0

    def named() -> bool:
        nonlocal sent
        header = header_of((sent + 1) * PERIOD_NS, '')
        images.publish(image_to_msg(picture(sent % 40), header))
        flows.publish(Image(header=header, height=6, width=8, encoding='32FC2', step=64, data=bytes(8 * 8 * 6)))
        sent += 1
        assert peer.until(lambda: len(egos) == sent)
        return reported(reports, '/flow: expected a grid of 80x60 cells for these images and settings, got 8x6')

    assert peer.until(named)
    shown('flow of another grid', 'refused with topic, expected and actual size', '8x6 against 80x60')
