"""The ablation: every switch is a real setting with an effect on the config, and the arithmetic of the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.benchmarks import ablation
from motion_detect_ros.benchmarks.accuracy_clips import Clip, ClipRun
from motion_detect_ros.benchmarks.accuracy_record import Figures
from motion_detect_ros.benchmarks.generated import replace_section
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import TRUTH_DTYPE, empty_detections
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.truth import write_truth


@pytest.mark.parametrize('part', ablation.PARTS, ids=lambda part: part.name)
def test_every_part_can_be_taken_out_of_a_preset(part: ablation.Part) -> None:
    presets = [PipelineConfig(), load_preset('visdrone'), load_preset('kitti')]
    assert any(with_settings(preset, part.off) != preset for preset in presets)


def test_changes_are_against_the_whole() -> None:
    parts = [ablation.Part('wheels', {'art2.a': 1.0}, 'nearly')]
    lines = list(ablation.rows(parts, [Figures(0.6, 0.5, 0.7, 0.5, 1.0), Figures(0.5, 0.5, 0.7, 0.4, 1.25)]))
    assert lines[2] == '| nothing | 0.60 | 0.50 | 0.70 | 0.50 | 1.00 |  |'
    assert lines[3] == '| wheels | 0.50 (-0.10) | 0.50 | 0.70 | 0.40 (-0.10) | 1.25 (+0.25) | `art2.a=1.0` (nearly) |'


def test_runs_are_told_apart_by_their_order(tmp_path: Path) -> None:
    """Two clips, one part: the detector finds nothing in each, and with the part off one of them has a false box."""
    write_truth(tmp_path / 'truth.csv', np.array([(3, 1, 0, 0, 10, 10, 1)], TRUTH_DTYPE))
    clip = Clip('a_b', tmp_path, tmp_path / 'truth.csv', 10.0, 'default')
    false = empty_detections(1)
    false['u'], false['width'], false['height'] = 500, 20, 20
    blind = ClipRun(clip, dict.fromkeys(range(4), empty_detections()), 1.0)
    wrong = ClipRun(clip, dict.fromkeys(range(4), false), 1.0)
    whole, without = ablation.means_of([blind, blind, blind, wrong], 2)
    assert whole.false_per_frame == 0.0
    assert without.false_per_frame == 0.5, 'one false box a frame on one of two clips'


def test_unknown_part(capsys: pytest.CaptureFixture[str]) -> None:
    assert ablation.main(['wings']) == 2
    assert 'got wings' in capsys.readouterr().err


class TestGeneratedSection:
    def test_replaces_what_is_between_and_nothing_else(self, tmp_path: Path) -> None:
        path = tmp_path / 'page.md'
        path.write_text('a\n<!-- generated: x -->\nold\n<!-- end: x -->\nb\n')
        replace_section(path, 'x', ['new', 'lines'])
        replace_section(path, 'x', ['newer', 'lines'])
        assert path.read_text() == 'a\n<!-- generated: x -->\nnewer\nlines\n<!-- end: x -->\nb\n'

    @pytest.mark.parametrize('text', ['', '<!-- generated: x -->', '<!-- end: x -->',
                                      '<!-- end: x -->\n<!-- generated: x -->'])
    def test_refuses_a_document_without_a_place(self, tmp_path: Path, text: str) -> None:
        path = tmp_path / 'page.md'
        path.write_text(text)
        with pytest.raises(SourceError, match='expected .*generated: x.* and after it'):
            replace_section(path, 'x', ['new'])
        assert path.read_text() == text
