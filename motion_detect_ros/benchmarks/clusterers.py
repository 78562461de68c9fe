"""Clusterers by name for the comparison of ``benchmarks.art2_table``: ART2 and those of optional libraries."""

from __future__ import annotations

import importlib
import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.clustering.art2 import make_art2
from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import FloatArray

Labels = npt.NDArray[np.int64]
Parameters = Mapping[str, Any]

#: ``pip install 'motion_detect_ros[compare]'`` brings these.
DISTRIBUTIONS = {'sklearn': 'scikit-learn', 'artlib': 'artlib'}


@dataclass(frozen=True)
class Clusterer:
    """``run(vectors, parameters)`` labels (N, 2) vectors in noise units; ``grid``: values of each parameter to try.

    ``library``: what must be installed, '' = nothing; ``most_vectors``: with more it needs too much memory.
    """

    name: str
    run: Callable[[FloatArray, Parameters], Labels]
    grid: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    library: str = ''
    most_vectors: int | None = None

    def choices(self) -> Iterator[dict[str, Any]]:
        """Every combination of the grid; one empty choice without a grid."""
        for values in itertools.product(*self.grid.values()):
            yield dict(zip(self.grid, values, strict=True))

    def require(self) -> None:
        """Raises: BackendError where the library is missing."""
        if not self.library:
            return
        try:
            importlib.import_module(self.library)
        except ImportError:
            name = DISTRIBUTIONS[self.library]
            raise BackendError(
                f"{self.name}: expected {name}; install it: pip install 'motion_detect_ros[compare]'") from None


def art2(vectors: FloatArray, parameters: Parameters) -> Labels:
    """One frame in a fresh memory."""
    return make_art2(with_settings(Art2Config(), parameters)).partial_fit(vectors).astype(np.int64)


def artlib_module(name: str, vectors: FloatArray, parameters: Parameters) -> Labels:
    """A module of artlib on vectors scaled to [0, 1], its own preparation."""
    module = getattr(importlib.import_module('artlib'), name)(**parameters)
    prepared = module.prepare_data(vectors.astype(np.float64))
    return np.asarray(module.fit_predict(prepared), np.int64)


def sklearn_cluster(name: str, vectors: FloatArray, parameters: Parameters) -> Labels:
    """A class of sklearn.cluster."""
    return np.asarray(
        getattr(importlib.import_module('sklearn.cluster'), name)(**parameters).fit_predict(vectors), np.int64)


def _artlib(name: str) -> Callable[[FloatArray, Parameters], Labels]:
    return lambda vectors, parameters: artlib_module(name, vectors, parameters)


def _sklearn(name: str, **fixed: Any) -> Callable[[FloatArray, Parameters], Labels]:
    return lambda vectors, parameters: sklearn_cluster(name, vectors, {**fixed, **parameters})


#: Each grid has twelve choices, so that none is tuned harder than another.
CLUSTERERS = (
    Clusterer('ART2 magnitude, defaults', art2),
    Clusterer('ART2 magnitude', art2, {
        'vigilance': (0.2, 0.22, 0.25), 'spread_match': (0.7, 0.8), 'merge_match': (0.8, 1.0)}),
    Clusterer('ART2 classic', art2, {
        'variant': ('classic',), 'vigilance': (0.9, 0.95, 0.98), 'background_sigma': (3.0, 4.0),
        'learning': ('slow', 'fast')}),
    Clusterer('artlib ART2A', _artlib('ART2A'), {
        'rho': (0.4, 0.45, 0.5, 0.55, 0.6, 0.65), 'alpha': (1e-7,), 'beta': (0.1, 0.95)}, 'artlib'),
    Clusterer('artlib FuzzyART', _artlib('FuzzyART'), {
        'rho': (0.6, 0.65, 0.7, 0.75, 0.8, 0.85), 'alpha': (1e-7,), 'beta': (0.1, 1.0)}, 'artlib'),
    Clusterer('MiniBatchKMeans', _sklearn('MiniBatchKMeans', random_state=0, n_init=3), {
        'n_clusters': (2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 20, 25)}, 'sklearn'),
    Clusterer('DBSCAN', _sklearn('DBSCAN'), {
        'eps': (0.3, 0.4, 0.5, 0.7), 'min_samples': (5, 10, 20)}, 'sklearn', 25_000),
    Clusterer('HDBSCAN', _sklearn('HDBSCAN', copy=True), {
        'min_cluster_size': (10, 20, 50), 'min_samples': (2, 5, 10, 20)}, 'sklearn'),
)
