"""Other clusterers in ART2's place inside the detector: what ART2 is worth there.

Background is to all of them what it is to ART2 at the vigilance of the presets: vectors of up to
``BACKGROUND_SIGMA`` noise units (similarity to zero 1 / (1 + 4) = 0.2). They cluster the rest of each frame, without
memory of earlier frames; a cluster's prototype is the mean of its vectors, what DBSCAN calls noise is background.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, product
from typing import Any

import numpy as np
import numpy.typing as npt

from motion_detect_ros.benchmarks.accuracy_clips import Clip, ClipRun
from motion_detect_ros.core.clustering.art2_network import NOT_PRESENTED, LabelArray
from motion_detect_ros.core.clustering_stage import ClusteringStage
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.geometry.frame_history import FrameHistory
from motion_detect_ros.core.optical_flow.stage import OpticalFlowStage
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.settings import Scalar, with_settings
from motion_detect_ros.core.types import FloatArray, RecordArray
from motion_detect_ros.presets import load_preset

BACKGROUND_SIGMA = 4.0
ONE_CLUSTER, KMEANS, DBSCAN = 'one cluster', 'KMeans', 'DBSCAN'


@dataclass(frozen=True)
class Substitute:
    """``method``: one of ``ONE_CLUSTER``, ``KMEANS``, ``DBSCAN``; ``parameters``: of the class of sklearn.cluster."""

    method: str
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def require(self) -> None:
        """Raises: BackendError where scikit-learn is needed and missing."""
        if self.method == ONE_CLUSTER:
            return
        try:
            importlib.import_module('sklearn.cluster')
        except ImportError as error:
            raise BackendError(f"{self.method}: expected scikit-learn ({error}); "
                               "install it: pip install 'motion_detect_ros[compare]'") from None

    def __str__(self) -> str:
        return ', '.join([self.method, *(f'{name}={value}' for name, value in self.parameters.items())])


class SubstituteClusterer:
    """A ``Clusterer`` that knows the frame at hand only."""

    def __init__(self, substitute: Substitute) -> None:
        substitute.require()
        self._substitute = substitute
        self.reset()

    @property
    def names(self) -> npt.NDArray[np.uint32]:
        """(K,) 0, 1, 2, ...: they mean nothing from one frame to the next."""
        return np.arange(len(self.prototypes), dtype=np.uint32)

    def reset(self) -> None:
        """Nothing but the background."""
        self.prototypes: FloatArray = np.zeros((1, 2), np.float32)

    def partial_fit(self, vectors: FloatArray, _dt_s: float = 0.0) -> LabelArray:
        """(N,) int32 labels of (N, 2) vectors in noise units: 0 = background, -1 = not finite."""
        length = np.hypot(vectors[:, 0], vectors[:, 1])
        labels = np.where(np.isfinite(length), 0, NOT_PRESENTED).astype(np.int32)
        moving = np.flatnonzero(length > BACKGROUND_SIGMA)
        found = self._cluster(vectors[moving])
        labels[moving] = found + 1
        means = [vectors[moving[found == cluster]].mean(axis=0) for cluster in range(found.max(initial=-1) + 1)]
        self.prototypes = np.array([(0.0, 0.0), *means], np.float32)
        return labels

    def _cluster(self, vectors: FloatArray) -> npt.NDArray[np.int64]:
        """(N,) labels from 0, every one of them in use; -1 = noise."""
        method, parameters = self._substitute.method, dict(self._substitute.parameters)
        if method == ONE_CLUSTER or not len(vectors):
            return np.zeros(len(vectors), np.int64)
        if method == KMEANS:
            different = len(np.unique(vectors, axis=0))
            parameters = {'n_init': 1, 'random_state': 0, **parameters,
                          'n_clusters': min(parameters['n_clusters'], different)}
        model = getattr(importlib.import_module('sklearn.cluster'), method)(**parameters)
        with importlib.import_module('threadpoolctl').threadpool_limits(1):  # several would round by their number
            labels: npt.NDArray[np.int64] = model.fit_predict(vectors).astype(np.int64)
        _, in_use = np.unique(labels[labels >= 0], return_inverse=True)
        labels[labels >= 0] = in_use
        return labels


@dataclass(frozen=True)
class Choice:
    """Settings on top of the presets (of the clustering and what follows), and what stands in ART2's place."""

    changes: Mapping[str, Scalar] = field(default_factory=dict)
    substitute: Substitute | None = None

    def __str__(self) -> str:
        settings = ', '.join(f'{name}={value}' for name, value in self.changes.items())
        return ', '.join(filter(None, (str(self.substitute or ''), settings)))


def run_choices(clip: Clip, choices: Sequence[Choice]) -> list[ClipRun]:
    """Every frame of a clip through one ego-motion and flow, then through the clustering of each choice.

    ``frame_ms`` of the runs is unknown: NaN.
    """
    source, preset = clip.source(), load_preset(clip.preset)
    stages = [ClusteringStage(with_settings(preset, choice.changes), source.camera,
                              SubstituteClusterer(choice.substitute) if choice.substitute else None)
              for choice in choices]
    detections = [dict[int, RecordArray]() for _ in choices]
    preprocessor, ego_motion = Preprocessor(preset.preprocessing), EgoMotionStage(preset, source.camera)
    history, optical_flow = FrameHistory(preset.optical_flow.baseline_s), OpticalFlowStage(preset)
    for one in islice(source, clip.limit):
        frame = preprocessor.process(one.image, one.stamp_ns)
        ego = ego_motion.process(frame)
        reference = history.step(frame, ego)
        flow = optical_flow.process(frame, ego, reference)
        for stage, found in zip(stages, detections, strict=True):
            found[one.index] = stage.process(frame, ego, reference, flow)
    return [ClipRun(clip, found, float('nan')) for found in detections]


def grids() -> dict[str, list[Choice]]:
    """Twelve choices for each way to cluster, so that none is tuned harder than another."""
    return {
        'ART2 magnitude': list(_settings_grid({
            'art2.spread_match': (0.4, 0.5, 0.6, 0.7, 0.8, 0.9), 'art2.merge_match': (1.0, 0.8)})),
        'ART2 classic': list(_settings_grid({
            'art2.variant': ('classic',), 'art2.vigilance': (0.9, 0.95, 0.97, 0.98, 0.99, 0.995),
            'art2.background_sigma': (3.0, 4.0)})),
        KMEANS: [Choice(substitute=Substitute(KMEANS, {'n_clusters': count}))
                 for count in (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25)],
        DBSCAN: [Choice(substitute=Substitute(DBSCAN, {'eps': eps, 'min_samples': samples}))
                 for eps, samples in product((0.5, 1.0, 2.0, 4.0), (3, 10, 30))],
    }


def _settings_grid(values: Mapping[str, tuple[Scalar, ...]]) -> Iterator[Choice]:
    for chosen in product(*values.values()):
        yield Choice(dict(zip(values, chosen, strict=True)))


def check(config: PipelineConfig, choice: Choice) -> None:
    """Raises: ConfigError for a wrong setting, BackendError for a missing library."""
    with_settings(config, choice.changes)
    if choice.substitute:
        choice.substitute.require()
