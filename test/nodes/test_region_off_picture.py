"""An ignored region that is not on the picture costs no image, in the nodes and offline."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from peers import image_message, picture, ready, small
from sensor_msgs.msg import Image, PointCloud2

from motion_detect_ros.__main__ import main
from motion_detect_ros.sources.bags import BagWriter

SETTING = 'preprocessing.ignore_regions'
WORDS = f'{SETTING}: region 900,10,50,50 is not on the 320x240 picture, and left out'


@pytest.mark.parametrize(('node', 'topic'), [('pipeline', 'detections'), ('ego_motion', 'ego_motion')])
def test_a_node_answers_and_warns_once(peer, start, tmp_path: Path, node: str, topic: str):
    start(node, *small(f'{SETTING}:="900,10,50,50; 0,0,20,20"', 'queue_size:=100'))
    answers, images = peer.subscribe(PointCloud2, topic), peer.advertise(Image, 'image_raw')
    assert ready(peer, 'image_raw')
    for index in range(5):
        images.publish(image_message(index))
        assert peer.until(lambda index=index: len(answers) > index)
    assert (tmp_path / f'{node}.log').read_text().count(WORDS) == 1


def test_replay_processes_all_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    with BagWriter(tmp_path / 'a.mcap', compress=False) as writer:
        for index in range(5):
            writer.write_image(picture(index), (index + 1) * 100_000_000)
    settings = tmp_path / 'regions.yaml'
    settings.write_text('/**: {ros__parameters: {preprocessing: {ignore_regions: "900,10,50,50"}}}\n')
    assert main(['replay', str(tmp_path / 'a.mcap'), '-o', str(tmp_path / 'out'), '--preset', str(settings),
                 '--no-report']) == 0
    assert capsys.readouterr().out.count(WORDS) == 1
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert (summary['frames'], summary['bad_frames'], summary['warnings']) == (5, 0, [WORDS])
