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
from motion_detect_ros.core.types import BoolArray, FloatArray

#: Side of the squares of an image in which errors are computed where any is asked for, pixels.
TILE_PX = 32
#: Fewest tiles worth a thread.
LEAST_TILES = 60


@dataclass(frozen=True)
class PredictionErrors:
    """``values``: (h, w) uint16 squared errors of the pixels of ``box``, which holds all that are asked for and those
    beside them; ``flow``: (gh, gw, 2) beyond the ego-motion on a grid over the image, pixels over the pair, (1, 1, 2)
    where it is the same everywhere.
    """

    values: npt.NDArray[np.uint16]
    box: Box
    flow: FloatArray

    @classmethod
    def within(cls, pair: ImagePair, box: Box, flow: FloatArray) -> PredictionErrors:
        """Those of a box, under a ``flow`` beyond the ego-motion that is the same everywhere, (2,) pixels."""
        height, width = pair.current.shape
        box, flow = box.grown(BESIDE_PX, width, height), flow.reshape(1, 1, 2)
        values = np.empty((box.height, box.width), np.uint16)
        _fill(pair, box, flow, max(values.shape), np.ones((1, 1), np.bool_), values, 1)
        return cls(values, box, flow)

    @classmethod
    def near(cls, pair: ImagePair, boxes: Sequence[Box], flow: FloatArray) -> PredictionErrors:
        """Those of several boxes, under the flow (gh, gw, 2) of a grid over the image, pixels."""
        height, width = pair.current.shape
        wanted = np.zeros((-(-height // TILE_PX), -(-width // TILE_PX)), np.bool_)
        for box in (each.grown(BESIDE_PX, width, height) for each in boxes):
            wanted[box.top // TILE_PX:-(-box.bottom // TILE_PX), box.left // TILE_PX:-(-box.right // TILE_PX)] = True
        values = np.empty((height, width), np.uint16)
        _fill(pair, Box(0, 0, width, height), flow, TILE_PX, wanted, values,
              HELPERS.parts(int(wanted.sum()), LEAST_TILES))
        return cls(values, Box(0, 0, width, height), flow)


def _fill(
    pair: ImagePair, box: Box, flow: FloatArray, tile_px: int, wanted: BoolArray, values: npt.NDArray[np.uint16],
    parts: int,
) -> None:
    """``values`` of a box where its tiles are ``wanted``; parts: threads."""
    pictures, back = pair.pictures, pair.back

    def every(first: int) -> None:
        fill_tiles(*pictures, back, box.left, box.top, flow, tile_px, wanted, first, parts,
                    np.empty((2, box.width), np.uint32), np.empty((4, box.width), np.uint8),
                    np.empty((9, box.width), np.float32), values)

    HELPERS.share(every, range(parts))
