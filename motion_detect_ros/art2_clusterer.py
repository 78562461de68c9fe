"""ART2 for users of scikit-learn: the same memory behind fit and predict. scikit-learn itself is not needed.

For example ``labels = Art2Clusterer(vigilance=0.3).fit_predict(vectors)``.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.clustering.art2 import make_art2
from motion_detect_ros.core.clustering.art2_network import Art2Network, LabelArray, VectorsError
from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.errors import ConfigError, MotionDetectError
from motion_detect_ros.core.settings import Scalar, with_settings
from motion_detect_ros.core.types import FloatArray


class NotFittedError(MotionDetectError, ValueError, AttributeError):
    """An answer is asked of a clusterer that has seen nothing."""


class Art2Clusterer:
    """Estimator over (N, D) arrays of vectors whose noise has standard deviation 1.

    Parameters: those of ``Art2Config``, by keyword. After ``fit`` or ``partial_fit``: ``labels_`` (N,) int32 of the
    last vectors, 0 = background, -1 = not finite; ``cluster_centers_`` (K, D) float32, row 0 the background;
    ``names_`` (K,) uint32, stable from one ``partial_fit`` to the next; ``n_features_in_`` = D.
    Raises: ConfigError for an unknown parameter; wrong values are found by ``fit``.
    """

    _estimator_type = 'clusterer'

    labels_: LabelArray
    cluster_centers_: FloatArray
    names_: npt.NDArray[np.uint32]
    n_features_in_: int

    def __init__(self, **parameters: Scalar) -> None:
        self._memory: Art2Network[Any] | None = None
        for field in dataclasses.fields(Art2Config):
            setattr(self, field.name, field.default)
        self.set_params(**parameters)

    def __repr__(self) -> str:
        defaults = Art2Config()
        changed = {name: value for name, value in self.get_params().items() if value != getattr(defaults, name)}
        return f'Art2Clusterer({", ".join(f"{name}={value!r}" for name, value in changed.items())})'

    def __sklearn_is_fitted__(self) -> bool:
        return self._memory is not None

    def __sklearn_tags__(self) -> Any:
        """Only scikit-learn asks for them."""
        from sklearn.utils import InputTags, Tags, TargetTags
        return Tags(estimator_type='clusterer', target_tags=TargetTags(required=False),
                    input_tags=InputTags(allow_nan=True))

    def get_params(self, deep: bool = True) -> dict[str, Scalar]:
        """Every parameter by name; there is nothing deeper."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(Art2Config)}

    def set_params(self, **parameters: Scalar) -> Art2Clusterer:
        """Takes effect with the next ``fit``. Raises: ConfigError for an unknown name."""
        known = self.get_params()
        for name, value in parameters.items():
            if name not in known:
                raise ConfigError(f'Art2Clusterer: expected some of {", ".join(known)}, got {name!r}')
            setattr(self, name, value)
        return self

    def fit(self, X: npt.ArrayLike, y: object = None) -> Art2Clusterer:
        """Cluster ``X`` (N, D) in a fresh memory; ``y`` is not looked at.

        Raises: VectorsError for another shape; ConfigError for a wrong parameter.
        """
        vectors = _vectors(X)
        self._memory = make_art2(with_settings(Art2Config(), self.get_params()))
        return self._present(self._memory, vectors)

    def partial_fit(self, X: npt.ArrayLike, y: object = None) -> Art2Clusterer:
        """Present ``X`` (N, D) to the memory as it is, as the next frame of a sequence.

        Raises: VectorsError for another shape, or another D than before; ConfigError for a wrong parameter.
        """
        if self._memory is None:
            return self.fit(X)
        return self._present(self._memory, _vectors(X, self.n_features_in_))

    def predict(self, X: npt.ArrayLike) -> LabelArray:
        """(N,) int32 row of ``cluster_centers_`` for each vector; nothing is learned.

        Raises: NotFittedError; VectorsError for another shape than (N, ``n_features_in_``).
        """
        if self._memory is None:
            raise NotFittedError('Art2Clusterer: expected fit or partial_fit before predict')
        return self._memory.predict(_vectors(X, self.n_features_in_))

    def fit_predict(self, X: npt.ArrayLike, y: object = None) -> LabelArray:
        """``labels_`` of ``fit``."""
        return self.fit(X).labels_

    def _present(self, memory: Art2Network[Any], vectors: FloatArray) -> Art2Clusterer:
        self.labels_ = memory.partial_fit(vectors)
        self.cluster_centers_ = memory.prototypes.copy()
        self.names_ = memory.names.copy()
        self.n_features_in_ = vectors.shape[1]
        return self


def _vectors(X: npt.ArrayLike, dimension: int | None = None) -> FloatArray:
    """Raises: VectorsError for another shape than (N, dimension), dimension 1 and more where it is not given."""
    vectors: FloatArray = np.asarray(X, np.float32)
    expected = '(N, D)' if dimension is None else f'(N, {dimension})'
    fits = vectors.ndim == 2 and vectors.shape[1] > 0 and dimension in (None, vectors.shape[1])
    if not fits:
        raise VectorsError(f'X: expected shape {expected}, got {vectors.shape}')
    return vectors
