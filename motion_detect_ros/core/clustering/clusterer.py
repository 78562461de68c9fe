"""Interface of the clusterers; ``Art2Network`` implements it."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.clustering.art2_network import LabelArray
from motion_detect_ros.core.types import FloatArray


class Clusterer(Protocol):
    """Labels the motion vectors of one frame after the other; cluster 0 is the background."""

    prototypes: FloatArray

    @property
    def names(self) -> npt.NDArray[np.uint32]:
        """(K,) number of each cluster, 0 = background."""

    def reset(self) -> None:
        """Clear the state of earlier frames."""

    def partial_fit(self, vectors: FloatArray, dt_s: float) -> LabelArray:
        """(N,) int32 index into ``prototypes`` (K, 2) for (N, D) float32 vectors, -1 = not finite.

        dt_s: since the frame before, seconds.
        """
