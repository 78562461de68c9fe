"""Every method of dense flow against pictures of a formula, whose flow is exact; the registry and what it refuses."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core import flow_backends
from motion_detect_ros.core.config import FLOW_METHODS, OpticalFlowConfig
from motion_detect_ros.core.errors import BackendError, ConfigError
from motion_detect_ros.core.flow_backends import BUILT_IN, make_flow
from motion_detect_ros.core.flow_contrib import CONTRIB
from motion_detect_ros.core.optical_flow import both_ways

HEIGHT, WIDTH = 160, 240
SHIFT, ZOOM = (3.4, -2.2), 0.01
#: Largest median error, pixels; SimpleFlow knows whole pixels, PCAFlow smooth flow only.
LIMITS = dict.fromkeys(FLOW_METHODS, 0.15) | {'simpleflow': 0.4, 'pcaflow': 0.4}
NEEDS_CONTRIB = pytest.mark.skipif(
    not hasattr(cv2, 'optflow'), reason='opencv-contrib-python-headless is not installed (make test-extras)')


def picture(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Grey values at any real position: forty plane waves of 8 to 40 px."""
    random = np.random.default_rng(4)
    value = np.zeros_like(x)
    for _ in range(40):
        angle, length, phase = random.uniform(0, np.pi), random.uniform(8, 40), random.uniform(0, 6.28)
        value += np.sin(2 * np.pi * (np.cos(angle) * x + np.sin(angle) * y) / length + phase)
    return np.clip(128 + 22 * value, 0, 255).astype(np.uint8)


def pair() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Current, earlier and the exact flow between them: what is at p now was at p + shift + zoom (p - centre)."""
    x, y = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
    cx, cy = WIDTH / 2, HEIGHT / 2
    flow = np.stack([SHIFT[0] + ZOOM * (x - cx), SHIFT[1] + ZOOM * (y - cy)], axis=-1)
    before = picture(cx + (x - SHIFT[0] - cx) / (1 + ZOOM), cy + (y - SHIFT[1] - cy) / (1 + ZOOM))
    return picture(x, y), before, flow


def error(found: np.ndarray, exact: np.ndarray, margin: int = 12) -> np.ndarray:
    inner = slice(margin, -margin)
    return np.hypot(*np.moveaxis(found - exact, -1, 0))[inner, inner]


@pytest.mark.parametrize('method', [
    *BUILT_IN, *(pytest.param(method, marks=NEEDS_CONTRIB) for method in CONTRIB)])
def test_method_finds_the_exact_flow(method: str) -> None:
    current, earlier, exact = pair()
    flow = make_flow(OpticalFlowConfig(method=method))(current, earlier)
    assert flow.shape == (HEIGHT, WIDTH, 2) and flow.dtype == np.float32
    wrong = error(flow, exact)
    assert np.isfinite(wrong).mean() > 0.95
    assert np.nanmedian(wrong) < LIMITS[method]


@pytest.mark.parametrize('method', [
    *BUILT_IN, *(pytest.param(method, marks=NEEDS_CONTRIB) for method in CONTRIB)])
def test_both_ways_keeps_what_is_consistent(method: str) -> None:
    current, earlier, exact = pair()
    flow = both_ways(make_flow(OpticalFlowConfig(method=method)), current, earlier, HEIGHT // 4, WIDTH // 4, 0.7)
    wrong = error(flow, exact[2::4, 2::4], 3)
    assert np.isfinite(wrong).mean() > 0.95
    assert np.nanmedian(wrong) < LIMITS[method]


@pytest.mark.parametrize('wrong_value', [4.0, np.nan])
def test_both_ways_drops_what_does_not_return(wrong_value: float) -> None:
    current, earlier = np.zeros((80, 120), np.uint8), np.ones((80, 120), np.uint8)

    def flow(one: np.ndarray, other: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
        field = np.full((80, 120, 2), (8.0, 0.0) if one is current else (-8.0, 0.0), np.float32)
        if one is not current:
            field[40:60, 60:80] = wrong_value
        return field

    found = both_ways(flow, current, earlier, 20, 30, 0.7)
    # rows 40 to 59 are cells 10 to 14; columns 60 to 79 are reached from 52 to 71, cells 13 to 17
    assert np.isnan(found[10:15, 13:18]).all()
    found[9:15, 12:18] = 8.0, 0.0  # interpolation with an unknown neighbour is unknown
    np.testing.assert_array_equal(found, np.full((20, 30, 2), (8.0, 0.0)))


def test_dis_is_opencvs_with_the_three_settings() -> None:
    current, earlier, _ = pair()
    reference = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    reference.setFinestScale(1)
    reference.setVariationalRefinementIterations(7)
    reference.setVariationalRefinementAlpha(3.0)
    config = OpticalFlowConfig(method='dis', finest_scale=1, refinement_iterations=7, smoothness=3.0)
    np.testing.assert_array_equal(make_flow(config)(current, earlier), reference.calc(current, earlier, None))


@pytest.mark.parametrize(('method', 'preset'), [
    ('dis_ultrafast', cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST), ('dis_fast', cv2.DISOPTICAL_FLOW_PRESET_FAST),
    ('dis_medium', cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)])
def test_dis_presets_are_opencvs(method: str, preset: int) -> None:
    current, earlier, _ = pair()
    flow = make_flow(OpticalFlowConfig(method=method, finest_scale=4, refinement_iterations=0))(current, earlier)
    np.testing.assert_array_equal(flow, cv2.DISOpticalFlow_create(preset).calc(current, earlier, None))


def test_variational_refines() -> None:
    current, earlier, exact = pair()
    rough = np.median(error(flow_backends.Dis(cv2.DISOPTICAL_FLOW_PRESET_FAST, 2, 0)(current, earlier), exact))
    fine = np.median(error(make_flow(OpticalFlowConfig(method='variational'))(current, earlier), exact))
    assert fine < 0.7 * rough


def test_lucas_kanade_knows_nothing_of_plain_ground() -> None:
    current, earlier, _ = pair()
    current[:, :100], earlier[:, :100] = 90, 90
    flow = make_flow(OpticalFlowConfig(method='lk'))(current, earlier)
    assert np.isnan(flow[:, :75]).all() and np.isfinite(flow[12:-12, 120:-12]).mean() > 0.9


def test_every_method_of_the_settings_is_in_the_registry() -> None:
    assert {*BUILT_IN, *CONTRIB, 'onnx'} == set(FLOW_METHODS)


@pytest.mark.parametrize('method', CONTRIB)
def test_missing_contrib_says_what_to_install(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, 'optflow', raising=False)
    with pytest.raises(BackendError, match=rf'optical_flow.method {method}: expected cv2.optflow.\w+, OpenCV .* none; '
                                           'install opencv-contrib-python-headless .*extra contrib'):
        make_flow(OpticalFlowConfig(method=method))


def test_unknown_method_is_refused() -> None:
    with pytest.raises(BackendError, match='optical_flow.method: expected one of dis, .*, onnx, got .magic.'):
        make_flow(OpticalFlowConfig(method='magic'))


def test_onnx_without_a_file_is_refused() -> None:
    with pytest.raises(ConfigError, match='optical_flow.onnx_model: expected the file of a network .* got none'):
        OpticalFlowConfig(method='onnx')
