"""The accuracy bench on a tiny made clip whose truth the renderer knows, and its arithmetic by hand."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks import accuracy
from motion_detect_ros.benchmarks.accuracy_clips import Clip, ClipRun, Job, read_clips, run_clip, run_jobs
from motion_detect_ros.benchmarks.accuracy_floors import Floor, read_floors, renewed
from motion_detect_ros.benchmarks.accuracy_record import ClipFigures, Figures, Record, append_record, read_records
from motion_detect_ros.benchmarks.accuracy_table import table
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import empty_detections
from motion_detect_ros.results.error_pictures import FALSE_BGR
from motion_detect_ros.sources.truth import read_truth, write_truth

FRAMES = 14  # of the clips of ``made``


@pytest.fixture(scope='session')
def run(made: Path) -> ClipRun:
    return run_clip(Job(read_clips(made, ['made_moves'])[0], {}))


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip('|').split('|')]


class TestRun:
    def test_the_one_mover_is_found_where_it_is(self, run: ClipRun) -> None:
        loose, _ = run.scores()
        assert (loose.wanted, loose.frames) == (FRAMES - 2, FRAMES - 2), 'one mover a frame, two frames of warm-up'
        assert loose.recall > 0.6 and loose.precision > 0.9

    def test_a_standing_object_is_false_among_movers_and_wanted_among_all(self, made: Path, run: ClipRun) -> None:
        standing = dataclasses.replace(run, clip=read_clips(made, ['made_stands'])[0])
        assert standing.scores('moving')[0].false_positives == run.scores()[0].true_positives
        assert standing.scores('moving')[0].wanted == 0
        assert standing.scores('all') == run.scores('moving')

    def test_processes_give_the_same_as_this_one(self, made: Path, run: ClipRun) -> None:
        other = list(run_jobs([Job(clip, {}) for clip in read_clips(made)], 2))
        assert [one.clip.name for one in other] == ['made_moves', 'made_stands']
        for frame, records in run.detections.items():
            assert other[0].detections[frame].tobytes() == records.tobytes()

    def test_limit_uses_the_first_frames_only(self, made: Path) -> None:
        clip = dataclasses.replace(read_clips(made)[0], limit=5)
        short = run_clip(Job(clip, {}))
        assert sorted(short.detections) == [0, 1, 2, 3, 4]
        assert short.scores()[0].wanted == 3

    def test_frames_after_the_last_truth_are_counted(self, made: Path, run: ClipRun, tmp_path: Path) -> None:
        write_truth(tmp_path / 'start.csv', run.clip.read_truth()[:1])  # frame 0, which warm-up leaves out
        early = dataclasses.replace(run, clip=dataclasses.replace(run.clip, truth=tmp_path / 'start.csv'))
        score = early.scores()[0]
        assert (score.frames, score.wanted) == (FRAMES - 2, 0)
        assert score.false_positives == sum(len(found) for frame, found in run.detections.items() if frame >= 2) > 0

    def test_settings_reach_the_pipeline(self, made: Path) -> None:
        blind = run_clip(Job(read_clips(made)[0], {'objects.min_side_px': 200.0}))
        assert sum(map(len, blind.detections.values())) == 0


class TestCommand:
    def test_record_then_compare(self, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        records = tmp_path / 'runs.json'
        base = ['made_moves', '--data', str(made), '--records', str(records), '--jobs', '1']
        assert accuracy.main([*base, '--record', 'first']) == 0
        assert '(' not in capsys.readouterr().out.splitlines()[2], 'nothing to compare with yet'
        assert accuracy.main([*base, '--set', 'objects.min_side_px=200', '--record', 'blind']) == 0
        out = capsys.readouterr().out
        first, blind = read_records(records)
        was = first.clips['made_moves'].countings['moving'].f1_30
        assert cells(out.splitlines()[2])[1] == f'0.00 ({-was:+.2f})'
        assert 'change against "first"' in out
        assert blind.settings == {'objects.min_side_px': 200}
        assert blind.clips['made_moves'].countings['all'] == Figures(0, 0, 0, 0, 0)
        assert accuracy.main([*base, '--against', 'nobody']) == 2
        assert "expected the name of a recorded run (first, blind), got 'nobody'" in capsys.readouterr().err

    def test_preset_for_all_clips(
        self, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    ) -> None:
        records, preset = tmp_path / 'runs.json', tmp_path / 'blind.yaml'
        preset.write_text('/**:\n  ros__parameters:\n    objects:\n      min_side_px: 200.0\n')
        base = ['made_moves', '--data', str(made), '--records', str(records), '--jobs', '1', '--preset']
        assert accuracy.main([*base, str(preset), '--record', 'blind']) == 0
        (blind,) = read_records(records)
        assert blind.clips['made_moves'].countings['moving'].recall == 0.0
        assert blind.settings == {'preset': str(preset)}
        capsys.readouterr()
        assert accuracy.main([*base, 'nobody']) == 2
        assert 'nobody: expected a preset' in capsys.readouterr().err

    def test_all_objects_wants_what_stands(
            self, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        base = ['made_stands', '--data', str(made), '--records', str(tmp_path / 'none.json'), '--jobs', '1']
        assert accuracy.main(base) == 0
        assert cells(capsys.readouterr().out.splitlines()[2])[1] == '0.00'
        assert accuracy.main([*base, '--all-objects']) == 0
        assert float(cells(capsys.readouterr().out.splitlines()[2])[1]) > 0.6

    def test_table_goes_into_a_document(self, made: Path, tmp_path: Path) -> None:
        page = tmp_path / 'page.md'
        page.write_text('<!-- generated: clips, all objects -->\n<!-- end: clips, all objects -->\nrest\n')
        assert accuracy.main(['made_stands', '--data', str(made), '--records', str(tmp_path / 'none.json'),
                              '--jobs', '1', '--all-objects', '--write', str(page)]) == 0
        lines = page.read_text().splitlines()
        assert lines[1].startswith('| clip | F1 at 0.3 |') and lines[-1] == 'rest'
        assert float(cells(lines[3])[1]) > 0.6

    def test_pictures(self, made: Path, tmp_path: Path) -> None:
        assert accuracy.main(['made_stands', '--data', str(made), '--records', str(tmp_path / 'none.json'),
                              '--jobs', '1', '--pictures', str(tmp_path / 'sheets')]) == 0
        sheet = cv2.imread(str(tmp_path / 'sheets' / 'made_stands.png'))
        assert sheet.shape[1] > 1900
        assert (np.abs(sheet.astype(int) - FALSE_BGR).sum(axis=2) < 60).any(), 'false boxes are drawn'

    @pytest.mark.parametrize(('extra', 'message'), [
        (['nothing'], 'expected some of made_moves, made_stands, got nothing'),
        (['--set', 'tracks.confirm_s'], "--set: expected NAME=VALUE, got 'tracks.confirm_s'"),
        (['--set', 'tracks.hits=3'], "unknown setting 'tracks.hits'"),
        (['--floors', '/nowhere.json'], 'floors cannot be read'),
    ])
    def test_refuses(self, made: Path, extra: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
        assert accuracy.main([*extra, '--data', str(made), '--jobs', '1']) == 2
        assert message in capsys.readouterr().err

    def test_no_clips(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert accuracy.main(['--data', str(tmp_path)]) == 2
        assert 'expected a folder with clips.json; set MOTION_DETECT_DATA or --data' in capsys.readouterr().err


    def test_the_folder_of_clips_is_named_by_a_variable(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv('MOTION_DETECT_DATA', '/my/clips')
        assert accuracy.make_parser().parse_args([]).data == Path('/my/clips')
        monkeypatch.delenv('MOTION_DETECT_DATA')
        assert accuracy.make_parser().parse_args([]).data == Path('../shared/data')
        assert '(default: MOTION_DETECT_DATA, else ../shared/data)' in ' '.join(
            accuracy.make_parser().format_help().split())


class TestFloors:
    def guard(self, made: Path, floors: Path, *more: str) -> int:
        return accuracy.main(['--data', str(made), '--jobs', '1', '--floors', str(floors), *more])

    def test_holds_what_was_measured_and_fails_over_it(
            self, made: Path, run: ClipRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        floors = tmp_path / 'floors.json'
        floors.write_text(json.dumps({'floors': [
            {'clip': 'made_moves', 'frames': FRAMES, 'f1_30': 0.0, 'f1_50': 0.0}]}))
        assert self.guard(made, floors, '--renew') == 0
        loose, strict = run.scores()
        assert read_floors(floors) == [Floor('made_moves', FRAMES, round(loose.f1 - 0.03, 3),
                                             round(max(0.0, strict.f1 - 0.03), 3))]
        assert self.guard(made, floors) == 0
        assert self.guard(made, floors, '--set', 'objects.min_side_px=200') == 1, 'a blind detector'
        assert 'made_moves, first 14 frames: F1 at IoU 0.3 is 0.000, floor' in capsys.readouterr().err

    def test_each_iou_has_its_own_floor(self) -> None:
        floor = Floor('clip', 9, 0.6, 0.4)
        assert floor.failures(Figures(0.6, 0.4, 0, 0, 0)) == []
        assert len(floor.failures(Figures(0.59, 0.4, 0, 0, 0))) == len(floor.failures(Figures(0.6, 0.39, 0, 0, 0))) == 1

    def test_no_floor_under_zero(self, made: Path) -> None:
        clip = dataclasses.replace(read_clips(made)[0], limit=3)
        nothing = ClipRun(clip, dict.fromkeys(range(3), empty_detections()), 1.0)
        assert renewed([Floor('made_moves', 3, 0.5, 0.5)], [nothing]) == [Floor('made_moves', 3, 0.0, 0.0)]

    def test_empty_file_guards_nothing(self, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        (tmp_path / 'floors.json').write_text('{"floors": []}')
        assert self.guard(made, tmp_path / 'floors.json') == 2
        assert 'expected at least one floor' in capsys.readouterr().err


class TestTable:
    @staticmethod
    def record(**f1: float) -> Record:
        return Record('r', '2026-01-01', 'abc', {}, {
            name: ClipFigures({'moving': Figures(value, value / 2, 1.0, value, 0.0)}, 40.0)
            for name, value in f1.items()})

    def test_means_by_family_and_change_over_shared_clips(self) -> None:
        now, before = self.record(a_1=0.5, a_2=0.7, b_1=0.9), self.record(a_1=0.4, b_1=0.9, c_1=0.1)
        rows = {row[0]: row[1:] for row in map(cells, table(now, before)[2:])}
        assert list(rows) == ['`a_1`', '`a_2`', '*mean of 2 a*', '`b_1`', 'mean of 3']
        assert rows['`a_1`'][:2] == ['0.50 (+0.10)', '0.25 (+0.05)']
        assert rows['`a_2`'][0] == '0.70', 'not in the earlier run'
        assert rows['*mean of 2 a*'][0] == '0.60 (+0.10)', 'the change of a_1 alone'
        assert rows['`b_1`'][0] == '0.90', 'no change'
        assert rows['mean of 3'][0] == '0.70 (+0.05)', 'half of the change of a_1'
        assert rows['mean of 3'][5] == '40'


def test_record_needs_its_folder(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match='the run cannot be recorded: No such file'):
        append_record(tmp_path / 'nowhere' / 'runs.json', TestTable.record(a_1=0.5))


def test_made_truth_is_read_back(made: Path) -> None:
    clip = read_clips(made)[0]
    assert isinstance(clip, Clip) and clip.family == 'made'
    assert len(read_truth(clip.truth)) == FRAMES
