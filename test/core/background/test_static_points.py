"""Three-dimensional backgrounds on a street with exact flow: static things are still, each kind of mover is seen."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from street import CAMERA, box_cells, flow, motion, pixels, street_depth

from motion_detect_ros.core.background import static_points
from motion_detect_ros.core.background.planar import fit_background
from motion_detect_ros.core.background.selection import BackgroundSelector
from motion_detect_ros.core.background.static_points import fit_static_scene
from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.geometry.epipolar import PoseEstimate, epipolar_lines, normalised
from motion_detect_ros.core.geometry.ground_plane import GroundPlane
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import CameraModel

CONFIG, PERIOD_S = BackgroundConfig(), 0.04
#: A box 12 m away, foot on the ground (1.5 m below the camera at 12 m: row 169.5 + 500 * 0.125 = 232 px = cell 58).
BOX, DISTANCE = box_cells(70, 36, 84, 58), 12.0
OWN = {'crosses': (0.4, 0.0, 0.0), 'drives ahead': (0.0, 0.0, 0.8), 'rises': (0.0, -0.3, 0.0)}


def _street(own: tuple[float, float, float] | None, noise_px: float = 0.1) -> np.ndarray:
    """Flow with a box that moves by ``own`` metres in the earlier camera's axes; None = it stands."""
    depth = np.where(BOX, DISTANCE, street_depth())
    moved = np.zeros((*BOX.shape, 3))
    moved[BOX] = own or (0.0, 0.0, 0.0)
    field = flow(depth, *motion((0.0, 0.01, 0.0), (0.05, 0.0, 1.0)), moved)
    return field + np.random.default_rng(0).normal(0.0, noise_px, field.shape).astype(np.float32)


def _sigmas(field: np.ndarray, background) -> np.ndarray:
    own = field - background.flow
    return np.hypot(own[..., 0], own[..., 1]) / background.sigma_px


def _epipolar(field: np.ndarray):
    return fit_static_scene(field, field, magnitude(field), CAMERA, CONFIG).background


def test_static_box_and_street_are_still():
    field = _street(None)
    sigmas = _sigmas(field, _epipolar(field))
    assert np.quantile(sigmas, 0.99) < 3.0
    assert np.median(sigmas[BOX]) < 1.0


@pytest.mark.parametrize('own', OWN.values(), ids=OWN.keys())
def test_mover_stands_out_of_the_calibrated_background(own: tuple[float, float, float]):
    field = _street(own)
    sigmas = _sigmas(field, _epipolar(field))
    foot = BOX & (np.arange(BOX.shape[0])[:, None] >= 52)
    assert np.median(sigmas[foot]) > 4.0
    assert np.quantile(sigmas[~BOX], 0.99) < 3.0


def test_planar_background_takes_the_street_for_moving():
    """What the other models are for: the smooth surface fails on most of this street."""
    field = _street(None)
    assert (_sigmas(field, fit_background(field, CONFIG, np.zeros(BOX.shape, np.float32))) > 2.0).mean() > 0.2


def test_own_motion_of_a_crossing_box_is_its_flow_off_the_epipolar_line():
    """A box that moves sideways by 0.4 m at 12 m moves 500 * 0.4 / (12 + 1) = 15.4 px (depth in the earlier frame)."""
    field = _street(OWN['crosses'], noise_px=0.0)
    own = np.median((field - _epipolar(field).flow)[BOX], axis=0)
    assert np.hypot(*own) == pytest.approx(15.4, rel=0.15)


def test_wrong_focal_length_still_works():
    field = _street(OWN['drives ahead'])
    guess = CameraModel.guessed(CAMERA.width, CAMERA.height, 1.1)
    scene = fit_static_scene(field, field, magnitude(field), guess, CONFIG)
    sigmas = _sigmas(field, scene.background)
    assert np.median(sigmas[BOX & (np.arange(BOX.shape[0])[:, None] >= 52)]) > 3.0


@pytest.mark.parametrize('ground', [None, GroundPlane(np.array([0.01, 0.9, 0.002]))], ids=['no ground', 'ground'])
def test_closest_static_points_are_those_of_the_epipolar_lines(ground: GroundPlane | None):
    """Also behind the camera, and where something is unknown; against ``EpipolarLines`` and the camera's geometry."""
    field = _street(OWN['drives ahead'], noise_px=3.0).reshape(-1, 2)
    field[::7] = np.nan
    residual = field - np.float32(2.0)
    residual[::5] = np.nan
    now = normalised(pixels(), CAMERA).reshape(-1, 2)
    earlier = normalised(pixels().reshape(-1, 2) - field, CAMERA)
    rotation, translation = motion((0.002, 0.012, -0.003), (0.1, 0.02, 1.0))
    pose = PoseEstimate(rotation, translation / np.linalg.norm(translation), 1.0)
    lines = epipolar_lines(earlier, pose)
    s = lines.position(now)
    assert (s < 0.0).any() and (s > 0.0).any()
    position, inverse_depth, reach_px = np.empty((3, len(now)))
    static_points._positions(earlier, now, pose.rotation, pose.direction, 500.0, position, inverse_depth, reach_px)
    np.testing.assert_allclose(position, s, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(inverse_depth, lines.inverse_depth(s), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(reach_px, np.linalg.norm(lines.towards, axis=1) * 500.0, rtol=1e-9)

    limit = np.zeros(3) if ground is None else ground.limit
    rays = np.column_stack([earlier, np.ones(len(earlier))])
    inverse = np.maximum(lines.inverse_depth(s), np.maximum(0.0, rays @ limit))
    seen = rays @ pose.rotation.T + inverse[:, None] * pose.direction
    off = (now - seen[:, :2] / seen[:, 2:]) * [500.0, 400.0]
    still, own, against = np.empty_like(field), np.empty(len(now)), np.empty(len(now), np.bool_)
    count = static_points._closest_static(
        earlier, now, position, limit, pose.rotation, pose.direction, 500.0, 400.0, residual, still, own, against)
    np.testing.assert_allclose(still, residual - off, rtol=1e-5, atol=1e-4)
    known = np.isfinite(residual[:, 0])
    np.testing.assert_allclose(own[:count], np.linalg.norm(off, axis=1)[known], rtol=1e-9, atol=1e-9)
    ahead = lines.towards * [500.0, 400.0]
    cosine = (off * ahead).sum(axis=1) / np.maximum(np.linalg.norm(off, axis=1) * np.linalg.norm(ahead, axis=1), 1e-12)
    away = np.linalg.norm(off, axis=1) > 1e-6
    assert np.array_equal(against[away], (cosine < -math.sqrt(0.5))[away])
    assert 0.01 < against.mean() < 0.99


def test_noise_is_the_spread_around_static_points_and_a_share_of_the_flow():
    field = _street(None, noise_px=1.0)
    background = _epipolar(field)
    distance = np.linalg.norm(field - background.flow, axis=-1)
    assert background.spread_px == pytest.approx(np.median(distance) / 1.1774, rel=1e-4)
    expected = background.spread_px + CONFIG.depth_noise_share * np.linalg.norm(field, axis=-1)
    np.testing.assert_allclose(background.sigma_px, expected, rtol=1e-5)


READY = """
import gc
from street import CAMERA, flow, motion, street_depth
from motion_detect_ros.core.background.selection import BackgroundSelector
from motion_detect_ros.core.config import BackgroundConfig, PipelineConfig
from motion_detect_ros.core.pipeline import warm_up
from numba.core.dispatcher import Dispatcher
def ready():
    return {each.__qualname__ + str(kind) for each in gc.get_objects() if isinstance(each, Dispatcher)
            for kind in each.signatures}
warm_up(PipelineConfig())
warm, model = ready(), BackgroundSelector(BackgroundConfig())
field = flow(street_depth(), *motion((0.0, 0.01, 0.0), (0.05, 0.0, 1.0)))
for _ in range(3):
    background = model.fit(field, field, CAMERA, 0.04)
    background.behind(field[..., 0] > 10.0)
assert model.three_dimensional
assert ready() == warm, ready() ^ warm
"""


def test_the_warm_up_leaves_no_kernel_of_the_street_to_compile():
    """In a process of its own, as other tests have loaded them here. What comes late stops a frame for a second."""
    code = f'import sys; sys.path[:0] = {sys.path!r}\n{READY}'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr


def test_nothing_known_gives_no_scene():
    field = np.full((*BOX.shape, 2), np.nan, np.float32)
    assert fit_static_scene(field, field, magnitude(field), CAMERA, CONFIG) is None


class TestChoice:
    """Planar or in space, by evidence."""

    @staticmethod
    def _plane(turn: float = 0.01) -> np.ndarray:
        field = flow(np.full(BOX.shape, 30.0), *motion((0.0, turn, 0.0), (0.5, 0.2, 0.3)))
        return field + np.random.default_rng(1).normal(0.0, 0.1, field.shape).astype(np.float32)

    def test_plane_stays_planar_with_a_mover_on_it(self):
        model, field = BackgroundSelector(CONFIG), self._plane()
        field[BOX] += 5.0
        for _ in range(5):
            background = model.fit(field, field, CAMERA, PERIOD_S)
        assert not model.three_dimensional
        assert np.median(_sigmas(field, background)[BOX]) > 5.0

    def test_street_is_in_space(self):
        model, field = BackgroundSelector(CONFIG), _street(OWN['drives ahead'])
        model.fit(field, field, CAMERA, PERIOD_S)
        assert model.three_dimensional

    def test_one_odd_frame_does_not_switch(self):
        model, plane, street = BackgroundSelector(CONFIG), self._plane(), _street(None)
        for _ in range(5):
            model.fit(plane, plane, CAMERA, PERIOD_S)
        model.fit(street, street, CAMERA, PERIOD_S)
        assert not model.three_dimensional
        for _ in range(8):
            model.fit(street, street, CAMERA, PERIOD_S)
        assert model.three_dimensional
        model.fit(plane, plane, CAMERA, PERIOD_S)
        assert model.three_dimensional

    def test_every_frame_is_decided_on_once(self, monkeypatch: pytest.MonkeyPatch):
        decide, scores = BackgroundSelector._decide, []
        monkeypatch.setattr(BackgroundSelector, '_decide', lambda self, score, dt_s: (
            scores.append(score), decide(self, score, dt_s))[1])
        model, plane, street = BackgroundSelector(CONFIG), self._plane(), _street(None)
        for number, field in enumerate([plane, street, street, street, plane, plane, plane, plane, plane], start=1):
            model.fit(field, field, CAMERA, PERIOD_S)
            assert len(scores) == number
        assert not model.three_dimensional

    def test_turning_camera_without_travel_is_planar(self):
        """Pure rotation: no parallax, nothing to gain from depth."""
        model = BackgroundSelector(CONFIG)
        field = flow(street_depth(), *motion((0.0, 0.02, 0.0), (0.0, 0.0, 0.0)))
        for _ in range(3):
            model.fit(field, field, CAMERA, PERIOD_S)
        assert not model.three_dimensional

    @pytest.mark.parametrize('seed', range(4))
    def test_large_object_before_a_turning_camera_is_no_near_part_of_the_scene(self, seed: int):
        """A rider on the sea: waves err along the pan, and what moves along one line could be a thing that is near."""
        model, random = BackgroundSelector(CONFIG), np.random.default_rng(seed)
        sea = flow(np.full(BOX.shape, 1e4), *motion((0.0, 0.025, 0.0), (0.0, 0.0, 0.0)))
        for _ in range(6):
            field = sea + (random.normal(0.0, 1.0, sea.shape) * (1.2, 0.4)).astype(np.float32)
            field[box_cells(50, 20, 100, 75)] += np.array([1.0, 0.1], np.float32) * random.uniform(2.0, 8.0)
            model.fit(field, field, CAMERA, PERIOD_S)
        assert not model.three_dimensional

    def test_traffic_in_both_directions_is_no_relief(self):
        """A hovering camera over seven lanes, three quarters full; what drives one way could be near and still."""
        model, random = BackgroundSelector(CONFIG), np.random.default_rng(2)
        rows, columns = BOX.shape
        lane, place = np.arange(rows)[:, None] * 7 // rows, np.arange(columns) // 10
        speeds = random.uniform(2.0, 6.0, (7, columns // 10 + 1))[lane, place] * np.where(lane % 2, 1.0, -1.0)
        drives = random.random((7, columns // 10 + 1))[lane, place] < 0.75
        for _ in range(6):
            field = random.normal(0.0, 0.1, (rows, columns, 2)).astype(np.float32)
            field[..., 0] += np.where(drives, speeds, 0.0)
            background = model.fit(field, field, CAMERA, PERIOD_S)
        assert not model.three_dimensional
        sigmas = _sigmas(field, background)
        assert (sigmas[drives] > 4.0).mean() > 0.95 and (sigmas[~drives] < 3.0).mean() > 0.95

    def test_street_with_traffic_in_both_directions_is_in_space(self):
        """Two vehicles that drive ahead, faster than the camera, before a street that comes closer."""
        model = BackgroundSelector(CONFIG)
        for _ in range(6):
            field = _street(OWN['drives ahead'])
            ahead = box_cells(20, 44, 40, 60)
            field[ahead] *= -0.5
            model.fit(field, field, CAMERA, PERIOD_S)
        assert model.three_dimensional

    @pytest.mark.parametrize('name', ['planar', 'epipolar'])
    def test_choice_can_be_fixed(self, name: str):
        field, config = _street(None), BackgroundConfig(model=name, noise_share=0.04)
        still = (_sigmas(field, BackgroundSelector(config).fit(field, field, CAMERA, PERIOD_S)) < 3.0).mean()
        assert (still > 0.98) == (name != 'planar')


def test_background_behind_an_object_comes_from_around_it():
    """A box that crosses hides the wall; what is filled in is closer to the wall's flow than to the box's."""
    field = _street(OWN['crosses'], noise_px=0.0)
    background = fit_static_scene(field, field, magnitude(field), CAMERA, CONFIG).background
    wall = flow(street_depth(), *motion((0.0, 0.01, 0.0), (0.05, 0.0, 1.0)))
    behind = background.behind(BOX)
    assert np.array_equal(behind.flow[~box_cells(66, 32, 88, 62)], background.flow[~box_cells(66, 32, 88, 62)])
    error = np.hypot(*np.moveaxis(behind.flow - wall, -1, 0))[BOX]
    assert np.median(error) < 0.25 * np.median(np.hypot(*np.moveaxis(field - wall, -1, 0))[BOX])
