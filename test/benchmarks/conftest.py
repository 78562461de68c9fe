"""Clips made of the built-in flight."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight
from motion_detect_ros.sources.truth import write_truth

FRAMES = 14


@pytest.fixture(scope='session')
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two clips of one flight: ``made_moves`` as it is, ``made_stands`` whose truth says it stands."""
    folder = tmp_path_factory.mktemp('clips')
    config = dataclasses.replace(FlightConfig.single(36, 5, 3, frames=FRAMES), width=320, height=240)
    frames = list(SyntheticFlight(config))
    (folder / 'pictures').mkdir()
    for frame in frames:
        assert cv2.imwrite(str(folder / 'pictures' / f'{frame.index:06d}.png'), frame.image)
    truth = np.concatenate([frame.truth for frame in frames])
    write_truth(folder / 'moves.csv', truth)
    truth['moving'] = 0
    write_truth(folder / 'stands.csv', truth)
    entry = {'frames': 'pictures', 'fps': 20, 'preset': 'default', 'complete_gt': True}
    (folder / 'clips.json').write_text(json.dumps({
        'made_moves': {**entry, 'gt': 'moves.csv'}, 'made_stands': {**entry, 'gt': 'stands.csv'}}))
    return folder
