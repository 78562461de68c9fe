"""evaluate and inspect as commands."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.inspect import inspect_bag
from motion_detect_ros.results.error_pictures import FALSE_BGR, MISSED_BGR
from motion_detect_ros.sources import messages
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


def test_labels_after_the_end_of_the_replay_are_told(
    found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    truth = tmp_path / 'a.csv'
    truth.write_text('frame,id,x,y,w,h,moving\n' + ''.join(f'{frame},1,10,20,30,40,1\n' for frame in range(10, 90)))
    (tmp_path / 'summary.json').write_text('{"source_frames": 30}')
    words = ['evaluate', str(found), '--truth', str(truth)]
    told = f'60 labels of {found.parent.name} are of frames after the end of the replay and count nowhere'
    assert main(words) == 0
    assert f'caution: {told}' in capsys.readouterr().out.splitlines()
    result = run_json(capsys, *words)
    assert (result['frames'], result['caution']) == (20, told)


def test_last_frame_before_the_first_counted(
    found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / 'a.csv').write_text('frame,id,x,y,w,h,moving\n')
    assert main(['evaluate', str(found), '--truth', str(tmp_path / 'a.csv'), '--last-frame', '9']) == 2
    assert '--last-frame: expected 10 (--skip) or later, got 9' in capsys.readouterr().err


def test_nothing_is_counted_where_all_is_skipped(
    found: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / 'a.csv').write_text('frame,id,x,y,w,h,moving\n10,1,10,20,30,40,1\n')
    assert main(['evaluate', str(found), '--truth', str(tmp_path / 'a.csv'), '--skip', '13']) == 2
    assert capsys.readouterr() == ('', f'error: {found}: expected more than 13 frames (--skip), got 13\n')
    (tmp_path / 'summary.json').write_text('{"source_frames": 13, "start_s": 1.0}')
    (tmp_path / 'frames.csv').write_text('frame\n' + ''.join(f'{frame}\n' for frame in range(4, 13)))
    assert main(['evaluate', str(found), '--truth', str(tmp_path / 'a.csv')]) == 2
    assert capsys.readouterr().err == f'error: {found}: expected more than 10 frames (--skip), got 9\n'


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


@pytest.mark.parametrize('step_s', [-3600.0, -2.0, 1e6])
def test_inspect_of_a_clock_that_was_set(tmp_path: Path, step_s: float, capsys: pytest.CaptureFixture[str]) -> None:
    """25 Hz throughout; what the clock of the recorder shows in the second half is another time."""
    path = tmp_path / 'a.mcap'
    with BagWriter(path, chunk_bytes=100) as writer:
        for tick in range(40):
            stamp_ns = 10**18 + tick * 40_000_000
            writer.write('/image_raw', messages.image(np.zeros((8, 8), np.uint8), stamp_ns, 'camera'),
                         stamp_ns + (round(step_s * 1e9) if tick >= 20 else 0))
    report = inspect_bag(path)
    topic, = report.topics
    assert (topic.rate_hz, topic.gaps) == (pytest.approx(25.0), 0)
    assert report.duration_s == pytest.approx(39 * 0.04, abs=0.05)
    assert report.clock_jumps == 1
    assert main(['inspect', str(path)]) == 0
    assert 'its clock jumps 1 times' in capsys.readouterr().out


def test_inspect_of_coarse_times_of_recording(tmp_path: Path) -> None:
    """30 Hz, recorded by a clock that ticks at 10 Hz: two of three messages have the time of the one before."""
    path = tmp_path / 'a.mcap'
    with BagWriter(path) as writer:
        for tick in [*range(60), *range(75, 90)]:
            writer.write_image(np.zeros((8, 8), np.uint8), 10**9 + tick // 3 * 100_000_000)
    topic, = inspect_bag(path).topics
    assert topic.rate_hz == pytest.approx(74 / 2.9)
    assert (topic.gaps, topic.longest_gap_s) == (1, pytest.approx(0.6))


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


class TestManyClipsAndRuns:
    """Two clips of 20 frames with one mover: run ``good`` finds it always, run ``bad`` in clip ``a`` only."""

    @pytest.fixture
    def runs(self, tmp_path: Path) -> Path:
        for run, clip, last in (('good', 'a', 20), ('good', 'b', 20), ('bad', 'a', 20), ('bad', 'b', 0)):
            folder = tmp_path / run / clip
            folder.mkdir(parents=True)
            (folder / 'detections.csv').write_text('frame,id,x,y,w,h\n' + ''.join(
                f'{frame},1,10,20,30,40\n' for frame in range(last)))
        (tmp_path / 'truth').mkdir()
        for clip in ('a', 'b'):
            (tmp_path / 'truth' / f'{clip}.csv').write_text('frame,id,x,y,w,h,moving\n' + ''.join(
                f'{frame},1,10,20,30,40,1\n' for frame in range(20)))
        return tmp_path

    def test_each_clip_and_their_mean(self, runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
        result = run_json(capsys, 'evaluate', str(runs / 'bad'), '--truth', str(runs / 'truth'), '--iou', '0.5')
        assert [result['clips'][clip]['moving@0.5']['f1'] for clip in 'ab'] == [1.0, 0.0]  # type: ignore[index]
        mean = result['mean']['moving@0.5']  # type: ignore[index]
        assert (mean['f1'], mean['recall']) == (0.5, 0.5)
        assert mean['interval'] == [0.0, 1.0], 'drawn clips: both a, both b'
        assert 'clips and, in them, blocks of 25 frames' in str(result['interval'])
        assert str(result['caution']).startswith('10 frames of the shortest clip are few')

    def test_table_of_clips(self, runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(['evaluate', str(runs / 'bad'), '--truth', str(runs / 'truth'), '--iou', '0.5',
                     '--counting', 'moving']) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[0].startswith('2 clips, 20 frames; moving: only objects')
        assert lines[3].split() == ['a', '1.000', '1.000', '1.000', '10', '0', '0', '0.00']
        assert lines[5].split() == ['mean', '0.500', '0.500', '0.500', '0.00', '[0.000,', '1.000]']
        assert lines[7].startswith('[low, high]: 95% interval of F1 over 1000 draws')
        assert lines[8].startswith(
            'caution: 10 frames of the shortest clip are few: with under 125, blocks are cut short')

    def test_runs_side_by_side(self, runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
        words = ['evaluate', '--compare', str(runs / 'bad'), str(runs / 'good'), '--truth', str(runs / 'truth'),
                 '--iou', '0.5', '--counting', 'moving']
        assert main(words) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[0].startswith('2 clips, 20 frames; ')
        assert lines[1:3] == ['A: bad', 'B: good']
        assert lines[6].split() == ['b', '0.000', '1.000', '+1.000']
        assert lines[7].split() == ['mean', '0.500', '1.000', '+0.500']
        assert lines[8] == '  B - A [-1.000, +1.000]: no difference shown'
        mean = run_json(capsys, *words)['runs']['good']['mean']['moving@0.5']  # type: ignore[index]
        assert (mean['difference'], mean['difference_interval']) == (0.5, [-1.0, 1.0])

    def test_names_of_runs(
        self, runs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    ) -> None:
        """Of the current folder its own; of several clips all that was typed, not the last of them."""
        monkeypatch.chdir(runs / 'bad')
        for words, name in ((['.'], 'bad'), (['a', 'b'], 'a b')):
            assert main(['evaluate', *words, '--compare', '../good', '--truth', '../truth', '--bootstrap', '0']) == 0
            assert capsys.readouterr().out.splitlines()[1:3] == [f'A: {name}', 'B: good']
        (runs / 'good').rename(runs / 'other')
        (runs / 'other' / 'bad').mkdir()
        for clip in ('a', 'b'):
            (runs / 'other' / clip).rename(runs / 'other' / 'bad' / clip)
        assert main(['evaluate', '.', '--compare', '../other/bad', '--truth', '../truth', '--bootstrap', '0']) == 0
        assert capsys.readouterr().out.splitlines()[1:3] == ['A: .', 'B: ../other/bad']

    def test_one_clip_has_the_name_of_its_truth_and_no_mean(
        self, runs: Path, capsys: pytest.CaptureFixture[str],
    ) -> None:
        assert main(['evaluate', str(runs / 'bad' / 'b'), '--compare', str(runs / 'good' / 'a'), '--truth',
                     str(runs / 'truth' / 'a.csv'), '--iou', '0.5', '--counting', 'moving']) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[:3] == ['10 frames; moving: only objects labelled as moving are wanted; all: standing ones too',
                             'A: b', 'B: a']
        assert lines[5].split() == ['a', '0.000', '1.000', '+1.000']
        assert lines[6] == '  B - A [+1.000, +1.000]'

    def test_a_clip_without_truth_is_left_out_and_said(
        self, runs: Path, capsys: pytest.CaptureFixture[str],
    ) -> None:
        (runs / 'truth' / 'b.csv').unlink()
        assert main(['evaluate', str(runs / 'good'), '--truth', str(runs / 'truth')]) == 3
        assert capsys.readouterr().err == 'error: no truth for b: left out\n'

    def test_an_unfinished_replay_is_left_out_and_said(
        self, runs: Path, capsys: pytest.CaptureFixture[str],
    ) -> None:
        (runs / 'good' / 'b' / 'detections.csv').rename(runs / 'good' / 'b' / 'detections.csv.part')
        (runs / 'good' / 'a' / 'detections.csv.part').write_text('of a run that is going on')
        assert main(['evaluate', str(runs / 'good'), '--truth', str(runs / 'truth')]) == 3
        assert capsys.readouterr().err == 'error: an unfinished replay of b: left out\n'

    def test_what_is_unfinished_in_two_runs_is_said_once(
        self, runs: Path, capsys: pytest.CaptureFixture[str],
    ) -> None:
        good, bad = runs / 'good', runs / 'bad'
        for run in (good, bad):
            (run / 'b' / 'detections.csv').rename(run / 'b' / 'detections.csv.part')
        assert main(['evaluate', '--compare', str(good), str(bad), '--truth', str(runs / 'truth')]) == 3
        assert capsys.readouterr().err == 'error: an unfinished replay of b: left out\n'

    @pytest.mark.parametrize(('words', 'complaint'), [
        ([], 'evaluate: expected detections, or two runs or more after --compare'),
        (['good', '--worst', '2'], '--worst: expected a number of frames together with -o FOLDER'),
        (['good', '--block', '0'], '--block: expected 1 or more, got 0'),
        (['good', '--bootstrap', '999999999'], '--bootstrap: expected 100000 or fewer, got 999999999'),
        (['--compare', 'good', 'good'], '--compare: expected different runs, got good twice'),
    ])
    def test_wrong_use(self, runs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
                       words: list[str], complaint: str) -> None:
        monkeypatch.chdir(runs)
        assert main(['evaluate', *words, '--truth', 'truth']) == 2
        assert capsys.readouterr().err == f'error: {complaint}\n'

    def test_identity_is_that_of_trackeval(self, runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
        pytest.importorskip('trackeval', reason='pip install --no-deps trackeval')
        capsys.readouterr()  # it prints when it is imported
        result = run_json(capsys, 'evaluate', str(runs / 'good'), '--truth', str(runs / 'truth'), '--identity')
        score = result['identity']['good']['a']  # type: ignore[index]
        assert (score['hota'], score['idf1_50'], score['switches'], score['mostly']) == (1.0, 1.0, 0, 1)

    def test_identity_without_its_package(
        self, runs: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    ) -> None:
        monkeypatch.setitem(sys.modules, 'trackeval', None)
        monkeypatch.delitem(sys.modules, 'trackeval.metrics', raising=False)
        assert main(['evaluate', str(runs / 'good'), '--truth', str(runs / 'truth'), '--identity']) == 2
        assert 'pip install --no-deps trackeval' in capsys.readouterr().err


def test_worst_frames_are_read_again_from_the_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    """Grey pictures 0 to 11 of known brightness; only in frame 7 is the box wrong: a false one and a missed one."""
    (tmp_path / 'flight').mkdir()
    for frame in range(12):
        cv2.imwrite(str(tmp_path / 'flight' / f'{frame:06d}.png'), np.full((200, 320, 3), 10 * frame, np.uint8))
    assert main(['replay', str(tmp_path / 'flight'), '-o', str(tmp_path / 'out')]) == 0
    (tmp_path / 'out' / 'detections.csv').write_text('frame,id,x,y,w,h\n' + ''.join(
        f'{frame},1,{200 if frame == 7 else 100},20,30,40\n' for frame in range(12)))
    truth = tmp_path / 'flight.csv'
    truth.write_text('frame,id,x,y,w,h,moving\n' + ''.join(f'{frame},1,100,20,30,40,1\n' for frame in range(12)))
    capsys.readouterr()
    assert main(['evaluate', str(tmp_path / 'out'), '--truth', str(truth), '--skip', '2', '--worst', '3', '-o',
                 str(tmp_path / 'worst')]) == 0
    assert [path.name for path in (tmp_path / 'worst').iterdir()] == ['out_000007.png']
    assert capsys.readouterr().out.splitlines()[-1] == str(tmp_path / 'worst' / 'out_000007.png')
    picture = cv2.imread(str(tmp_path / 'worst' / 'out_000007.png'))
    inside = picture[6:206, 6:326]  # the sheet's margin
    assert tuple(inside[30, 290]) == (70, 70, 70), 'the picture of frame 7'
    assert tuple(inside[20, 215]) == FALSE_BGR
    assert tuple(inside[20, 115]) == MISSED_BGR

    for folder in (tmp_path / 'flight', tmp_path / 'flight' / 'worst'):
        assert main(['evaluate', str(tmp_path / 'out'), '--truth', str(truth), '--skip', '2', '--worst', '3', '-o',
                     str(folder)]) == 2
        assert capsys.readouterr().err == (f'error: {folder}: expected another folder for the pictures than the input '
                                           'itself; choose another --output\n')
    assert len([*(tmp_path / 'flight').iterdir()]) == 12


def test_labels_of_an_excerpt_go_by_the_names_of_its_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    """Pictures 101 to 140 of a VisDrone sequence; the box of picture N is N pixels from the left, its width 8."""
    (tmp_path / 'excerpt').mkdir()
    for number in range(101, 141):
        cv2.imwrite(str(tmp_path / 'excerpt' / f'{number:07d}.jpg'), np.full((120, 320), 90, np.uint8))
    assert main(['replay', str(tmp_path / 'excerpt'), '-o', str(tmp_path / 'out'), '--no-report']) == 0
    (tmp_path / 'out' / 'detections.csv').write_text('frame,id,x,y,w,h\n' + ''.join(
        f'{frame},1,{101 + frame},20,8,8\n' for frame in range(40)))
    (tmp_path / 'annotation.txt').write_text(''.join(
        f'{number},1,{number},20,8,8,1,4,0,0\n' for number in range(1, 201)))
    capsys.readouterr()
    result = run_json(capsys, 'evaluate', str(tmp_path / 'out'), '--truth', str(tmp_path / 'annotation.txt'))
    assert (result['frames'], result['moving@0.5']['f1']) == (30, 1.0)  # type: ignore[index]


def test_frames_that_the_settings_leave_out_do_not_count(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One of two, as ``--every 2`` has it; what is processed is found."""
    (tmp_path / 'flight').mkdir()
    for frame in range(40):
        cv2.imwrite(str(tmp_path / 'flight' / f'{frame:06d}.png'), np.full((120, 160), 90, np.uint8))
    (tmp_path / 'mine.yaml').write_text('/**: {ros__parameters: {load: {decimation_keep: 1, decimation_of: 2}}}')
    (tmp_path / 'truth.csv').write_text('frame,id,x,y,w,h,moving\n' + ''.join(
        f'{frame},1,10,20,30,40,1\n' for frame in range(40)))
    for number, words in enumerate((['--config', str(tmp_path / 'mine.yaml')], ['--every', '2'])):
        out = tmp_path / f'out{number}'
        assert main(['replay', str(tmp_path / 'flight'), '-o', str(out), '--no-report', *words]) == 0
        (out / 'detections.csv').write_text('frame,id,x,y,w,h\n' + ''.join(
            f'{frame},1,10,20,30,40\n' for frame in range(0, 40, 2)))
        capsys.readouterr()
        result = run_json(capsys, 'evaluate', str(out), '--truth', str(tmp_path / 'truth.csv'))
        assert (result['frames'], result['moving@0.5']['recall']) == (10, 1.0), words  # type: ignore[index]


def test_sequences_of_mot_challenge_are_replayed_and_evaluated_by_their_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    """They are laid out as SEQUENCE/img1/000001.jpg and SEQUENCE/gt/gt.txt."""
    for name in ('MOT17-02', 'MOT17-04'):
        (tmp_path / 'MOT' / name / 'img1').mkdir(parents=True)
        (tmp_path / 'MOT' / name / 'gt').mkdir()
        for number in range(1, 13):
            cv2.imwrite(str(tmp_path / 'MOT' / name / 'img1' / f'{number:06d}.jpg'), np.zeros((64, 96), np.uint8))
        (tmp_path / 'MOT' / name / 'gt' / 'gt.txt').write_text('12,1,11,21,30,40,1,1,1\n')
    assert main(['replay', str(tmp_path / 'MOT'), '-o', str(tmp_path / 'out'), '--no-report']) == 0
    assert sorted(path.name for path in (tmp_path / 'out').glob('*/')) == ['MOT17-02', 'MOT17-04']
    capsys.readouterr()
    result = run_json(capsys, 'evaluate', str(tmp_path / 'out'), '--truth', str(tmp_path / 'MOT'))
    assert list(result['clips']) == ['MOT17-02', 'MOT17-04']  # type: ignore[call-overload]
