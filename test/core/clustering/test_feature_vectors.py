"""What ART2 is given to see: motion alone, or features of which the background is zero and a mover is not."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.clustering.art2 import make_art2
from motion_detect_ros.core.clustering.feature_vectors import FEATURES, FeatureVectors
from motion_detect_ros.core.config import FLOW_FEATURES, Art2Config, PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

ROWS, COLUMNS = 40, 60
MOVER = np.s_[10:24, 20:38]
#: Of a mover of one velocity these are far from the background's value on its border only.
ON_BORDERS = {'divergence', 'curl'}


def motion(seed: int = 0) -> np.ndarray:
    """Noise of deviation one, and a rectangle that moves by ten deviations and turns a little."""
    random = np.random.default_rng(seed)
    field = random.normal(0.0, 1.0, (ROWS, COLUMNS, 2)).astype(np.float32)
    field[MOVER] += np.float32([8.0, 6.0])
    field[0, 0] = np.nan
    return field


def inside(border_only: bool) -> np.ndarray:
    cells = np.zeros((ROWS, COLUMNS), bool)
    cells[MOVER] = True
    if border_only:
        cells[11:23, 21:37] = False
    return cells


def test_motion_alone_is_the_motion() -> None:
    field = motion()
    np.testing.assert_array_equal(FeatureVectors(Art2Config()).of(field), field.reshape(-1, 2))


@pytest.mark.parametrize('name', FLOW_FEATURES)
def test_the_background_is_at_zero_and_a_mover_is_not(name: str) -> None:
    vectors = FeatureVectors(Art2Config(features=name))
    vectors.of(np.zeros((ROWS, COLUMNS, 2), np.float32))
    found = vectors.of(motion())
    assert found.dtype == np.float32 and len(found) == ROWS * COLUMNS
    assert np.isnan(found[0]).all() and np.isfinite(found[1:]).all()
    assert np.abs(np.median(found[1:], axis=0)).max() < 0.3
    length = np.linalg.norm(found, axis=1).reshape(ROWS, COLUMNS)
    far = np.ones((ROWS, COLUMNS), bool)
    far[4:30, 14:44] = far[0, 0] = False
    if name == 'angle':  # of length one everywhere: a mover's are alike, the background's are not
        directions = found.reshape(ROWS, COLUMNS, -1)
        assert directions[MOVER].std(axis=(0, 1)).max() < 0.3 * directions[far].std(axis=0).min()
    else:
        assert np.median(length[inside(name in ON_BORDERS)]) > 2.0 * np.median(length[far])


def test_further_features_together_weigh_as_one_component_of_the_motion() -> None:
    vectors = FeatureVectors(Art2Config(features=', '.join(('motion', *FLOW_FEATURES))))
    vectors.of(motion(1))
    noise = np.random.default_rng(2).normal(0.0, 1.0, (ROWS, COLUMNS, 2)).astype(np.float32)
    found = vectors.of(noise)
    np.testing.assert_array_equal(found[:, :2], noise.reshape(-1, 2))
    assert 0.5 < np.sqrt((found[:, 2:] ** 2).sum(axis=1).mean()) < 2.0


def test_change_over_time_is_against_the_frame_before_and_forgotten_by_a_reset() -> None:
    vectors = FeatureVectors(Art2Config(features='temporal_change'))
    assert not vectors.of(motion())[1:].any()  # no frame before: nothing is known to have changed
    assert vectors.of(motion(1))[1:].any()
    vectors.reset()
    assert not vectors.of(motion(2))[1:].any()


@pytest.mark.parametrize('features', ['', ' , ', 'motion, colour', 'curl divergence'])
def test_unknown_features_are_refused(features: str) -> None:
    with pytest.raises(ConfigError, match=r'art2\.features: expected some of motion, magnitude, .*, got (none|\w+)'):
        Art2Config(features=features)


def test_every_feature_of_the_settings_exists() -> None:
    assert tuple(FEATURES) == FLOW_FEATURES


@pytest.mark.parametrize('variant', ['magnitude', 'classic'])
def test_art2_tells_a_mover_from_the_background_by_features(variant: str) -> None:
    config = Art2Config(variant=variant, features='motion, magnitude, consistency', vigilance=0.2)
    field = motion()
    labels = make_art2(config).partial_fit(FeatureVectors(config).of(field)).reshape(ROWS, COLUMNS)
    assert (labels[MOVER] > 0).mean() > 0.9
    outside = ~inside(border_only=False)
    assert (labels[outside] > 0).mean() < 0.1


def test_the_reports_configuration_finds_a_large_mover() -> None:
    preset = load_preset('report')
    assert set(preset.art2.feature_names) == set(FLOW_FEATURES) and preset.art2.variant == 'classic'
    assert preset != PipelineConfig()
    pipeline, hits, last = MotionPipeline(preset), 0, 0
    for frame in SyntheticFlight(FlightConfig.single(90.0, 6.0, 2.0, frames=20)):
        found = pipeline.process(frame.image, frame.stamp_ns).detections
        box = frame.truth[0]
        middle = np.array([box['x'] + box['w'] / 2, box['y'] + box['h'] / 2])
        hits += any(np.hypot(each['u'] - middle[0], each['v'] - middle[1]) < 20.0 for each in found)
        last = frame.index
    assert hits >= 0.5 * last


@pytest.mark.parametrize('features', ['magnitude, divergence, curl', ', '.join(FLOW_FEATURES)])
def test_a_part_of_the_image_with_less_noise_than_the_rest_does_not_make_that_move(features: str) -> None:
    """Two thirds without any noise: what is left of the other third is noise of deviation one, no motion."""
    vectors = FeatureVectors(Art2Config(features=features))
    field = np.random.default_rng(3).normal(0.0, 1.0, (ROWS, COLUMNS, 2)).astype(np.float32)
    field[:27] = 0.0
    vectors.of(field)
    length = np.linalg.norm(vectors.of(field), axis=1)
    assert np.quantile(length, 0.99) < 4.0
