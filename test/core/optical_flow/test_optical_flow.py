"""Every method of dense flow against pictures of a formula, whose flow is exact; the registry and what it refuses."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import FLOW_METHODS, OpticalFlowConfig, PipelineConfig
from motion_detect_ros.core.errors import BackendError, ConfigError
from motion_detect_ros.core.flow_methods.alternatives.contrib import CONTRIB
from motion_detect_ros.core.flow_methods.dis import Dis
from motion_detect_ros.core.flow_methods.forward_backward import BackwardWorker, forward_backward_flow
from motion_detect_ros.core.flow_methods.registry import BUILT_IN, make_flow
from motion_detect_ros.core.geometry.frame_history import FrameHistory
from motion_detect_ros.core.optical_flow.stage import OpticalFlowStage
from motion_detect_ros.core.types import EgoMotion, EgoStatus, PreparedFrame

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
def test_forward_backward_flow_keeps_what_is_consistent(method: str) -> None:
    current, earlier, exact = pair()
    flow = forward_backward_flow(
        make_flow(OpticalFlowConfig(method=method)), current, earlier, HEIGHT // 4, WIDTH // 4, 0.7)
    wrong = error(flow, exact[2::4, 2::4], 3)
    assert np.isfinite(wrong).mean() > 0.95
    assert np.nanmedian(wrong) < LIMITS[method]


@pytest.mark.parametrize('wrong_value', [4.0, np.nan])
def test_forward_backward_flow_drops_what_does_not_return(wrong_value: float) -> None:
    current, earlier = np.zeros((80, 120), np.uint8), np.ones((80, 120), np.uint8)

    def flow(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        field = np.full((80, 120, 2), (8.0, 0.0) if one is current else (-8.0, 0.0), np.float32)
        if one is not current:
            field[40:60, 60:80] = wrong_value
        return field

    found = forward_backward_flow(flow, current, earlier, 20, 30, 0.7)
    # rows 40 to 59 are cells 10 to 14; columns 60 to 79 are reached from 52 to 71, cells 13 to 17
    assert np.isnan(found[10:15, 13:18]).all()
    found[9:15, 12:18] = 8.0, 0.0  # interpolation with an unknown neighbour is unknown
    np.testing.assert_array_equal(found, np.full((20, 30, 2), (8.0, 0.0)))


def bilinear(field: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n, 2) ``field`` between its cells, the border's values beyond it."""
    x, y = np.clip(x, 0, field.shape[1] - 1), np.clip(y, 0, field.shape[0] - 1)
    left, top = np.minimum(x.astype(int), field.shape[1] - 2), np.minimum(y.astype(int), field.shape[0] - 2)
    u, v = (x - left)[..., None], (y - top)[..., None]
    above = (1 - u) * field[top, left] + u * field[top, left + 1]
    return (1 - v) * above + v * ((1 - u) * field[top + 1, left] + u * field[top + 1, left + 1])


def test_forward_backward_flow_is_the_check_of_the_paper() -> None:
    random, (rows, columns) = np.random.default_rng(3), (40, 60)
    there = random.normal(0.0, 12.0, (rows, columns, 2)).astype(np.float32)
    back = -cv2.blur(there, (5, 5))
    there[5, 7], back[20, 30] = np.nan, np.nan
    size = (columns * 4, rows * 4)
    dense = [cv2.resize(each, size, interpolation=cv2.INTER_NEAREST) for each in (there, back)]
    current, earlier = np.zeros(size[::-1], np.uint8), np.ones(size[::-1], np.uint8)

    def flow(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return dense[int(one is earlier)]

    found = forward_backward_flow(flow, current, earlier, rows, columns, 6.0)
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    target = np.nan_to_num(there.astype(float)) / 4.0
    returned = bilinear(back.astype(float), x + target[..., 0], y + target[..., 1])
    miss = ((there + returned) ** 2).sum(axis=2)
    length = (there.astype(float) ** 2).sum(axis=2) + (returned ** 2).sum(axis=2)
    excess = miss - (36.0 + 0.01 * length)
    clear = ~(np.abs(excess) < 1e-3)  # rounding decides the others
    kept = np.isfinite(found[..., 0])
    assert 100 < kept.sum() < rows * columns - 100 and clear.mean() > 0.99
    np.testing.assert_array_equal(kept[clear], (excess < 0.0)[clear])
    np.testing.assert_array_equal(found[kept], there[kept])


@pytest.mark.parametrize('method', list(BUILT_IN))
def test_forward_backward_flow_is_the_same_in_two_threads(method: str) -> None:
    current, earlier, _ = pair()
    config = OpticalFlowConfig(method=method)
    with ThreadPoolExecutor(1) as pool:
        worker, one, two = BackwardWorker(make_flow(config), pool), make_flow(config), make_flow(config)
        for _ in range(2):
            expected = forward_backward_flow(one, current, earlier, HEIGHT // 4, WIDTH // 4, 0.7)
            found = forward_backward_flow(two, current, earlier, HEIGHT // 4, WIDTH // 4, 0.7, worker)
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize('threads', [1, 2])
def test_total_flow_is_the_cameras_where_nothing_moves_by_itself(threads: int) -> None:
    before, turn = cv2.getNumThreads(), np.radians(2.0)
    matrix = np.array([[np.cos(turn), -np.sin(turn), 9.0], [np.sin(turn), np.cos(turn), -6.0], [0.0, 0.0, 1.0]])
    x, y = np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float))
    back = np.linalg.inv(matrix)
    from_x, from_y = back[0, 0] * x + back[0, 1] * y + back[0, 2], back[1, 0] * x + back[1, 1] * y + back[1, 2]
    config = PipelineConfig()
    stage, history = OpticalFlowStage(config), FrameHistory(config.optical_flow.baseline_s)
    try:
        cv2.setNumThreads(threads)
        for number, gray in enumerate((picture(x, y), picture(from_x, from_y))):
            frame = PreparedFrame(gray, 0.5, 2 * WIDTH, 2 * HEIGHT, number * 10 ** 9)
            status = EgoStatus.OK if number else EgoStatus.FIRST_FRAME
            full = matrix.copy()
            full[:2, 2] = 2 * matrix[:2, 2] + 0.5 - matrix[:2, :2] @ [0.5, 0.5]  # X = 2 x + 0.5
            ego = EgoMotion(full, np.eye(6), status, number * 10 ** 9, max(0, number - 1) * 10 ** 9)
            flow = stage.process(frame, ego, history.step(frame, ego)).flow
    finally:
        cv2.setNumThreads(before)
    exact = 2.0 * np.stack([x - from_x, y - from_y], axis=-1)
    exact = cv2.resize(exact, flow.shape[1::-1], interpolation=cv2.INTER_AREA)
    known = np.isfinite(flow[..., 0])
    outside = cv2.resize((from_x < -1.0).astype(np.float32), flow.shape[1::-1], interpolation=cv2.INTER_AREA) == 1.0
    assert outside.any() and not known[outside].any()
    assert known[5:-5, 5:-5].mean() > 0.95
    assert np.median(np.hypot(*(flow - exact)[known].T)) < 0.1


@pytest.mark.parametrize('scale', [3, 4])
@pytest.mark.parametrize('shape', [(32, 160), (47, 240), (63, 320), (80, 240), (127, 480)])
def test_coarse_finest_levels_leave_small_pictures_alive(scale: int, shape: tuple[int, int]) -> None:
    """OpenCV 5.0 writes beyond its arrays there: the process would end, so another one tries."""
    code = (f'import numpy as np; from motion_detect_ros.core.config import OpticalFlowConfig; '
            f'from motion_detect_ros.core.flow_methods.registry import make_flow; '
            f'image = np.random.default_rng(0).integers(0, 255, {shape}).astype(np.uint8); '
            f'found = make_flow(OpticalFlowConfig(finest_scale={scale}))(image, np.roll(image, 1, 1)); '
            f'assert np.isfinite(found).all() and found.shape == {(*shape, 2)}')
    done = subprocess.run([sys.executable, '-c', code], check=False, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


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
    rough = np.median(error(Dis(cv2.DISOPTICAL_FLOW_PRESET_FAST, 2, 0)(current, earlier), exact))
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
