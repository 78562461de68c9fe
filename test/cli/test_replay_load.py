"""Replay leaves out the frames that frame decimation says, and keeps their numbers."""

from __future__ import annotations

import csv
import json

import cv2

from motion_detect_ros.__main__ import main
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight


def test_two_of_five(tmp_path):
    images = tmp_path / 'images'
    images.mkdir()
    for frame in SyntheticFlight(FlightConfig.single(40.0, 4.0, 3.0, frames=30)):
        cv2.imwrite(str(images / f'{frame.index:04d}.png'), frame.image)
    config = tmp_path / 'load.yaml'
    config.write_text('/**:\n  ros__parameters:\n    load: {decimation_keep: 2, decimation_of: 5}\n')
    assert main(['replay', str(images), '-o', str(tmp_path / 'out'), '--config', str(config), '--fps', '20']) == 0
    with (tmp_path / 'out' / 'detections.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert rows
    assert {int(row['frame']) % 5 for row in rows} == {0, 1}
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert (summary['frames'], summary['source_frames']) == (12, 30)


def test_a_jump_back_that_a_frame_left_out_tells_is_one_for_the_next(tmp_path):
    """As in the nodes. Before the eighth frame the clock goes back by 0.4 s; the sixth and the eleventh are used."""
    flight, config = SyntheticFlight(FlightConfig.single(40.0, 4.0, 3.0, frames=16)), tmp_path / 'load.yaml'
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for frame in flight:
            bag.write_image(frame.image, 10**18 + (frame.index - (4 if frame.index >= 7 else 0)) * 100_000_000)
    config.write_text('/**: {ros__parameters: {load: {decimation_keep: 1, decimation_of: 5}}}')
    assert main(['replay', str(tmp_path / 'a.mcap'), '-o', str(tmp_path / 'out'), '--config', str(config),
                 '--no-report']) == 0
    with (tmp_path / 'out' / 'frames.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert [(row['frame'], row['ego_status']) for row in rows] == [
        ('0', 'first_frame'), ('5', 'ok'), ('10', 'time_jump'), ('15', 'ok')]
