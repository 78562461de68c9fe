"""ART2 for users of scikit-learn: the same network behind fit and predict. scikit-learn itself is not needed.

For example ``labels = Art2Clusterer(vigilance=0.3).fit_predict(vectors)``.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.clustering.art2 import make_art2
from motion_detect_ros.core.clustering.art2_network import Art2Network, LabelArray
from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import FloatArray

try:
    from sklearn.base import BaseEstimator, ClusterMixin
    from sklearn.utils.validation import check_is_fitted, validate_data
except ImportError:
    from motion_detect_ros.plain_estimator import BaseEstimator, ClusterMixin, check_is_fitted, validate_data

_DEFAULTS = Art2Config()


class Art2Clusterer(ClusterMixin, BaseEstimator):  # type: ignore[misc, unused-ignore]
    """Estimator over (N, D) arrays of vectors whose noise has standard deviation 1.

    Parameters: those of ``Art2Config`` but ``features``, as the vectors are given; wrong ones are found by ``fit``.
    Data scaled to standard deviation 1 need a vigilance of about 0.6: at the default all of them are within the noise,
    hence background.
    After ``fit`` or ``partial_fit``: ``labels_`` (N,) int32 of the last vectors, 0 = background, -1 = not finite;
    ``cluster_centers_`` (K, D) float32, row 0 the background; ``names_`` (K,) uint32, stable from one
    ``partial_fit`` to the next; ``n_features_in_`` = D.
    """

    labels_: LabelArray
    cluster_centers_: FloatArray
    names_: npt.NDArray[np.uint32]
    n_features_in_: int
    _network: Art2Network[Any]

    def __init__(
        self,
        *,
        variant: str = _DEFAULTS.variant,
        vigilance: float = _DEFAULTS.vigilance,
        learning_rate: float = _DEFAULTS.learning_rate,
        initial_neurons: int = _DEFAULTS.initial_neurons,
        spread_match: float = _DEFAULTS.spread_match,
        max_neurons: int = _DEFAULTS.max_neurons,
        forget_s: float = _DEFAULTS.forget_s,
        merge_match: float = _DEFAULTS.merge_match,
        background_sigma: float = _DEFAULTS.background_sigma,
        learning: str = _DEFAULTS.learning,
        a: float = _DEFAULTS.a,
        b: float = _DEFAULTS.b,
        c: float = _DEFAULTS.c,
        d: float = _DEFAULTS.d,
        e: float = _DEFAULTS.e,
        theta: float = _DEFAULTS.theta,
    ) -> None:
        self.variant = variant
        self.vigilance = vigilance
        self.learning_rate = learning_rate
        self.initial_neurons = initial_neurons
        self.spread_match = spread_match
        self.max_neurons = max_neurons
        self.forget_s = forget_s
        self.merge_match = merge_match
        self.background_sigma = background_sigma
        self.learning = learning
        self.a = a
        self.b = b
        self.c = c
        self.d = d
        self.e = e
        self.theta = theta

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, '_network')

    def __sklearn_tags__(self) -> Any:
        """Only scikit-learn asks for them: vectors that are not finite are allowed."""
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags

    def fit(self, X: npt.ArrayLike, y: object = None) -> Self:
        """Cluster ``X`` (N, D) in a fresh network; ``y`` is not looked at.

        Raises: ValueError for another shape; ConfigError for a wrong parameter.
        """
        vectors = self._validated(X, reset=True)
        return self._present(make_art2(self._config()), vectors)

    def partial_fit(self, X: npt.ArrayLike, y: object = None) -> Self:
        """Present ``X`` (N, D) to the network as it is, as the next frame of a sequence.

        Parameters are those of the first call. Raises: as ``fit``; ValueError for another D than before.
        """
        if not self.__sklearn_is_fitted__():
            return self.fit(X)
        return self._present(self._network, self._validated(X, reset=False))

    def predict(self, X: npt.ArrayLike) -> LabelArray:
        """(N,) int32 row of ``cluster_centers_`` for each vector; nothing is learned.

        Raises: NotFittedError; ValueError for another shape than (N, ``n_features_in_``).
        """
        check_is_fitted(self)
        return self._network.predict(self._validated(X, reset=False))

    def _present(self, network: Art2Network[Any], vectors: FloatArray) -> Self:
        self._network = network
        self.labels_ = network.partial_fit(vectors)
        self.cluster_centers_ = network.prototypes.copy()
        self.names_ = network.names.copy()
        return self

    def _validated(self, X: npt.ArrayLike, *, reset: bool) -> FloatArray:
        vectors: FloatArray = validate_data(self, X, reset=reset, dtype=np.float32, ensure_all_finite=False)
        return vectors

    def _config(self) -> Art2Config:
        """Searches over parameters set numpy's numbers; settings are Python's."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(Art2Config)
                  if field.name != 'features'}
        return with_settings(Art2Config(), {
            name: value.item() if isinstance(value, np.generic) else value for name, value in values.items()})
