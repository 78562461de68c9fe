"""The ablation: every switch is a real setting with an effect on the config, and the arithmetic of the table."""

from __future__ import annotations

import dataclasses
import itertools
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks import ablation, passing, substitutes
from motion_detect_ros.benchmarks.accuracy_clips import Clip, ClipRun, Job, run_clip
from motion_detect_ros.benchmarks.accuracy_record import Figures
from motion_detect_ros.benchmarks.generated import replace_section
from motion_detect_ros.benchmarks.substitutes import (
    DBSCAN,
    KMEANS,
    ONE_CLUSTER,
    Choice,
    Substitute,
    SubstituteClusterer,
    run_choices,
)
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.detection import objects
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import TRUTH_DTYPE, empty_detections
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight
from motion_detect_ros.sources.truth import write_truth


@pytest.mark.parametrize('part', ablation.PARTS, ids=lambda part: part.name)
def test_every_part_can_be_taken_out_of_a_preset(part: ablation.Part) -> None:
    presets = [PipelineConfig(), load_preset('visdrone'), load_preset('kitti')]
    assert part.substitute or any(with_settings(preset, part.off) != preset for preset in presets)


def test_changes_are_against_the_whole() -> None:
    parts = [ablation.Part('wheels', {'art2.a': 1.0}, 'nearly')]
    lines = list(ablation.rows(parts, [Figures(0.6, 0.5, 0.7, 0.5, 1.0), Figures(0.5, 0.5, 0.7, 0.4, 1.25)]))
    assert lines[2] == '| nothing | 0.60 | 0.50 | 0.70 | 0.50 | 1.00 |  |'
    assert lines[3] == '| wheels | 0.50 (-0.10) | 0.50 | 0.70 | 0.40 (-0.10) | 1.25 (+0.25) | `art2.a=1.0` (nearly) |'


def test_a_substitute_is_named_among_the_settings() -> None:
    part = ablation.Part('wheels', {'art2.a': 1.0}, substitute=Substitute(DBSCAN, {'eps': 2.0, 'min_samples': 3}))
    *_, line = ablation.rows([part], [Figures(0.6, 0.5, 0.7, 0.5, 1.0)] * 2)
    assert line.endswith('| `art2.a=1.0`, `DBSCAN, eps=2.0, min_samples=3` |')


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


@pytest.fixture(scope='module')
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    """A square of 36 px that moves 5 px a frame, the camera pans."""
    folder = tmp_path_factory.mktemp('clip')
    config = dataclasses.replace(FlightConfig.single(36, 5, 3, frames=12), width=320, height=240)
    frames = list(SyntheticFlight(config))
    for frame in frames:
        assert cv2.imwrite(str(folder / f'{frame.index:06d}.png'), frame.image)
    write_truth(folder / 'truth.csv', np.concatenate([frame.truth for frame in frames]))
    return Clip('made_moves', folder, folder / 'truth.csv', 20.0, 'default')


def same(one: ClipRun, other: ClipRun) -> bool:
    return all(records.tobytes() == other.detections[frame].tobytes() for frame, records in one.detections.items())


class TestSubstitutes:
    #: Within 4 noise units: (0, 3); unknown: the NaN; two groups, and one vector far from all.
    VECTORS = np.array([(0, 3), (np.nan, 1), (10, 0), (11, 0), (10.5, 0), (0, -20), (1, -20), (0.5, -20), (90, 90)],
                       np.float32)

    def test_one_cluster_is_all_that_moves(self) -> None:
        clusterer = SubstituteClusterer(Substitute(ONE_CLUSTER))
        assert clusterer.partial_fit(self.VECTORS).tolist() == [0, -1, 1, 1, 1, 1, 1, 1, 1]
        np.testing.assert_allclose(clusterer.prototypes, [(0, 0), (123 / 7, 30 / 7)], rtol=1e-6)
        assert clusterer.partial_fit(self.VECTORS[:1]).tolist() == [0]
        assert clusterer.prototypes.tolist() == [[0, 0]] and clusterer.names.tolist() == [0]

    def test_noise_of_dbscan_is_background(self) -> None:
        pytest.importorskip('sklearn', reason='scikit-learn is not installed: make test-extras has it')
        clusterer = SubstituteClusterer(Substitute(DBSCAN, {'eps': 1.2, 'min_samples': 3}))
        assert clusterer.partial_fit(self.VECTORS).tolist() == [0, -1, 1, 1, 1, 2, 2, 2, 0]
        np.testing.assert_allclose(clusterer.prototypes, [(0, 0), (10.5, 0), (0.5, -20)])
        assert clusterer.names.tolist() == [0, 1, 2]

    def test_k_means_with_more_clusters_than_vectors(self) -> None:
        pytest.importorskip('sklearn', reason='scikit-learn is not installed: make test-extras has it')
        labels = SubstituteClusterer(Substitute(KMEANS, {'n_clusters': 3})).partial_fit(self.VECTORS)
        assert [labels[0], labels[1]] == [0, -1]
        assert [len(set(labels[part].tolist())) for part in (slice(2, 5), slice(5, 8), slice(2, 9))] == [1, 1, 3]
        clusterer = SubstituteClusterer(Substitute(KMEANS, {'n_clusters': 25}))
        assert sorted(clusterer.partial_fit(self.VECTORS[2:5]).tolist()) == [1, 2, 3]
        assert sorted(clusterer.prototypes.tolist()) == [[0, 0], [10, 0], [10.5, 0], [11, 0]]

    def test_choices_run_as_they_do_alone(self, clip: Clip) -> None:
        """A shared flow gives the answers of the pipeline, whatever the other choices do."""
        other = {'art2.variant': 'classic', 'art2.vigilance': 0.95}
        shared = run_choices(clip, [Choice(), Choice(other), Choice(substitute=Substitute(ONE_CLUSTER))])
        assert same(shared[0], run_clip(Job(clip, {}))) and same(shared[1], run_clip(Job(clip, other)))
        assert shared[0].scores()[0].recall > 0.5 < shared[2].scores()[0].recall

    def test_they_stand_where_art2_did(self, clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(substitutes, 'BACKGROUND_SIGMA', np.inf)
        part = ablation.Part('', {}, substitute=Substitute(ONE_CLUSTER))
        assert sum(map(len, ablation.run_task((clip, part)).detections.values())) == 0

    def test_boxes_that_touch_need_clusters(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Each pair is side by side around frame 30: as one cluster it is one box, which overlaps neither by half.

        Where so many are of one size it would be cut in two, whatever the clusters.
        """
        monkeypatch.setattr(objects, 'parted_patch', lambda patch, *_: [patch])
        clip = passing.write_clip(passing.flight(4.0), tmp_path, 'passing')
        (_, art2), (_, merged) = (run.scores() for run in run_choices(
            clip, [Choice(), Choice(substitute=Substitute(ONE_CLUSTER))]))
        assert art2.recall > 0.9
        assert merged.recall < 0.8

    def test_boxes_that_pass_each_other_are_not_cut_where_they_touch(self, tmp_path: Path) -> None:
        """A piece of the other box makes each larger than usual: it is not an object."""
        clip = passing.write_clip(passing.flight(4.0), tmp_path, 'passing')
        score, _ = run_clip(Job(clip, {})).scores()
        assert score.recall > 0.9 and score.false_per_frame < 0.1

    def test_what_is_not_installed_is_left_out(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, 'sklearn', None)
        monkeypatch.setitem(sys.modules, 'sklearn.cluster', None)
        found, missing = ablation.available(ablation.PARTS)
        assert [part.name for part in ablation.PARTS if part not in found] == [
            'ART2: DBSCAN in its place', 'ART2: k-means in its place']
        assert len(missing) == 2 and "pip install 'motion_detect_ros[compare]'" in missing[0]

    def test_grids_are_of_one_size_and_hold_what_the_table_has(self) -> None:
        grids = substitutes.grids()
        assert {len(choices) for choices in grids.values()} == {12}
        for choice in itertools.chain(*grids.values()):
            for preset in ('default', 'visdrone', 'kitti'):
                with_settings(load_preset(preset), choice.changes)
        substituted = [Choice(part.off, part.substitute) for part in ablation.PARTS
                       if part.name.endswith('in its place')]
        assert len(substituted) == 3 and all(one in itertools.chain(*grids.values()) for one in substituted)


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
