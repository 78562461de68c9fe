"""From the residual flow of one pair of frames to candidate objects: ART2, segments, boxes."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.background.planar import Background, motion_vectors
from motion_detect_ros.core.clustering.art2 import make_art2
from motion_detect_ros.core.clustering.art2_network import Art2Network
from motion_detect_ros.core.clustering.clusterer import Clusterer
from motion_detect_ros.core.clustering.feature_vectors import FeatureVectors
from motion_detect_ros.core.clustering.neuron_counts import NeuronCounts
from motion_detect_ros.core.config import Art2Config, PipelineConfig
from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.detection.expansion import with_growth
from motion_detect_ros.core.detection.image_pair import ImagePair
from motion_detect_ros.core.detection.motion_field import MotionField
from motion_detect_ros.core.detection.objects import ObjectFinder
from motion_detect_ros.core.detection.segments import cluster_motions, connected_segments
from motion_detect_ros.core.geometry.frame_history import ReferenceFrame
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.geometry.warp import at_scale
from motion_detect_ros.core.types import FloatArray, FlowField, PreparedFrame

#: Area of a fragment, share of its object's; gap between the two, share of its size; difference of their velocities,
#: share of the object's.
FRAGMENT_SHARE, BESIDE_SHARE, ALIKE_SHARE = 0.2, 0.3, 0.5


class MotionDetector:
    """Clusters motion vectors and fits boxes to the clusters; holds the ART2 network or another clusterer."""

    def __init__(self, config: PipelineConfig, clusterer: Clusterer | None = None) -> None:
        self._vectors = FeatureVectors(config.art2)
        self._clusterer = clusterer or make_art2(config.art2)
        self._counts = NeuronCounts(config.art2, config.self_tuning)
        self.use_config(config)

    def use_config(self, config: PipelineConfig) -> None:
        """Settings from the next frame on that keep the neurons (``core.reconfiguration``)."""
        self._join_match = config.objects.join_match
        self._finder = ObjectFinder(config.objects, with_bodies=not config.trajectories.use)
        self._counts.use_config(config.art2)
        self._use_counts()

    def _use_counts(self) -> None:
        if isinstance(self._clusterer, Art2Network):
            self._clusterer.use_config(self._counts.config)

    @property
    def neurons(self) -> int:
        """Committed neurons, the background's included."""
        return len(self._clusterer.prototypes)

    @property
    def art2(self) -> Art2Config:
        """ART2's settings in use."""
        return self._counts.config

    def reset(self) -> None:
        """Clear the neurons."""
        self._clusterer.reset()
        self._vectors.reset()
        self._counts.reset()
        self._finder.reset()
        self._use_counts()

    def candidates(
        self, flow: FlowField, residual: FloatArray, background: Background, frame: PreparedFrame,
        reference: ReferenceFrame, dt_s: float,
    ) -> list[Candidate]:
        """Objects that move against the background between ``reference`` and ``frame``.

        flow: total flow between them; residual: (gh, gw, 2) the same without the ego-motion, full-resolution
        pixels, NaN = unknown; dt_s: since the frame before.
        """
        motion = motion_vectors(residual, background)
        labels = self._clusterer.partial_fit(self._vectors.of(motion), dt_s).reshape(motion.shape[:2])
        self._counts.follow(labels, dt_s)
        self._use_counts()
        clusters = cluster_motions(labels, motion, len(self._clusterer.names))
        segments = connected_segments(labels, clusters, self._join_match)
        field = MotionField(residual, background.behind(labels > 0), reference.seconds, frame.scale)
        pair = ImagePair(frame.gray, reference.gray, at_scale(reference.matrix, frame.scale), frame.mask)
        found = without_fragments(self._finder.find(segments, field, pair, self._clusterer.names, frame.stamp_ns))
        return with_growth(found, flow, field.object_flow, reference.seconds)


def without_fragments(candidates: list[Candidate]) -> list[Candidate]:
    """Without small candidates that move along with a much larger neighbour: its shadow, wake or reflection."""
    if not candidates:
        return []
    centre, size, velocity = (np.array([getattr(one, name) for one in candidates])
                              for name in ('centre', 'size', 'velocity_px_s'))
    area, half = size.prod(axis=1), size / 2.0
    pairs = area[:, None] <= FRAGMENT_SHARE * area
    for axis in (0, 1):
        gap = np.abs(centre[:, None, axis] - centre[:, axis]) - (half[:, None, axis] + half[:, axis])
        pairs &= gap <= BESIDE_SHARE * np.sqrt(area)[:, None]
    small, large = np.nonzero(pairs)  # few
    alike = magnitude(velocity[small] - velocity[large]) < ALIKE_SHARE * magnitude(velocity[large])
    fragments = set(small[alike].tolist())
    return [one for index, one in enumerate(candidates) if index not in fragments]
