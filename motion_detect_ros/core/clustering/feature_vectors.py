"""The input vectors of ART2: motion in units of its noise, and other features of the flow (``art2.features``).

Every further feature is its difference from the image's median in units of the median absolute deviation, so that the
background is at zero as it is for the motion; all further features together have the weight of one component of the
motion.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from motion_detect_ros.core.clustering.flow_features import (
    angle,
    coherence,
    consistency,
    curl,
    divergence,
    entropy,
    local_hoof,
    temporal_change,
)
from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.geometry.robust import MAD_TO_SIGMA
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Side of the window of local features, cells, odd.
WINDOW_CELLS = 7
#: Derivatives are per cell, not per pixel: features are scaled by their deviation anyway.
CELL = (1.0, 1.0)
#: Least deviation that a feature is taken to have, its own unit: about what motion of noise alone gives it, so that an
#: image with less noise than that does not turn what is left into motion.
NOISE_DEVIATION = {'magnitude': 1.0, 'angle': 0.5, 'divergence': 1.0, 'curl': 1.0, 'consistency': 0.4,
                   'temporal_change': 1.0, 'hoof': 0.2, 'entropy': 0.7, 'coherence': 0.3}

#: (motion (gh, gw, 2) in noise units, that of the frame before) -> (gh, gw) or (gh, gw, n).
Feature = Callable[[FloatArray, FloatArray | None], FloatArray]


def _direction(motion: FloatArray, _previous: FloatArray | None) -> FloatArray:
    """(gh, gw, 2) cosine and sine of the angle, shorter where the motion is under its noise and has none."""
    theta, length = angle(motion), np.minimum(magnitude(motion), 1.0)
    direction: FloatArray = np.stack([length * np.cos(theta), length * np.sin(theta)], axis=-1)
    return direction


#: What ``art2.features`` may name besides ``motion``: the features of the report.
FEATURES: dict[str, Feature] = {
    'magnitude': lambda motion, _: magnitude(motion),
    'angle': _direction,
    'divergence': lambda motion, _: divergence(motion, CELL),
    'curl': lambda motion, _: curl(motion, CELL),
    'consistency': lambda motion, _: consistency(motion, WINDOW_CELLS),
    'temporal_change': temporal_change,
    'hoof': lambda motion, _: local_hoof(motion, WINDOW_CELLS),
    'entropy': lambda motion, _: entropy(motion, WINDOW_CELLS),
    'coherence': lambda motion, _: coherence(motion, WINDOW_CELLS),
}


class FeatureVectors:
    """Computes the vectors of consecutive frames."""

    def __init__(self, config: Art2Config) -> None:
        self._names = [name for name in config.feature_names if name != 'motion']
        self._with_motion = 'motion' in config.feature_names
        self._previous: FloatArray | None = None

    def reset(self) -> None:
        """Clear the previous frame."""
        self._previous = None

    def of(self, motion: FloatArray) -> FloatArray:
        """(gh * gw, D) float32 vectors, NaN where the motion is unknown.

        motion: (gh, gw, 2) against the background, noise units, NaN = unknown.
        """
        if not self._names:
            return motion.reshape(-1, 2)
        previous, self._previous = self._previous, motion
        if previous is not None and previous.shape != motion.shape:
            previous = None
        known = np.isfinite(motion[..., 0]).reshape(-1)
        blocks = [_in_deviations(FEATURES[name](motion, previous).reshape(len(known), -1), known, NOISE_DEVIATION[name])
                  for name in self._names]
        weighted = [block / np.float32(np.sqrt(block.shape[1] * len(blocks))) for block in blocks]
        parts = [motion.reshape(-1, 2), *weighted] if self._with_motion else weighted
        vectors = np.concatenate(parts, axis=1).astype(np.float32)
        vectors[~known] = np.nan
        return vectors


def _in_deviations(values: FloatArray, known: BoolArray, least: float) -> FloatArray:
    """(N, n) differences from the medians of the known rows, in deviations; 0 where a feature is not known."""
    if not known.any():
        return np.zeros_like(values)
    with np.errstate(all='ignore'):
        counted = np.where(np.isfinite(values), values, np.float32(np.nan))[known]
        counted = np.where(np.isfinite(counted).any(axis=0), counted, 0.0)  # e.g. no frame before
        middle = np.nanmedian(counted, axis=0)
        deviation = np.maximum(MAD_TO_SIGMA * np.nanmedian(np.abs(counted - middle), axis=0), least)
        scaled: FloatArray = np.nan_to_num((values - middle) / deviation, posinf=0.0, neginf=0.0)
    return scaled
