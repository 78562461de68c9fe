"""Flow features against analytic fields."""

import numpy as np
import pytest

from motion_detect_ros.core.background.planar import Background, motion_vectors
from motion_detect_ros.core.clustering.flow_features import (
    BINS,
    angle,
    coherence,
    consistency,
    curl,
    divergence,
    entropy,
    hoof,
    local_hoof,
    temporal_change,
)
from motion_detect_ros.core.errors import FrameError
from motion_detect_ros.core.geometry.vectors import magnitude

CELL_PX = (8.0, 4.0)


def points() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(12) * CELL_PX[0], np.arange(9) * CELL_PX[1])
    return x.astype(np.float32), y.astype(np.float32)


def test_rotation_has_twice_its_rate_as_curl_and_no_divergence():
    x, y = points()
    rate = 0.03
    flow = np.stack([-rate * y, rate * x], axis=-1)
    np.testing.assert_allclose(curl(flow, CELL_PX), 2 * rate, atol=1e-5)
    np.testing.assert_allclose(divergence(flow, CELL_PX), 0.0, atol=1e-5)


def test_expansion_has_twice_its_rate_as_divergence_and_no_curl():
    x, y = points()
    rate = 0.05
    flow = np.stack([rate * x, rate * y], axis=-1)
    np.testing.assert_allclose(divergence(flow, CELL_PX), 2 * rate, atol=1e-5)
    np.testing.assert_allclose(curl(flow, CELL_PX), 0.0, atol=1e-5)


def test_shear_has_neither_expansion_nor_equal_parts():
    x, y = points()
    flow = np.stack([0.1 * y, np.zeros_like(x)], axis=-1)
    np.testing.assert_allclose(divergence(flow, CELL_PX), 0.0, atol=1e-5)
    np.testing.assert_allclose(curl(flow, CELL_PX), -0.1, atol=1e-5)


@pytest.mark.parametrize(('vector', 'length', 'direction'), [
    ((3.0, 4.0), 5.0, 0.9272952), ((-1.0, 0.0), 1.0, np.pi), ((0.0, -2.0), 2.0, -np.pi / 2)])
def test_magnitude_and_angle(vector, length, direction):
    flow = np.full((2, 3, 2), vector, np.float32)
    np.testing.assert_allclose(magnitude(flow), length, rtol=1e-6)
    np.testing.assert_allclose(angle(flow), direction, rtol=1e-6)


def test_motion_vectors_are_multiples_of_the_local_noise():
    residual = np.array([[[3.0, 1.0], [np.nan, 2.0]]], np.float32)
    background = Background(np.array([[[1.0, 1.0], [0.0, 0.0]]], np.float32), np.array([[0.5, 0.25]], np.float32))
    vectors = motion_vectors(residual, background)
    np.testing.assert_allclose(vectors[0, 0], [4.0, 0.0])
    assert np.isnan(vectors[0, 1, 0])


def uniform(vector: tuple[float, float] = (3.0, -2.0), shape: tuple[int, int] = (9, 12)) -> np.ndarray:
    return np.full((*shape, 2), vector, np.float32)


def random_directions(seed: int = 0, shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    theta = np.random.default_rng(seed).uniform(-np.pi, np.pi, shape)
    return np.stack([np.cos(theta), np.sin(theta)], axis=-1).astype(np.float32)


class TestDerivativesBesideUnknownCells:
    def test_neighbours_keep_their_value(self):
        x, y = points()
        flow = np.stack([0.05 * x - 0.03 * y, 0.03 * x + 0.05 * y], axis=-1)
        flow[4, 5] = flow[0, 0] = np.nan
        for feature, truth in ((divergence(flow, CELL_PX), 0.1), (curl(flow, CELL_PX), 0.06)):
            np.testing.assert_array_equal(np.isnan(feature), np.isnan(flow[..., 0]))
            np.testing.assert_allclose(feature[np.isfinite(feature)], truth, atol=1e-5)

    def test_central_inside(self):
        """A parabola: only the central difference has the exact slope."""
        x, _ = points()
        flow = np.stack([0.01 * x ** 2, np.zeros_like(x)], axis=-1)
        np.testing.assert_allclose(divergence(flow, CELL_PX)[:, 1:-1], 0.02 * x[:, 1:-1], rtol=1e-4)

    def test_a_cell_without_known_neighbours_has_none(self):
        flow = np.full((5, 5, 2), np.nan, np.float32)
        flow[2, 2] = 1.0
        assert np.isnan(divergence(flow, CELL_PX)).all()


class TestConsistency:
    def test_one_motion(self):
        np.testing.assert_allclose(consistency(uniform(), 5), 1.0, atol=1e-6)
        np.testing.assert_allclose(consistency(uniform((0.0, 0.0)), 5), 1.0)

    @pytest.mark.parametrize(('vector', 'expected'), [
        ((-3.0, 2.0), 0.0),        # against all others
        ((0.0, 0.0), 0.0),         # alone at rest
        ((6.0, -4.0), 2.0 / 3.0),  # twice as fast: 1 - |m| / (2 |m| + |m|)
    ])
    def test_one_cell_among_others(self, vector, expected):
        flow = uniform()
        flow[4, 6] = vector
        found = consistency(flow, 3)
        assert found[4, 6] == pytest.approx(expected, abs=1e-5)
        assert found[0, 0] == pytest.approx(1.0)

    def test_unknown_cells_do_not_count(self):
        flow = uniform()
        flow[3:6, 5:8] = np.nan
        flow[4, 6] = (3.0, -2.0)
        found = consistency(flow, 3)
        assert np.isnan(found[4, 6])  # nobody to agree with
        assert np.isnan(found[3, 5])
        np.testing.assert_allclose(found[:3], 1.0, atol=1e-6)


class TestTemporalChange:
    def test_length_of_the_difference(self):
        np.testing.assert_allclose(temporal_change(uniform((4.0, 1.0)), uniform((1.0, 5.0))), 5.0)

    def test_unknown_where_either_is(self):
        flow, previous = uniform(), uniform()
        flow[1, 1] = previous[2, 2] = np.nan
        assert np.argwhere(np.isnan(temporal_change(flow, previous))).tolist() == [[1, 1], [2, 2]]
        assert np.isnan(temporal_change(flow, None)).all()

    def test_fields_of_two_sizes_are_refused(self):
        with pytest.raises(FrameError, match=r'expected shape \(9, 12, 2\), got \(5, 6, 2\)'):
            temporal_change(uniform(), uniform(shape=(5, 6)))


class TestHoof:
    def test_worked_by_hand(self):
        """Four bins of 45 degrees, from straight up (-90) to straight down (90); weights are lengths."""
        vectors = np.array([[3, 4], [-3, 4], [5, -1e-3], [-2, -2.1], [0, -1], [0, 1], [np.nan, 9]], np.float32)
        lengths = np.array([2.9 + 1.0, 5.0, 0.0, 5.0 + 5.0 + 1.0])  # -46.4 and -90 degrees; -0.01; none; 53.1 twice, 90
        np.testing.assert_allclose(hoof(vectors, 4), lengths / 19.9, atol=1e-3)

    def test_a_mirrored_field_has_the_same(self):
        flow = random_directions() * np.random.default_rng(1).uniform(0, 3, (60, 80, 1)).astype(np.float32)
        mirrored = flow * np.array([-1.0, 1.0], np.float32)
        np.testing.assert_array_equal(hoof(flow), hoof(mirrored))
        assert np.abs(hoof(flow) - hoof(-flow)).max() > 1e-4  # upside down is something else

    def test_sums_to_one_whatever_the_scale(self):
        flow = random_directions()
        assert hoof(flow).sum() == pytest.approx(1.0, abs=1e-5)
        np.testing.assert_allclose(hoof(7.0 * flow), hoof(flow), atol=1e-6)

    def test_nothing_moves(self):
        assert not hoof(uniform((0.0, 0.0))).any()
        assert not hoof(np.full((3, 3, 2), np.nan, np.float32)).any()

    def test_the_window_of_a_cell_is_the_histogram_of_its_vectors(self):
        flow = random_directions(3, (20, 30))
        flow[8, 9] = np.nan
        found = local_hoof(flow, 5)
        for row, column in ((10, 11), (0, 0), (19, 15)):
            window = flow[max(0, row - 2):row + 3, max(0, column - 2):column + 3]
            np.testing.assert_allclose(found[row, column], hoof(window, BINS), atol=1e-5)
        assert np.isnan(found[8, 9]).all()


class TestEntropyAndCoherence:
    def test_one_motion(self):
        np.testing.assert_allclose(entropy(uniform(), 5), 0.0, atol=1e-6)
        np.testing.assert_allclose(coherence(uniform(), 5), 1.0, atol=1e-6)

    def test_all_directions(self):
        flow = random_directions()
        inside = np.s_[20:-20, 20:-20]
        np.testing.assert_allclose(entropy(flow, 41)[inside], np.log(BINS), atol=0.02)
        assert coherence(flow, 41)[inside].max() < 0.1  # 1681 unit vectors: expected 1 / 41

    def test_two_opposite_halves(self):
        flow = uniform((2.0, 0.0), (11, 11))
        flow[:, 5:] = (-2.0, 0.0)
        flow[:, 5] = np.nan
        flow[5, 5] = (0.0, 0.0)
        assert entropy(flow, 11)[5, 5] == pytest.approx(np.log(2))
        assert coherence(flow, 11)[5, 5] == pytest.approx(0.0, abs=1e-6)

    def test_noise_about_an_axis_of_the_image_is_one_direction(self):
        for vector in ((3.0, 0.1), (-3.0, 0.1), (0.1, 3.0), (0.1, -3.0)):
            flow = uniform(vector)
            flow[::2] = np.where(np.abs(vector) > 1.0, vector, -np.array(vector))
            np.testing.assert_allclose(entropy(flow, 5), 0.0, atol=1e-6)

    def test_coherence_is_weighted_by_length(self):
        flow = uniform((3.0, 0.0), (1, 3))
        flow[0, 2] = (-1.0, 0.0)
        assert coherence(flow, 3)[0, 1] == pytest.approx(5.0 / 7.0)
        assert entropy(flow, 3)[0, 1] == pytest.approx(-(6 / 7 * np.log(6 / 7) + 1 / 7 * np.log(1 / 7)))

    def test_unknown_cells_do_not_count(self):
        flow = uniform()
        flow[4, 6] = np.nan
        for feature, value in ((entropy(flow, 3), 0.0), (coherence(flow, 3), 1.0)):
            assert np.argwhere(np.isnan(feature)).tolist() == [[4, 6]]
            np.testing.assert_allclose(np.delete(feature.ravel(), 4 * 12 + 6), value, atol=1e-6)

    def test_rest_is_coherent(self):
        np.testing.assert_array_equal(coherence(uniform((0.0, 0.0)), 3), 1.0)
        np.testing.assert_array_equal(entropy(uniform((0.0, 0.0)), 3), 0.0)


@pytest.mark.parametrize('window', [0, 4, -3])
def test_an_even_window_is_refused(window: int) -> None:
    with pytest.raises(FrameError, match=f'window: expected an odd number of cells, got {window}'):
        consistency(uniform(), window)
