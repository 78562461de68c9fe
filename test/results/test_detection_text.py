"""mot.txt against lines worked by hand, and as TrackEval reads it."""

from __future__ import annotations

from pathlib import Path

import pytest
from result_samples import FOUND, UNKNOWN, interrupted, write

from motion_detect_ros.results.detection_writer import FrameDetections

#: Frames and pixels count from 1: the first box has its corner at 50.5 - 11 / 2 = 45, 20 - 4 / 2 = 18.
LINES = [
    '1,7,46.00000,19.00000,11.00000,4.00000,0.25000,-1,-1,-1',
    '2,7,48.00000,19.00000,11.00000,4.00000,0.50000,-1,-1,-1',
    '2,9,285.00000,193.00000,32.00000,16.50000,0.75000,-1,-1,-1',
]


def test_lines_by_hand(tmp_path: Path) -> None:
    write(tmp_path, 'mot', found=[*FOUND, UNKNOWN])
    assert (tmp_path / 'mot.txt').read_text().splitlines() == LINES
    assert [path.name for path in tmp_path.iterdir()] == ['mot.txt']


def test_detections_csv_by_hand(tmp_path: Path) -> None:
    write(tmp_path, 'csv')
    lines = (tmp_path / 'detections.csv').read_text().splitlines()
    assert lines[0] == 'frame,stamp_ns,id,x,y,w,h,score,vel_u,vel_v,ttc'
    assert lines[3] == '1,1050000000,9,284.00000,192.00000,32.00000,16.50000,0.75000,0.00000,0.00000,nan'
    assert len(lines) == 4


def test_what_an_interrupted_run_leaves_is_readable(tmp_path: Path) -> None:
    interrupted(tmp_path, 'mot')
    assert [path.name for path in tmp_path.iterdir()] == ['mot.txt.part']
    assert (tmp_path / 'mot.txt.part').read_text().splitlines() == LINES


def sequence(folder: Path, frames: int) -> None:
    """A benchmark of one sequence in the layout of the MOT Challenge, whose truth is the tracks themselves."""
    (folder / 'gt' / 'flight' / 'gt').mkdir(parents=True)
    (folder / 'gt' / 'flight' / 'seqinfo.ini').write_text(f'[Sequence]\nname=flight\nseqLength={frames}\n')
    truth = [','.join([*line.split(',')[:6], '1,1,1']) for line in LINES]
    (folder / 'gt' / 'flight' / 'gt' / 'gt.txt').write_text('\n'.join(truth) + '\n')
    (folder / 'trackers' / 'ours' / 'data').mkdir(parents=True)
    (folder / 'mot.txt').rename(folder / 'trackers' / 'ours' / 'data' / 'flight.txt')


def test_trackeval_reads_boxes_ids_and_scores(tmp_path: Path) -> None:
    trackeval = pytest.importorskip('trackeval', reason='pip install --no-deps trackeval')
    write(tmp_path, 'mot', found=[*FOUND, FrameDetections(4, 2 * 10**9, FOUND[0].records)])
    sequence(tmp_path, 4)
    data = trackeval.datasets.MotChallenge2DBox({
        'GT_FOLDER': str(tmp_path / 'gt'), 'TRACKERS_FOLDER': str(tmp_path / 'trackers'), 'SKIP_SPLIT_FOL': True,
        'SEQ_INFO': {'flight': 5}, 'DO_PREPROC': False, 'PRINT_CONFIG': False})
    raw = data.get_raw_seq_data('ours', 'flight')
    assert [ids.tolist() for ids in raw['tracker_ids']] == [[7], [7, 9], [], [], [7]]
    assert raw['tracker_dets'][1].tolist() == [[48, 19, 11, 4], [285, 193, 32, 16.5]]
    assert [scores.tolist() for scores in raw['tracker_confidences']] == [[0.25], [0.5, 0.75], [], [], [0.25]]
    found = trackeval.metrics.CLEAR({'PRINT_CONFIG': False}).eval_sequence(
        data.get_preprocessed_seq_data(raw, 'pedestrian'))
    assert (found['CLR_TP'], found['CLR_FN'], found['CLR_FP'], found['IDSW']) == (3, 0, 1, 0)


def test_motmetrics_gives_our_own_boxes_back(tmp_path: Path) -> None:
    """It takes 1 off again, as pixels count from 1 in the format."""
    motmetrics = pytest.importorskip('motmetrics', reason='pip install motmetrics')
    write(tmp_path, 'mot')
    table = motmetrics.io.loadtxt(str(tmp_path / 'mot.txt'), fmt='mot16')
    assert table.index.tolist() == [(1, 7), (2, 7), (2, 9)]
    assert table[['X', 'Y', 'Width', 'Height', 'Confidence']].to_numpy().tolist() == [
        [45, 18, 11, 4, 0.25], [47, 18, 11, 4, 0.5], [284, 192, 32, 16.5, 0.75]]
