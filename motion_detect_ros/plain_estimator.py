"""The part of scikit-learn that ``art2_clusterer`` needs, for where scikit-learn is not installed.

Names, errors and their texts are scikit-learn's (1.6 and later).
"""

from __future__ import annotations

import inspect
from typing import Any, Self

import numpy as np
import numpy.typing as npt


class NotFittedError(ValueError, AttributeError):
    """An answer is asked of an estimator that has seen nothing."""


class ClusterMixin:
    """``fit_predict``."""

    def fit_predict(self, X: npt.ArrayLike, y: object = None) -> Any:
        """``labels_`` of ``fit``."""
        return self.fit(X).labels_  # type: ignore[attr-defined]


class BaseEstimator:
    """Parameters are the keywords of ``__init__``, kept under their names."""

    @classmethod
    def _parameters(cls) -> dict[str, Any]:
        """Defaults by name."""
        return {name: one.default for name, one in inspect.signature(cls).parameters.items()}

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Every parameter by name."""
        return {name: getattr(self, name) for name in self._parameters()}

    def set_params(self, **parameters: Any) -> Self:
        """Takes effect with the next ``fit``. Raises: ValueError for an unknown name."""
        known = self._parameters()
        for name, value in parameters.items():
            if name not in known:
                raise ValueError(f'Invalid parameter {name!r} for estimator {self!r}. '
                                 f'Valid parameters are: {sorted(known)!r}.')
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        defaults = self._parameters()
        changed = {name: value for name, value in self.get_params().items() if value != defaults[name]}
        return f'{type(self).__name__}({", ".join(f"{name}={value!r}" for name, value in changed.items())})'


def check_is_fitted(estimator: Any) -> None:
    """Raises: NotFittedError."""
    if not estimator.__sklearn_is_fitted__():
        raise NotFittedError(f"This {type(estimator).__name__} instance is not fitted yet. Call 'fit' with "
                             'appropriate arguments before using this estimator.')


def validate_data(estimator: Any, X: npt.ArrayLike, *, reset: bool, dtype: Any, **_: Any) -> npt.NDArray[Any]:
    """``X`` as (N, D) ``dtype``, N and D at least 1; ``reset``: ``n_features_in_`` is set, else it must be D.

    Raises: ValueError.
    """
    array = np.asarray(X)
    if np.iscomplexobj(array):
        raise ValueError(f'Complex data not supported\n{X!r}\n')
    array = array.astype(dtype)
    if array.ndim > 2:
        raise ValueError(f'Found array with dim {array.ndim}, while dim <= 2 is required.')
    if array.ndim < 2:
        raise ValueError(f'Expected 2D array, got {array.ndim}D array instead. Reshape your data.')
    for axis, what in enumerate(('sample', 'feature')):
        if not array.shape[axis]:
            raise ValueError(f'Found array with 0 {what}(s) (shape={array.shape}) while a minimum of 1 is required.')
    if reset:
        estimator.n_features_in_ = array.shape[1]
    elif array.shape[1] != estimator.n_features_in_:
        raise ValueError(f'X has {array.shape[1]} features, but {type(estimator).__name__} is expecting '
                         f'{estimator.n_features_in_} features as input.')
    return array
