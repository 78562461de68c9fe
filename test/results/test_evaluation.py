"""Which files belong together, and which frames count."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.clips import all_clips, clips_of, same_clips, truth_of_clips
from motion_detect_ros.results.evaluation import evaluate_clip, figure_of
from motion_detect_ros.results.found import read_found

HEADER = 'frame,stamp_ns,id,x,y,w,h,score,vel_u,vel_v,ttc\n'


def write_found(path: Path, frames: range, x: float = 10) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(HEADER + ''.join(f'{frame},0,1,{x},20,30,40,1,0,0,nan\n' for frame in frames))
    return path


def write_moving(path: Path, frames: range) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text('frame,id,x,y,w,h,moving\n' + ''.join(f'{frame},1,10,20,30,40,1\n' for frame in frames))
    return path


class TestPairs:
    def test_a_folder_of_result_folders(self, tmp_path: Path) -> None:
        for name in ('b', 'a'):
            write_found(tmp_path / 'out' / name / 'detections.csv', range(3))
        found = clips_of(tmp_path / 'out')
        assert list(found) == ['a', 'b']
        assert clips_of(tmp_path / 'out' / 'a') == {'a': found['a']} == clips_of(found['a'])
        assert list(clips_of(write_found(tmp_path / 'own_name.csv', range(1)))) == ['own_name']

    def test_nothing_there(self, tmp_path: Path) -> None:
        with pytest.raises(SourceError, match='expected detections as CSV, a result folder or a folder of those'):
            clips_of(tmp_path)

    def test_two_clips_of_one_name(self, tmp_path: Path) -> None:
        paths = [write_found(tmp_path / folder / 'a.csv', range(1)) for folder in ('x', 'y')]
        with pytest.raises(SourceError, match='expected clips of different names, got a twice'):
            all_clips(paths)

    @pytest.mark.parametrize('place', ['a.csv', 'a.txt', 'a/gt/gt.txt'])
    def test_truth_is_matched_by_name(self, tmp_path: Path, place: str) -> None:
        truth = write_moving(tmp_path / 'truth' / place, range(3))
        clips = {name: write_found(tmp_path / name / 'detections.csv', range(3)) for name in ('a', 'b')}
        assert truth_of_clips(clips, [tmp_path / 'truth']) == {'a': truth}
        with pytest.raises(SourceError, match=r'expected truth of b as NAME.csv, NAME.txt, .* found none'):
            truth_of_clips({'b': clips['b']}, [tmp_path / 'truth'])

    def test_files_in_the_order_given(self, tmp_path: Path) -> None:
        clips = {name: write_found(tmp_path / f'{name}.csv', range(1)) for name in ('b', 'a')}
        one, two = (write_moving(tmp_path / f'{number}.txt', range(1)) for number in (1, 2))
        assert truth_of_clips(clips, [one, two]) == {'b': one, 'a': two}
        with pytest.raises(SourceError, match=r'a file for each of the 2 clips \(b, a\), got 1'):
            truth_of_clips(clips, [one])

    def test_runs_need_the_same_clips(self) -> None:
        here, there = Path('here'), Path('there')
        assert same_clips({'A': {'x': here}, 'B': {'other name': there}}) == {'x': {'A': here, 'B': there}}
        with pytest.raises(SourceError, match='B: expected the same clips as in A; only in one of them: y, z'):
            same_clips({'A': {'x': here, 'y': here}, 'B': {'x': there, 'z': there}})


class TestFrames:
    def test_of_a_replay_of_every_second_frame_those_count_that_were_processed(self, tmp_path: Path) -> None:
        found = write_found(tmp_path / 'detections.csv', range(4, 20, 2))
        (tmp_path / 'summary.json').write_text(json.dumps({'source_frames': 20, 'every': 2}))
        (tmp_path / 'frames.csv').write_text('frame,stamp_ns\n' + ''.join(f'{frame},0\n' for frame in range(0, 20, 2)))
        clip = evaluate_clip('a', write_moving(tmp_path / 'truth.csv', range(20)), {'run': found}, skip=2)
        assert list(clip.frames) == [4, 6, 8, 10, 12, 14, 16, 18]
        assert figure_of([clip], 'moving', 0.5).means == {'run': 1.0}

    def test_a_window_without_its_frames(self, tmp_path: Path) -> None:
        found = write_found(tmp_path / 'detections.csv', range(4))
        (tmp_path / 'summary.json').write_text(json.dumps({'source_frames': 20, 'start_s': 1.0}))
        with pytest.raises(SourceError, match='frames.csv: expected the frames of the replay: No such file'):
            evaluate_clip('a', write_moving(tmp_path / 'truth.csv', range(20)), {'run': found})

    def test_labels_after_the_end_of_the_replay_count_nowhere(self, tmp_path: Path) -> None:
        """A cut recording, or one with an excerpt's pictures: what it does not show was not missed."""
        found = write_found(tmp_path / 'detections.csv', range(6))
        (tmp_path / 'summary.json').write_text(json.dumps({'source_frames': 8}))
        clip = evaluate_clip('a', write_moving(tmp_path / 'truth.csv', range(20)), {'run': found}, skip=2)
        assert (list(clip.frames), clip.late_labels) == ([2, 3, 4, 5, 6, 7], 12)
        score = figure_of([clip], 'moving', 0.5).scores['a']['run']
        assert (score.wanted, score.true_positives) == (6, 4)
        clip = evaluate_clip('a', tmp_path / 'truth.csv', {'run': found}, 2, last_frame=9)  # of a longer clip
        assert (list(clip.frames), clip.late_labels) == ([2, 3, 4, 5, 6, 7], 2)
        clip = evaluate_clip('a', tmp_path / 'truth.csv', {'run': found}, 2, last_frame=5)
        assert (list(clip.frames), clip.late_labels) == ([2, 3, 4, 5], 0)

    def test_of_two_replays_the_frames_count_that_both_came_to(self, tmp_path: Path) -> None:
        files = {}
        for name, frames in (('short', 6), ('long', 9)):
            (tmp_path / name).mkdir()
            files[name] = write_found(tmp_path / name / 'detections.csv', range(frames))
            (tmp_path / name / 'summary.json').write_text(json.dumps({'source_frames': frames}))
        clip = evaluate_clip('a', write_moving(tmp_path / 'truth.csv', range(9)), files, skip=0)
        assert list(clip.frames) == [*range(6)]

    def test_a_replay_of_no_frames_is_no_f1_of_zero(self, tmp_path: Path) -> None:
        found = write_found(tmp_path / 'detections.csv', range(0))
        (tmp_path / 'summary.json').write_text(json.dumps({'source_frames': 0}))
        with pytest.raises(SourceError, match=r'expected more than 10 frames \(--skip\), got 0'):
            evaluate_clip('a', write_moving(tmp_path / 'truth.csv', range(20)), {'run': found})

    def test_the_longer_run_counts_for_both(self, tmp_path: Path) -> None:
        files = {'A': write_found(tmp_path / 'a.csv', range(4)), 'B': write_found(tmp_path / 'b.csv', range(8))}
        clip = evaluate_clip('a', write_moving(tmp_path / 'truth.csv', range(4)), files, skip=0)
        scores = figure_of([clip], 'moving', 0.5).scores['a']
        assert (scores['A'].frames, scores['B'].frames) == (8, 8)
        assert (scores['A'].precision, scores['B'].precision) == (1.0, 0.5)


@pytest.mark.parametrize(('found', 'true'), [(2 * 10**9, 3), (3, 2 * 10**9)])
def test_a_frame_number_beyond_all_recordings_is_refused(tmp_path: Path, found: int, true: int) -> None:
    detections = write_found(tmp_path / 'a.csv', range(found, found + 1))
    with pytest.raises(SourceError, match='expected frame numbers below 10000000, got 2000000000$'):
        evaluate_clip('a', write_moving(tmp_path / 'truth.csv', range(true, true + 1)), {'run': detections})


def test_ids_are_read_and_needed_for_identity(tmp_path: Path) -> None:
    records = read_found(write_found(tmp_path / 'a.csv', range(2))).records()
    assert (records[1]['id'].tolist(), records[1]['u'].tolist(), records[1]['v'].tolist()) == ([1], [25.0], [40.0])
    (tmp_path / 'b.csv').write_text('frame,x,y,w,h\n0,1,2,3,4\n')
    with pytest.raises(SourceError, match='expected a column id, found none'):
        read_found(tmp_path / 'b.csv').records()
