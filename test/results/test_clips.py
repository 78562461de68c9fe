"""Runs side by side: of the same clips, and of the same inputs as far as their summaries say."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import pytest
from result_samples import summary

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.clips import clips_of, same_clips, truth_of_clips


def run_of(folder: Path, source: str | None, size: int | None = None) -> dict[str, Path]:
    """The clips of a result folder; without a source it has no summary."""
    folder.mkdir(parents=True)
    (folder / 'detections.csv').write_text('frame,id,x,y,w,h\n')
    if source is not None:
        (folder / 'summary.json').write_text(json.dumps(asdict(summary(input=source, input_bytes=size))))
    return clips_of(folder)


def test_runs_of_different_inputs_are_refused(tmp_path: Path) -> None:
    runs = {'a': run_of(tmp_path / 'a', 'flights/one.mcap'), 'b': run_of(tmp_path / 'b', 'flights/two.mcap')}
    with pytest.raises(SourceError, match=r'b/detections.csv: expected .* same input as in a, one, got two'):
        same_clips(runs)


def test_runs_of_clips_of_the_same_name_and_different_inputs_are_refused(tmp_path: Path) -> None:
    for run, inputs in (('a', ('one.mcap', 'two.mcap')), ('b', ('one.mcap', 'three.mcap'))):
        for clip, source in zip('xy', inputs, strict=True):
            run_of(tmp_path / run / clip, source)
    with pytest.raises(SourceError, match=r'b/y/detections.csv: .* as in a, two, got three'):
        same_clips({run: clips_of(tmp_path / run) for run in 'ab'})


@pytest.mark.parametrize('other', ['moved/one.mcap', None])
def test_an_input_that_was_moved_or_is_not_known_is_taken(tmp_path: Path, other: str | None) -> None:
    runs = {'a': run_of(tmp_path / 'a', 'flights/one.mcap'), 'b': run_of(tmp_path / 'b', other)}
    assert same_clips(runs) == {'a': {run: clips[run] for run, clips in runs.items()}}


def test_inputs_of_one_name_do_not_share_a_truth(tmp_path: Path) -> None:
    """``replay a/cam b/cam`` makes cam and cam-2; the truth of one is none of the other."""
    clips = {**run_of(tmp_path / 'out' / 'cam', 'a/cam'), **run_of(tmp_path / 'out' / 'cam-2', 'b/cam')}
    truth = tmp_path / 'truth' / 'cam.csv'
    truth.parent.mkdir()
    truth.touch()
    assert truth_of_clips(clips, [truth.parent]) == {'cam': truth}


def test_runs_of_one_input_share_its_truth_also_where_it_was_moved(tmp_path: Path) -> None:
    clips = {**run_of(tmp_path / 'one', 'a/cam', 77), **run_of(tmp_path / 'two', 'b/cam', 77)}
    truth = tmp_path / 'truth' / 'cam.csv'
    truth.parent.mkdir()
    truth.touch()
    assert truth_of_clips(clips, [truth.parent]) == {'one': truth, 'two': truth}


def test_a_recording_has_no_truth_by_the_summary_of_a_replay_beside_it(tmp_path: Path) -> None:
    """``replay a.mcap -o .`` leaves the summary of a beside b, which ``tune`` takes too."""
    run_of(tmp_path / 'flights', 'flights/a.mcap')
    truth = tmp_path / 'truth' / 'a.csv'
    truth.parent.mkdir()
    truth.touch()
    recordings = {name: tmp_path / 'flights' / f'{name}.mcap' for name in 'ab'}
    assert truth_of_clips(recordings, [truth.parent]) == {'a': truth}
