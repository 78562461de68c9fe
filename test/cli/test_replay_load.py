"""Replay leaves out the frames that frame decimation says, and keeps their numbers."""

from __future__ import annotations

import csv
import json

import cv2

from motion_detect_ros.__main__ import main
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
