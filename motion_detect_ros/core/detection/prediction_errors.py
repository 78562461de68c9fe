"""How far the grey values that a flow predicts from an earlier image are from those that are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.image_pair import ImagePair
from motion_detect_ros.core.detection.photometric_kernels import BESIDE_PX, fill_tiles
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.threads import HELPERS
from motion_detect_ros.core.types import FloatArray

#: Side of the squares of an image in which errors are computed where any is asked for, pixels.
TILE_PX = 32
#: Fewest tiles worth a thread.
LEAST_TILES = 60


@dataclass(frozen=True)
class PredictionErrors:
    """``values``: (h, w) uint16 squared errors of the pixels of the current image where they are asked for, and beside;
    ``flow``: (gh, gw, 2) beyond the ego-motion on a grid over the image, pixels over the pair.
    """

    values: npt.NDArray[np.uint16]
    flow: FloatArray

    @classmethod
    def near(cls, pair: ImagePair, boxes: Sequence[Box], flow: FloatArray) -> PredictionErrors:
        """Those of several boxes."""
        height, width = pair.current.shape
        wanted = np.zeros((-(-height // TILE_PX), -(-width // TILE_PX)), np.bool_)
        for box in (each.grown(BESIDE_PX, width, height) for each in boxes):
            wanted[box.top // TILE_PX:-(-box.bottom // TILE_PX), box.left // TILE_PX:-(-box.right // TILE_PX)] = True
        values, parts = np.empty((height, width), np.uint16), HELPERS.parts(int(wanted.sum()), LEAST_TILES)

        def every(first: int) -> None:
            fill_tiles(*pair.pictures, pair.back, 0, 0, flow, TILE_PX, wanted, first, parts,
                       np.empty((2, width), np.uint32), np.empty((4, width), np.uint8),
                       np.empty((9, width), np.float32), values)

        HELPERS.share(every, range(parts))
        return cls(values, flow)
