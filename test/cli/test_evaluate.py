"""evaluate and inspect as commands."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.inspect import inspect_bag
from motion_detect_ros.sources.bags import BagWriter


@pytest.fixture
def found(tmp_path: Path) -> Path:
    """Frames 10 and 11 found exactly, frame 12 a box elsewhere."""
    path = tmp_path / 'detections.csv'
    path.write_text('frame,stamp_ns,id,x,y,w,h,score,vel_u,vel_v,ttc\n' + ''.join(
        f'{frame},0,1,{x},20,30,40,1,0,0,nan\n' for frame, x in ((10, 10), (11, 10), (12, 500))))
    return path


def run_json(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, object]:
    assert main([*words, '--json']) == 0
    return json.loads(capsys.readouterr().out)


def test_visdrone_truth(found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = tmp_path / 'a.txt'
    truth.write_text(''.join(f'{frame},1,10,20,30,40,1,4,0,0\n' for frame in range(1, 14)))  # frames 0..12
    result = run_json(capsys, 'evaluate', str(found), '--truth', str(truth), '--iou', '0.3', '0.75')
    assert result['frames'] == 3
    assert 'does not say what moves' in str(result['counting'])
    score = result['moving@0.75']
    assert score == {'precision': 2 / 3, 'recall': 2 / 3, 'f1': pytest.approx(2 / 3), 'gt': 3, 'true_positives': 2,
                     'false_positives': 1, 'false_negatives': 1, 'false_per_frame': 1 / 3}


def test_kitti_truth_without_skip(found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = tmp_path / 'a.txt'
    truth.write_text(''.join(
        f'{frame} 1 Car 0 0 -1.9 10 20 40 60 1.7 0.8 1.8 1.6 1.7 5.8 -1.7\n' for frame in (9, 10, 11, 12)))
    result = run_json(capsys, 'evaluate', str(found), '--truth', str(truth), '--skip', '0')
    assert (result['frames'], result['truth']) == (13, 'KITTI tracking labels')
    assert (result['moving@0.5']['true_positives'], result['moving@0.5']['gt']) == (2, 4)  # type: ignore[index]


def test_table_says_which_counting(found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = tmp_path / 'a.csv'
    truth.write_text('frame,id,x,y,w,h,moving\n12,1,10,20,30,40,1\n')
    assert main(['evaluate', str(found), '--truth', str(truth)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == '3 frames; moving: only objects labelled as moving are wanted; all: standing ones too'
    assert lines[2].split() == ['moving@0.3', '0.000', '0.000', '0.000', '0', '3', '1', '1.00']


def test_boxes_after_the_last_truth_are_false(
    found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    truth = tmp_path / 'a.csv'
    truth.write_text('frame,id,x,y,w,h,moving\n10,1,10,20,30,40,1\n')
    result = run_json(capsys, 'evaluate', str(found), '--truth', str(truth))
    score = result['moving@0.5']
    assert result['frames'] == 3
    assert (score['true_positives'], score['false_positives'], score['gt']) == (1, 2, 1)  # type: ignore[index]
    (tmp_path / 'summary.json').write_text('{"frames": 28, "source_frames": 30}')  # of the replay: frames 0 to 29
    result = run_json(capsys, 'evaluate', str(found), '--truth', str(truth))
    assert (result['frames'], result['moving@0.5']['false_per_frame']) == (20, 0.1)  # type: ignore[index]
    result = run_json(capsys, 'evaluate', str(found), '--truth', str(truth), '--last-frame', '10')
    assert (result['frames'], result['moving@0.5']['false_positives']) == (1, 0)  # type: ignore[index]


def test_last_frame_before_the_first_counted(
    found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / 'a.csv').write_text('frame,id,x,y,w,h,moving\n')
    assert main(['evaluate', str(found), '--truth', str(tmp_path / 'a.csv'), '--last-frame', '9']) == 2
    assert '--last-frame: expected 10 (--skip) or later, got 9' in capsys.readouterr().err


def test_no_movers_at_all(found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = tmp_path / 'a.csv'
    truth.write_text('frame,id,x,y,w,h,moving\n')
    result = run_json(capsys, 'evaluate', str(found), '--truth', str(truth))
    score = result['moving@0.3']
    assert (score['false_positives'], score['gt'], score['false_per_frame']) == (3, 0, 1.0)  # type: ignore[index]


@pytest.mark.parametrize('text', ['{', '[]', '{"source_frames": "many"}', '{"frames": 3}'])
def test_summary_that_is_none(
    found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str,
) -> None:
    (tmp_path / 'a.csv').write_text('frame,id,x,y,w,h,moving\n10,1,10,20,30,40,1\n')
    (tmp_path / 'summary.json').write_text(text)
    assert main(['evaluate', str(found), '--truth', str(tmp_path / 'a.csv')]) == 2
    assert 'summary.json: expected the count source_frames' in capsys.readouterr().err


def test_inspect_finds_rates_and_gaps(tmp_path: Path) -> None:
    path = tmp_path / 'a.mcap'
    with BagWriter(path) as writer:
        for tick in [*range(10), *range(20, 30)]:  # 20 Hz, silent for half a second
            writer.write_image(np.zeros((8, 8), np.uint8), 10**9 + tick * 50_000_000)
    report = inspect_bag(path)
    (topic,) = report.topics
    assert (topic.name, topic.msgtype, topic.count, topic.announced) == ('/image_raw', 'sensor_msgs/msg/Image', 20, 20)
    assert topic.rate_hz == pytest.approx(20)
    assert (topic.gaps, topic.longest_gap_s) == (1, pytest.approx(0.55))
    assert report.duration_s == pytest.approx(1.45)
    assert report.damaged is None


def test_inspect_of_a_cut_bag_exits_with_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'a.mcap'
    with BagWriter(path, compress=False) as writer:
        for tick in range(5):
            writer.write_image(np.zeros((1100, 1000), np.uint8), tick)
    path.write_bytes(path.read_bytes()[:3_500_000])  # each chunk is 1.1 MB: three are whole
    assert main(['inspect', str(path)]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith('3 readable messages, 0.000 s')
    assert lines[1] == 'damaged: a.mcap: the end is missing (recording was cut off)'
