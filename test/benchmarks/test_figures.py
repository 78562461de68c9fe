"""Pictures of the documents: what matplotlib is told to draw, and what is said where it is missing."""

from __future__ import annotations

import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.benchmarks import bench, bench_plot, limits
from motion_detect_ros.benchmarks.bench_curves import Curve, Point, as_json
from motion_detect_ros.benchmarks.figures import save
from motion_detect_ros.benchmarks.heat_map import HeatMap, heat_figure
from motion_detect_ros.core.errors import BackendError

CURVE = Curve('pixels', 'megapixels', 'objects', [
    Point(x, {'total': 10.0 * x, 'ego_motion': 2.0}, 3) for x in (0.0, 0.1, 1.0, 8.0)])
MAP = HeatMap('pans', 'size, px', 'speed, px', (8, 16), (1, 2, 4), np.array([[0.0, 0.5, 1.0], [1.0, np.nan, 0.25]]))
MISSING = r"pictures: expected matplotlib .*; install it: pip install 'motion_detect_ros\[plots\]'"


class TestWithMatplotlib:
    @pytest.fixture(autouse=True)
    def installed(self) -> None:
        pytest.importorskip('matplotlib', reason='matplotlib is not installed: make test-extras has it')

    def test_lines_go_through_the_points(self) -> None:
        (axes,) = bench_plot.curve_figure(CURVE).axes
        total, ego = axes.get_lines()
        assert total.get_xydata().tolist() == [[0.1, 1.0], [1.0, 10.0], [8.0, 80.0]], 'no logarithm of zero'
        assert list(ego.get_ydata()) == [2.0, 2.0, 2.0]
        assert (axes.get_xscale(), axes.get_yscale()) == ('log', 'log')
        assert (axes.get_xlabel(), axes.get_ylabel()) == ('megapixels', 'time a frame, ms')
        assert [text.get_text() for text in axes.get_legend().get_texts()] == [
            r'total, $\propto x^{1.00}$', r'ego motion, $\propto x^{0.00}$']

    def test_curves_of_an_earlier_run_are_drawn_again(self, tmp_path: Path) -> None:
        assert bench_plot.curves_of({'curves': [as_json(CURVE)]}) == [CURVE]
        bench_plot.draw_curves([CURVE], tmp_path / 'images')
        assert (tmp_path / 'images' / 'cost_pixels.png').read_bytes().startswith(b'\x89PNG')

    def test_heat_map_has_its_first_row_at_the_bottom(self) -> None:
        axes, other, _ = heat_figure([MAP, MAP]).axes
        (image,) = axes.get_images()
        np.testing.assert_array_equal(image.get_array().filled(np.nan), MAP.shares)
        assert axes.get_ylim() == (-0.5, 1.5), 'row 0 is the lowest'
        assert image.get_clim() == other.get_images()[0].get_clim() == (0.0, 1.0)
        assert {text.get_position(): text.get_text() for text in axes.texts} == {
            (0, 0): '0', (1, 0): '50', (2, 0): '100', (0, 1): '100', (2, 1): '25'}
        assert [label.get_text() for label in axes.get_xticklabels()] == ['1', '2', '4']
        assert [label.get_text() for label in axes.get_yticklabels()] == ['8', '16']
        assert (axes.get_title(), axes.get_xlabel(), axes.get_ylabel()) == ('pans', 'speed, px', 'size, px')

    def test_folder_that_cannot_be_made(self, tmp_path: Path) -> None:
        (tmp_path / 'file').touch()
        with pytest.raises(BackendError, match='cannot be written'):
            save(bench_plot.curve_figure(CURVE), tmp_path / 'file' / 'a.png')


class TestWithout:
    @pytest.fixture(autouse=True)
    def missing(self, monkeypatch: pytest.MonkeyPatch) -> None:
        for name in ('matplotlib', 'matplotlib.figure'):
            monkeypatch.setitem(sys.modules, name, None)

    def test_figures_name_the_extra(self) -> None:
        for draw in (lambda: bench_plot.curve_figure(CURVE), lambda: heat_figure([MAP])):
            with pytest.raises(BackendError, match=MISSING):
                draw()

    def test_long_runs_say_so_before_they_start(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    ) -> None:
        monkeypatch.setattr(limits, 'measure', lambda *_: pytest.fail('measured first'))
        monkeypatch.setitem(bench.PARTS, 'curves', lambda _: pytest.fail('measured first'))
        assert limits.main(['--picture', str(tmp_path / 'a.png')]) == 2
        assert 'motion_detect_ros[plots]' in capsys.readouterr().err
        with pytest.raises(BackendError, match=MISSING):
            bench.run(Namespace(frames=60, parts='curves', no_nodes=True, json=None, soak=[], preset='default',
                                markdown=tmp_path / 'a.md'))
