"""What replay says of the settings that follow the scene."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest
from test_pipeline import scene

from motion_detect_ros.__main__ import main


@pytest.fixture(scope='module')
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('pictures')
    for frame in range(10):
        cv2.imwrite(str(folder / f'{frame:06d}.png'), scene(frame))
    return folder


def tuned(pictures: Path, out: Path, *words: str) -> dict[str, float]:
    assert main(['replay', str(pictures), '-o', str(out), *words]) == 0
    return json.loads((out / 'summary.json').read_text())['tuned']


def test_summary_shows_the_settings_in_use(pictures: Path, tmp_path: Path) -> None:
    config = tmp_path / 'following.yaml'
    config.write_text('/**:\n  ros__parameters:\n    self_tuning:\n      noise_floor: true\n      neurons: true\n')
    assert tuned(pictures, tmp_path / 'off') == {'noise_floor_px': 0.2, 'initial_neurons': 15, 'max_neurons': 25}
    following = tuned(pictures, tmp_path / 'on', '--config', str(config))
    assert 0.05 <= following['noise_floor_px'] < 0.2, 'clean pictures'
    assert 4 <= following['initial_neurons'] < 15, 'one mover'
    assert following['initial_neurons'] < following['max_neurons'] < 25
