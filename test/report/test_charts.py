"""The numbers behind the charts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from results_by_hand import OBJECTS, write_results

from motion_detect_ros.report.replayed import BOX_DTYPE, FRAME_DTYPE, read_replayed

charts = pytest.importorskip('motion_detect_ros.report.charts', reason='plotly is not installed (extra "report")')


def boxes(*rows: tuple[float, float, float, float]) -> np.ndarray:
    records = np.zeros(len(rows), BOX_DTYPE)
    for record, row in zip(records, rows, strict=True):
        for name, value in zip('xywh', row, strict=True):
            record[name] = value
    return records


def test_coverage_counts_boxes_over_cells():
    """4 x 3 cells of 10 px; a box over two cells, one over all, one outside, one that is unknown."""
    records = boxes((10, 0, 20, 10), (-50, -50, 500, 500), (39, 29, 0.1, 0.1), (np.nan, 0, 5, 5))
    assert charts.coverage(records, 40, 30, 4).tolist() == [[1, 2, 2, 1], [1, 1, 1, 1], [1, 1, 1, 2]]


def test_coverage_of_many_boxes_is_that_of_painting_them():
    random = np.random.default_rng(5)
    edges = np.sort(random.integers(0, 13, (50, 2, 2)), axis=1)
    edges[:, 1] = np.maximum(edges[:, 1], edges[:, 0] + 1)
    edges = edges[(edges[:, 1] <= 12).all(1)]
    painted = np.zeros((12, 12))
    for (left, top), (right, bottom) in edges:
        painted[top:bottom, left:right] += 1
    records = boxes(*((10 * x, 10 * y, 10 * (right - x), 10 * (bottom - y)) for (x, y), (right, bottom) in edges))
    assert charts.coverage(records, 120, 120, 12).tolist() == painted.tolist()


def test_camera_motion_is_that_of_a_known_warp(tmp_path: Path):
    """At 10 frames/s: 2 px right and 1 px up; 3 degrees clockwise; 5 % larger, both about the centre."""
    replayed = read_replayed(write_results(tmp_path / 'r', 'nowhere'))
    shift_x, shift_y, turn, zoom = charts.camera_motion(replayed)
    assert np.isnan(shift_x[0])
    assert shift_x[1:] == pytest.approx(20)
    assert shift_y[1:] == pytest.approx(-10)
    assert turn[1:] == pytest.approx(0)
    frames = np.zeros(2, FRAME_DTYPE)
    frames['frame'], frames['stamp_ns'] = (0, 1), (0, 100_000_000)
    angle, scale, centre = np.radians(3), 1.05, np.array([(320 - 1) / 2, (240 - 1) / 2])
    linear = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for name, value in zip(('m00', 'm01', 'm10', 'm11'), linear.flat, strict=True):
        frames[name] = value
    frames['m02'], frames['m12'] = centre - linear @ centre
    shift_x, shift_y, turn, zoom = (each[1] for each in charts.camera_motion(replace(replayed, frames=frames)))
    assert (shift_x, shift_y) == pytest.approx((0, 0), abs=1e-9)
    assert turn == pytest.approx(30)
    assert zoom == pytest.approx(50)


def test_camera_motion_over_frames_without_an_estimate(tmp_path: Path):
    """20 px/s to the right at 10 frames/s. What follows frames without an estimate spans them; what follows a jump of
    time or of the size does not, nor does what is longer than the longest gap, 1 s, that a motion spans.
    """
    rows = [('first_frame', 0.0, None), ('ok', 0.1, 2.0), ('low_texture', 0.2, None), ('outlier_gated', 0.3, None),
            ('ok', 0.4, 6.0), ('time_jump', 5.0, None), ('ok', 5.1, 2.0), ('low_texture', 5.8, None), ('ok', 6.2, 8.0)]
    replayed = read_replayed(write_results(tmp_path / 'r', 'nowhere'))
    frames = np.zeros(len(rows), FRAME_DTYPE)
    for number, (record, (status, second, shift)) in enumerate(zip(frames, rows, strict=True)):
        record['frame'], record['stamp_ns'], record['ego_status'] = number, round(1e9 * second), status
        record['m00'] = record['m11'] = 1 if shift is not None else np.nan
        record['m02'] = np.nan if shift is None else shift
    assert replayed.summary.settings['ego_motion.max_gap_s'] == 1.0
    shift_x, *_ = charts.camera_motion(replace(replayed, frames=frames))
    assert shift_x[np.isfinite(shift_x)] == pytest.approx(20)
    assert np.isfinite(shift_x).tolist() == [shift is not None for *_, shift in rows]


def test_long_curves_are_averaged_in_groups():
    x, y = np.arange(4500.0), np.full(4500, 7.0)
    y[:3] = np.nan
    short_x, short_y = charts.thinned(x, y)
    assert len(short_x) == charts.MAX_POINTS
    assert short_x[:2].tolist() == [1, 4]
    assert np.isnan(short_y[0])
    assert short_y[1:].tolist() == [7.0] * (charts.MAX_POINTS - 1)


def test_timeline_has_a_bar_for_each_object(tmp_path: Path):
    from motion_detect_ros.report.objects import tracked_objects
    (bars,) = charts.timeline(tracked_objects(read_replayed(write_results(tmp_path / 'r', 'nowhere'))), 3.9).data
    assert [bar[0] for bar in bars.customdata] == [*OBJECTS]
    assert [*bars.base] == pytest.approx([0.5, 1.2, 2.0])
    assert [*bars.x] == pytest.approx([2.5, 2.7, 0.4])
