"""Which values are chosen, by hand; and that what is chosen is what runs."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from test_kernels import kernels

from motion_detect_ros.benchmarks import leave_one_out
from motion_detect_ros.benchmarks.accuracy_clips import read_clips
from motion_detect_ros.benchmarks.leave_one_out import (
    THRESHOLDS,
    Threshold,
    choices_told,
    chosen,
    run_choice,
    values_of,
)
from motion_detect_ros.core.tracking import track
from motion_detect_ros.presets import load_preset

MISS = next(each for each in THRESHOLDS if each.places == ('tracking.track:MISS_LOG_ODDS',))
CONFIRM = next(each for each in THRESHOLDS if each.places == ('tracks.confirm_s',))
EVIDENCE = next(each for each in THRESHOLDS if 'tracks.show_log_odds' in each.places)


def test_a_step_multiplies_or_adds() -> None:
    assert Threshold('noise', ()).at(1, 0.5) == pytest.approx(0.7)
    assert Threshold('noise', ()).at(-1, 0.7) == pytest.approx(0.5)
    assert Threshold('log odds', (), 1.0).at(-1, -2.0) == -3.0


def test_every_threshold_is_one_that_there_is() -> None:
    """In all presets of the clips, and no step leaves what a setting may be."""
    for preset in ('visdrone', 'kitti'):
        for threshold in THRESHOLDS:
            for step in (-1, 1):
                values = values_of(((threshold, step),), preset)
                assert len(values.settings) + len(values.constants) == len(threshold.places)


def test_values_start_from_those_of_the_preset() -> None:
    visdrone, default = load_preset('visdrone').tracks, load_preset('kitti').tracks
    assert visdrone.confirm_s != default.confirm_s
    for preset, tracks in (('visdrone', visdrone), ('kitti', default)):
        values = values_of(((CONFIRM, 1), (EVIDENCE, -1), (MISS, 1)), preset)
        assert values.settings == {
            'tracks.confirm_s': pytest.approx(1.4 * tracks.confirm_s),
            'tracks.confirm_log_odds': tracks.confirm_log_odds - 1.0,
            'tracks.show_log_odds': tracks.show_log_odds - 1.0}
        assert values.constants == {('tracking.track', 'MISS_LOG_ODDS'): track.MISS_LOG_ODDS + 1.0}


def test_the_best_over_the_clips_seen_is_chosen() -> None:
    """Three clips; the first threshold is better higher on two, lower on the third; the others change nothing."""
    in_use, tried = np.full(3, 0.5), np.full((len(THRESHOLDS), 2, 3), 0.5)
    tried[0] = [[0.4, 0.4, 0.9], [0.6, 0.6, 0.2]]
    first = THRESHOLDS[0]
    assert chosen(in_use, tried, [0, 1]) == ((first, 1),)
    assert chosen(in_use, tried, [2]) == ((first, -1),)
    assert chosen(in_use, tried, [0, 2]) == ((first, -1),)  # 0.65 against 0.4 and 0.5
    tried[0] = [[0.4, 0.4, 0.4], [0.5, 0.5, 0.5]]
    assert chosen(in_use, tried, [0, 1, 2]) == ()


def test_table_of_known_choices() -> None:
    told = choices_told([((MISS, -1),), ((MISS, 1),), ()])
    assert f'| {MISS.name} | 1 | 1 | 1 |' in told
    assert f'| {CONFIRM.name} | 0 | 3 | 0 |' in told


def test_what_is_chosen_runs_and_is_put_back(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip, before, seen = read_clips(made)[0], track.MISS_LOG_ODDS, []

    def run(job: object) -> object:
        seen.append((job.changes, track.MISS_LOG_ODDS))
        raise OSError

    monkeypatch.setattr(leave_one_out, 'run_clip', run)
    with pytest.raises(OSError):
        run_choice((clip, ((MISS, -1), (CONFIRM, -1))))
    assert seen == [({'tracks.confirm_s': pytest.approx(0.12 / 1.4)}, before - 1.0)]
    assert before == track.MISS_LOG_ODDS


def test_the_command_writes_its_section(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(leave_one_out, 'THRESHOLDS', (CONFIRM,))
    document = tmp_path / 'page.md'
    document.write_text('before\n<!-- generated: leave one out -->\n<!-- end: leave one out -->\nafter\n')
    assert leave_one_out.main(['--data', str(made), '--jobs', '1', '--write', str(document)]) == 0
    written = document.read_text()
    assert '| F1 at 0.3 / 0.5 | in use | chosen on all | chosen without the clip |' in written
    assert '| time to confirm |' in written
    assert written.endswith('after\n')
    capsys.readouterr()
    assert leave_one_out.main(['--data', str(made), '--clips', 'made_moves']) == 2
    assert 'expected two clips at least, got 1' in capsys.readouterr().err


def test_no_kernel_keeps_a_threshold_as_it_was_when_it_was_compiled() -> None:
    """A kernel takes the constants of its module for good."""
    checked = 0
    for place in (place for each in THRESHOLDS for place in each.places if ':' in place):
        module, _, name = place.partition(':')
        path = Path(leave_one_out.__file__).parents[1] / 'core' / (module.replace('.', '/') + '.py')
        for function in kernels(path.read_text(encoding='utf-8')):
            checked += 1
            assert name not in {each.id for each in ast.walk(function) if isinstance(each, ast.Name)}, function.name
    assert checked
