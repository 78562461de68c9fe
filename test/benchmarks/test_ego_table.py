"""The table of ego-motion methods: its pictures are what they say, and it prints a figure for everything."""

from __future__ import annotations

import re

import numpy as np

from motion_detect_ros.benchmarks import ego_table
from motion_detect_ros.core.ego_motion.methods import METHODS
from motion_detect_ros.core.geometry.motion_models import FAMILIES


def test_views_are_the_texture_moved():
    world = ego_table.texture(1)
    still, moved = ego_table.view(world), ego_table.view(world, ego_table.rigid(0, 1, 7, -3))
    np.testing.assert_array_equal(moved[:-3, 7:], still[3:, :-7])


def test_turn_and_zoom_are_about_the_centre():
    warp = ego_table.rigid(90, 2, 5, 0)
    # one pixel right of the centre: turned to one below it, doubled, moved 5 px
    start = np.array([[321.0, 240.0], [320.0, 240.0]])
    np.testing.assert_allclose(start + warp(start), [[325.0, 242.0], [325.0, 240.0]], atol=1e-9)


def test_every_method_and_family_has_its_figures(monkeypatch):
    monkeypatch.setattr(ego_table, 'KINDS', {'rotation': ego_table.KINDS['rotation']})
    lines = list(ego_table.tables(1))
    figures = [line for line in lines if re.match(r'\| \S+ \| \d', line)]
    assert len(figures) == 1 + len(FAMILIES)
    errors = [float(error) for line in figures for error in re.findall(r'([\d.]+), \d', line)]
    assert len(errors) == len(METHODS) * (1 + len(FAMILIES))
    assert max(errors) < 0.3
