"""ART2 as an estimator: hand-worked clusters, parameters, errors; scikit-learn's own tools where it is installed."""

from __future__ import annotations

import dataclasses
import inspect
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from motion_detect_ros.art2_clusterer import Art2Clusterer
from motion_detect_ros.core.clustering.art2 import make_art2
from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.errors import ConfigError

try:
    from sklearn.utils.estimator_checks import parametrize_with_checks
except ImportError:
    parametrize_with_checks = None

#: Two groups, one vector within the noise, one unknown.
VECTORS = [[10.0, 0.0], [10.2, 0.0], [0.0, -8.0], [0.1, 0.0], [np.nan, 1.0]]


def test_labels_and_centres():
    clusterer = Art2Clusterer(vigilance=0.4, initial_neurons=1, learning_rate=1.0)
    labels = clusterer.fit_predict(VECTORS)
    assert labels.tolist() == [1, 1, 2, 0, -1]  # (0, -8) matches (10.2, 0) 1 - 12.963 / 19.2 = 0.325
    np.testing.assert_allclose(clusterer.cluster_centers_, [(0, 0), (10.1, 0), (0, -8)], atol=1e-5)
    assert clusterer.labels_ is labels and clusterer.n_features_in_ == 2
    assert clusterer.predict([[9.0, 1.0], [0.5, -7.0], [0.0, 0.2]]).tolist() == [1, 2, 0]


def test_fit_forgets_and_partial_fit_goes_on():
    clusterer = Art2Clusterer(vigilance=0.4, initial_neurons=1)
    clusterer.partial_fit([[10, 0]]).partial_fit([[0, 10]])
    assert clusterer.names_.tolist() == [0, 1, 2] and clusterer.labels_.tolist() == [2]
    clusterer.fit([[0, 10]])
    assert clusterer.names_.tolist() == [0, 1] and clusterer.labels_.tolist() == [1]


@pytest.mark.parametrize('variant', ['magnitude', 'classic'])
def test_it_is_the_memory_of_the_pipeline(variant):
    vectors = np.random.default_rng(1).normal(0, 9, (500, 2)).astype(np.float32)
    clusterer, memory = Art2Clusterer(variant=variant), make_art2(Art2Config(variant=variant))
    for _ in range(2):
        np.testing.assert_array_equal(clusterer.partial_fit(vectors).labels_, memory.partial_fit(vectors))
    np.testing.assert_array_equal(clusterer.cluster_centers_, memory.prototypes)


def test_centres_are_of_their_fit():
    clusterer = Art2Clusterer().fit([[10, 0]])
    centres = clusterer.cluster_centers_
    clusterer.partial_fit([[12, 0]])
    assert centres[1].tolist() == [10, 0] != clusterer.cluster_centers_[1].tolist()


def test_parameters_are_those_of_the_settings():
    clusterer = Art2Clusterer(vigilance=0.4, variant='classic')
    assert clusterer.get_params() == {**Art2Clusterer().get_params(), 'vigilance': 0.4, 'variant': 'classic'}
    assert Art2Config(**Art2Clusterer().get_params()) == Art2Config()
    assert clusterer.set_params(vigilance=0.5) is clusterer and clusterer.vigilance == 0.5
    assert repr(clusterer) == "Art2Clusterer(variant='classic', vigilance=0.5)"


def test_every_setting_is_a_keyword_with_its_default():
    keywords = {name: one.default for name, one in inspect.signature(Art2Clusterer).parameters.items()}
    assert Art2Config(**keywords) == Art2Config()
    assert set(keywords) == {field.name for field in dataclasses.fields(Art2Config)} - {'features'}


def test_numbers_of_numpy_are_parameters():
    clusterer = Art2Clusterer(vigilance=np.float64(0.4), initial_neurons=np.int64(1), learning_rate=np.float64(1.0))
    assert clusterer.fit_predict(VECTORS).tolist() == [1, 1, 2, 0, -1]


WITHOUT = """
import sys
sys.modules['sklearn'] = None
from motion_detect_ros.art2_clusterer import Art2Clusterer
clusterer = Art2Clusterer(vigilance=0.4, initial_neurons=1)
print(clusterer.fit_predict([[10.0, 0.0], [10.2, 0.0], [0.0, -8.0], [0.1, 0.0], [float('nan'), 1.0]]).tolist())
print(clusterer, clusterer.predict([[9.0, 1.0]]).tolist(), Art2Clusterer.__mro__[1].__module__)
"""


def test_it_works_without_scikit_learn():
    done = subprocess.run([sys.executable, '-c', WITHOUT], capture_output=True, text=True, timeout=600, check=True)
    assert done.stdout.splitlines() == [
        '[1, 1, 2, 0, -1]', 'Art2Clusterer(vigilance=0.4, initial_neurons=1) [1] motion_detect_ros.plain_estimator']


@pytest.mark.parametrize(('X', 'message'), [
    ([1.0, 2.0], 'Expected 2D array, got 1D array instead'), (np.zeros((2, 2, 2)), 'Found array with dim 3'),
    (5.0, 'Expected 2D array'),
    (np.zeros((3, 0)), r'0 feature\(s\) \(shape=\(3, 0\)\) while a minimum of 1 is required'),
    (np.zeros((0, 2)), r'0 sample\(s\) \(shape=\(0, 2\)\) while a minimum of 1 is required'),
    (np.array([[1j, 2.0]]), 'Complex data not supported')])
def test_wrong_data(X, message):
    with pytest.raises(ValueError, match=message):
        Art2Clusterer().fit(X)


def test_another_dimension_than_before():
    clusterer = Art2Clusterer().fit([[1.0, 2.0]])
    for call in (clusterer.predict, clusterer.partial_fit):
        with pytest.raises(ValueError, match='X has 3 features, but Art2Clusterer is expecting 2 features as input'):
            call([[1.0, 2.0, 3.0]])
    assert clusterer.fit([[9.0, 9.0, 9.0]]).n_features_in_ == 3


def test_errors_of_use():
    with pytest.raises(ValueError, match='Art2Clusterer instance is not fitted yet') as caught:
        Art2Clusterer().predict([[1.0, 2.0]])
    assert type(caught.value).__name__ == 'NotFittedError'
    with pytest.raises(TypeError, match="unexpected keyword argument 'vigilanse'"):
        Art2Clusterer(vigilanse=0.5)
    with pytest.raises(ValueError, match=r"Invalid parameter 'vigilanse' for estimator Art2Clusterer\(\)"):
        Art2Clusterer().set_params(vigilanse=0.5)
    with pytest.raises(ConfigError, match=r'vigilance: expected 0.0 to 1.0, got 2.0'):
        Art2Clusterer(vigilance=2.0).fit([[1.0, 2.0]])
    with pytest.raises(ConfigError, match=r'art2.initial_neurons: expected at most art2.max_neurons \(5\), got 15'):
        Art2Clusterer(max_neurons=5).fit([[1.0, 2.0]])


def test_scikit_learn_clones_it():
    base = pytest.importorskip('sklearn.base')
    fitted = Art2Clusterer(vigilance=0.4, initial_neurons=3).fit(VECTORS)
    clone = base.clone(fitted)
    assert clone is not fitted and clone.get_params() == fitted.get_params()
    with pytest.raises(ValueError, match='not fitted yet'):
        clone.predict(VECTORS)


def test_it_ends_a_pipeline():
    pipelines = pytest.importorskip('sklearn.pipeline')
    from sklearn.preprocessing import FunctionTransformer
    pipeline = pipelines.Pipeline([
        ('noise units', FunctionTransformer(lambda pixels: np.asarray(pixels) / 0.5)),
        ('art2', Art2Clusterer(initial_neurons=1))])
    pipeline.set_params(art2__vigilance=0.4)
    assert pipeline.fit_predict([[5.0, 0.0], [0.0, -4.0], [0.05, 0.0]]).tolist() == [1, 2, 0]
    assert pipeline.predict([[0.0, -4.1], [5.0, 0.1]]).tolist() == [2, 1]
    assert pipeline.named_steps['art2'].vigilance == 0.4


def test_grid_search_turns_its_parameters():
    # (8, 0) and (10, 0) match 1 - 2 / 19 = 0.895: one cluster at vigilance 0.2, two at 0.95
    selection = pytest.importorskip('sklearn.model_selection')
    from sklearn.metrics import adjusted_rand_score
    vectors, truth = np.tile([[8.0, 0.0], [10.0, 0.0]], (20, 1)), np.tile([0, 1], 20)
    search = selection.GridSearchCV(
        Art2Clusterer(initial_neurons=1), {'vigilance': [0.2, 0.95]}, cv=2,
        scoring=lambda estimator, X, y: adjusted_rand_score(y, estimator.predict(X)))
    assert search.fit(vectors, truth).best_params_ == {'vigilance': 0.95}


if parametrize_with_checks is None:
    @pytest.mark.skip(reason="scikit-learn is not installed: make test-extras has it")
    def test_scikit_learns_own_checks():
        pass
else:
    # At the default vigilance scikit-learn's standardised data are all within the noise; 0.6 tells its blobs apart.
    @parametrize_with_checks([Art2Clusterer(vigilance=0.6)])
    def test_scikit_learns_own_checks(estimator: Any, check: Any):
        check(estimator)
