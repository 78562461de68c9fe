"""The guard against losing accuracy on real clips: test/floors.json, by the command that people use."""

from __future__ import annotations

from pathlib import Path

import pytest

from motion_detect_ros.benchmarks import accuracy
from motion_detect_ros.benchmarks.accuracy_floors import read_floors, write_floors

FLOORS = Path(__file__).resolve().parents[1] / 'floors.json'


def test_f1_stays_over_its_floor(clips: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert accuracy.main(['--floors', str(FLOORS), '--data', str(clips)]) == 0, capsys.readouterr()


def test_guard_fails_for_a_worse_detector(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One clip is enough: a detector that wants a quarter of a second without a miss is not half as good."""
    one = tmp_path / 'one.json'
    write_floors(one, [floor for floor in read_floors(FLOORS) if floor.clip == 'davis_bmx-trees'])
    assert accuracy.main(['--floors', str(one), '--data', str(clips), '--set', 'tracks.confirm_s=0.24',
                          'objects.photometric_sigma=9.0', '--jobs', '1']) == 1
    assert 'davis_bmx-trees, first 60 frames: F1 at IoU 0.3 is' in capsys.readouterr().err


def test_floors_guard_something() -> None:
    floors = read_floors(FLOORS)
    assert {floor.clip.split('_')[0] for floor in floors} == {'visdrone', 'kitti', 'davis', 'uav123'}
    assert all(floor.f1_30 > 0.4 and floor.f1_50 > 0.2 for floor in floors)
