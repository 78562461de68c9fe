"""Every ego-motion method against exact warps, and what each says where it cannot know."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from warps import (
    CORNERS,
    DRAWS,
    HEIGHT,
    PERIOD_NS,
    WIDTH,
    about_centre,
    corner_error,
    estimate,
    view,
    with_a_mover,
    world,
)

from motion_detect_ros.core.config import EgoMotionConfig, PipelineConfig, PreprocessingConfig
from motion_detect_ros.core.ego_motion.alternatives.registration import make_template
from motion_detect_ros.core.ego_motion.methods import METHODS, make_method
from motion_detect_ros.core.ego_motion.smoothing import make_smoother
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import EgoStatus, MotionModel

NEW = ('direct', 'flow')


def config_of(method: str, model: str = 'affine', **preprocessing: object) -> PipelineConfig:
    return PipelineConfig(ego_motion=EgoMotionConfig(method=method, model=model, smoothing='none'),
                          preprocessing=PreprocessingConfig(**preprocessing))


@pytest.mark.parametrize(('method', 'limit_px'), [('direct', 0.05), ('flow', 0.15)])
@pytest.mark.parametrize('kind', DRAWS)
def test_known_warps_with_a_fifth_of_the_picture_moving_otherwise(kind, method, limit_px):
    errors = []
    for seed in range(6):
        previous, current, matrix = with_a_mover(kind, seed)
        ego = estimate(previous, current, config_of(method))
        assert ego.status == EgoStatus.OK
        errors.append(corner_error(ego.matrix, matrix))
    assert np.median(errors) < limit_px, errors
    assert max(errors) < 2 * limit_px, errors


def test_the_same_picture_gives_the_same_template_wherever_it_lies_in_memory():
    """OpenCV's vector code may round otherwise where arrays are aligned otherwise."""
    picture, found = world(5)[:270, :480].astype(np.float32), set()
    kept = []
    for size in range(40):
        template = make_template(picture)
        found.add(template.points.tobytes() + template.gradients.tobytes())
        kept.append(np.empty(17 * size + 3, np.uint8))
    assert len(found) == 1


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize(('model', 'warp', 'limit_px'), [
    ('translation', about_centre(0, 1, 7.3, -5.6), 0.1),
    ('similarity', about_centre(3, 1.03, 7.3, -5.6), 0.1),
    ('homography', np.array([[1, 0, 0], [0, 1, 0], [4e-5, -3e-5, 1]]) @ about_centre(2, 1.01, 4.0, 3.0), 0.2)])
def test_every_method_measures_every_family(method, model, warp, limit_px):
    texture, ahead = world(11), np.array([[1, 0, -160], [0, 1, -160], [0, 0, 1.0]])
    current = cv2.warpPerspective(texture, warp @ ahead, (WIDTH, HEIGHT), flags=cv2.INTER_LANCZOS4)
    ego = estimate(view(texture, np.eye(3)), current, config_of(method, model))
    assert (ego.status, ego.model) == (EgoStatus.OK, MotionModel[model.upper()])
    points = CORNERS[:, :2][None]
    error = cv2.perspectiveTransform(points, ego.matrix) - cv2.perspectiveTransform(points, warp)
    assert np.linalg.norm(error, axis=2).max() < limit_px


@pytest.mark.parametrize('method', NEW)
@pytest.mark.parametrize('gray', [0, 200])
def test_nothing_to_see_is_said_and_not_guessed(method, gray):
    picture = np.full((HEIGHT, WIDTH), gray, np.uint8)
    ego = estimate(picture, picture, config_of(method))
    assert ego.status == EgoStatus.LOW_TEXTURE
    np.testing.assert_array_equal(ego.matrix, np.eye(3))
    assert np.isnan(ego.covariance).all()


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('gray', [0, 128])
def test_a_picture_that_goes_blank_has_no_motion(method, gray):
    blank = np.full((HEIGHT, WIDTH), gray, np.uint8)
    ego = estimate(view(world(1), np.eye(3)), blank, config_of(method))
    assert ego.status in (EgoStatus.LOW_TEXTURE, EgoStatus.DEGENERATE)


@pytest.mark.parametrize('method', NEW)
def test_pictures_of_different_places_have_no_motion_in_common(method):
    ego = estimate(view(world(1), np.eye(3)), view(world(2), np.eye(3)), config_of(method))
    assert ego.status in (EgoStatus.LOW_TEXTURE, EgoStatus.DEGENERATE)


@pytest.mark.parametrize('method', NEW)
def test_noise_alone_is_no_motion(method):
    random = np.random.default_rng(0)
    pair = [np.clip(random.normal(128, 20, (HEIGHT, WIDTH)), 0, 255).astype(np.uint8) for _ in range(2)]
    assert not estimate(*pair, config_of(method)).ok


@pytest.mark.parametrize('method', NEW)
def test_what_the_mask_leaves_out_has_no_say(method):
    """Three quarters of the picture is a still inset: with it ignored the rest decides, without it the inset does."""
    texture, inset, matrix = world(4), world(5, HEIGHT, WIDTH), about_centre(0, 1, 5.0, 3.0)
    pair = [view(texture, m) for m in (np.eye(3), matrix)]
    top = HEIGHT // 4
    for picture in pair:
        picture[top:] = inset[top:]
    ignored = estimate(*pair, config_of(method, 'translation', ignore_regions=f'0,{top},{WIDTH},{HEIGHT - top}'))
    assert ignored.ok
    assert corner_error(ignored.matrix, matrix) < 0.3
    assert corner_error(estimate(*pair, config_of(method, 'translation')).matrix, np.eye(3)) < 0.3


def test_direct_is_not_misled_by_the_camera_s_exposure():
    matrix = about_centre(1, 1.01, 6.0, -4.0)
    current = np.clip(0.7 * view(world(7), matrix).astype(float) + 30, 0, 255).astype(np.uint8)
    ego = estimate(view(world(7), np.eye(3)), current, config_of('direct'))
    assert corner_error(ego.matrix, matrix) < 0.1


@pytest.mark.parametrize('method', METHODS)
def test_a_prior_is_where_the_search_starts(method):
    """A step that is too long to be found alone."""
    matrix = about_centre(0, 1, 150.0, 20.0)
    config = config_of(method)
    prepare = Preprocessor(config.preprocessing)
    frames = [prepare.process(view(world(8), m), stamp) for m, stamp in ((np.eye(3), PERIOD_NS),
                                                                         (matrix, 2 * PERIOD_NS))]
    from_prior = make_method(config.ego_motion).measure(*frames, prior=about_centre(0, 1, 147.0, 22.0))
    assert from_prior.status == EgoStatus.OK
    np.testing.assert_allclose(from_prior.fit.theta[[0, 3]], [150.0, 20.0], atol=0.1)


@pytest.mark.parametrize('method', NEW)
def test_covariance_grows_with_the_noise_of_the_picture(method):
    texture, matrix = world(3), about_centre(1, 1.01, 3, -2)
    random, covariances = np.random.default_rng(0), []
    for sigma in (0.0, 20.0):
        pair = [np.clip(view(texture, m) + random.normal(0, sigma, (HEIGHT, WIDTH)), 0, 255).astype(np.uint8)
                for m in (np.eye(3), matrix)]
        covariances.append(np.trace(estimate(*pair, config_of(method)).covariance[::3, ::3]))
    assert covariances[1] > 4 * covariances[0]


def test_unknown_methods_are_named():
    config = EgoMotionConfig(method='guess')
    with pytest.raises(ConfigError, match='ego_motion.method: expected one of indirect, direct, flow, got .guess.'):
        make_method(config)


def test_unknown_filters_are_named():
    config = EgoMotionConfig(smoothing='guess')
    with pytest.raises(ConfigError, match='ego_motion.smoothing: expected one of kalman, autoregressive, none, got '):
        make_smoother(config)


def test_details_of_the_laplacian_pyramid_stand_light_that_changes_from_place_to_place():
    """The second picture is half as bright on the left as on the right: a gain and an offset do not explain that."""
    x, y = np.linspace(0.0, 1.0, WIDTH)[None], np.linspace(0.0, 1.0, HEIGHT)[:, None]
    light = 0.5 + 0.8 * x * (1.0 - 0.5 * y)
    errors = {'gaussian': [], 'laplacian': []}
    for seed in range(5):
        random, texture = np.random.default_rng(seed), world(seed)
        matrix = about_centre(random.uniform(-5, 5), random.uniform(0.95, 1.05), *random.uniform(-10, 10, 2))
        lit = np.clip(view(texture, matrix) * light, 0, 255).astype(np.uint8)
        for pyramid, found in errors.items():
            config = PipelineConfig(ego_motion=EgoMotionConfig(method='direct', pyramid=pyramid, smoothing='none'))
            ego = estimate(view(texture, np.eye(3)), lit, config)
            assert ego.status == EgoStatus.OK
            found.append(corner_error(ego.matrix, matrix))
    assert max(errors['laplacian']) < 0.15 and np.median(errors['gaussian']) > 0.3, errors
