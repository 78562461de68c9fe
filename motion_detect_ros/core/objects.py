"""From segments of clustered cells to candidate objects, with boxes fitted on the images."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.background import Background
from motion_detect_ros.core.boxes import (
    Box,
    Patch,
    bounding_patch,
    connected_patches,
    joined_patches,
)
from motion_detect_ros.core.config import ObjectsConfig
from motion_detect_ros.core.evidence import ImagePair, Support, image_noise, support
from motion_detect_ros.core.scoring import log_odds
from motion_detect_ros.core.segments import Segment
from motion_detect_ros.core.track import Candidate
from motion_detect_ros.core.types import BoolArray, FloatArray
from motion_detect_ros.core.warp import grid_points

#: A segment's surroundings that its object may reach into, working-resolution pixels.
MARGIN_PX = 8
#: The same before a three-dimensional background, share of the segment's size: only the part of an object that is below
#: the ground's depth gives it away, what stands above that part may be as large.
SPACE_MARGIN_SHARE = 0.5
#: Fewer supported pixels than this are noise.
MIN_PIXELS = 8
#: How far around an object the flow shows whether it is to be trusted there, cells.
AROUND_CELLS = 4
#: The gain that a patch's strongest pixels reach, as a percentile.
PEAK_PERCENTILE = 90.0


@dataclass(frozen=True)
class MotionField:
    """What the grid says about one frame.

    ``residual``: (gh, gw, 2) motion beyond the ego-motion, full-resolution pixels over ``seconds``, NaN = unknown;
    ``background``: what of it is the background's; ``scale``: working / full resolution.
    """

    residual: FloatArray
    background: Background
    seconds: float
    scale: float

    def still(self, region: Box, width: int, height: int) -> FloatArray:
        """(h, w, 2) motion of the background in a region of the ``width`` x ``height`` working image, its pixels."""
        rows, columns = self.background.flow.shape[:2]
        cells = (region.points() + np.float32(0.5)) * np.array([columns / width, rows / height], np.float32)
        flow: FloatArray = cv2.remap(self.background.flow, cells - np.float32(0.5), None, cv2.INTER_LINEAR,
                                     borderMode=cv2.BORDER_REPLICATE)
        return flow * np.float32(self.scale)

    def own_motion(self, rows: slice, columns: slice) -> tuple[FloatArray, float, float]:
        """Motion against the background in a window of cells: (2,) pixels, in noise units, share of known cells.

        The median of the faster half of the cells; the slower half is leaked background.
        """
        own = (self.residual - self.background.flow)[rows, columns].reshape(-1, 2)
        known = np.isfinite(own[:, 0])
        if not known.any():
            return np.zeros(2, np.float32), 0.0, 0.0
        own = own[known]
        length = np.hypot(own[:, 0], own[:, 1])
        motion: FloatArray = np.median(own[length >= np.median(length)], axis=0)
        sigma_px = float(np.median(self.background.sigma_px[rows, columns]))
        return motion, float(np.hypot(motion[0], motion[1])) / sigma_px, float(known.mean())

    def known_around(self, rows: slice, columns: slice) -> float:
        """Share of the cells within ``AROUND_CELLS`` of a window of cells, but not in it, whose motion is known."""
        known = np.isfinite(self.residual[..., 0])
        inside = known[rows, columns]
        wide = known[max(0, rows.start - AROUND_CELLS):rows.stop + AROUND_CELLS,
                     max(0, columns.start - AROUND_CELLS):columns.stop + AROUND_CELLS]
        return (np.count_nonzero(wide) - np.count_nonzero(inside)) / max(1, wide.size - inside.size)


class ObjectFinder:
    """Checks every segment against the images and fits its boxes."""

    def __init__(self, config: ObjectsConfig) -> None:
        self._config = config

    def find(
        self, segments: list[Segment], field: MotionField, pair: ImagePair, names: npt.NDArray[np.uint32],
    ) -> list[Candidate]:
        """Candidates in full-resolution pixels. names: (K,) number of each ART2 neuron."""
        if not segments:
            return []
        rows, columns = field.residual.shape[:2]
        height, width = pair.current.shape
        still = field.background.flow * np.float32(field.scale)
        noise_gray = image_noise(pair, grid_points(rows, columns, width, height), still)
        return [self._candidate(patch, field, pair, int(names[segment.neuron]))
                for segment in segments for patch in self._patches(segment, field, pair, noise_gray)]

    def _patches(self, segment: Segment, field: MotionField, pair: ImagePair, noise_gray: float) -> list[Patch]:
        """Patches of the image around one segment that its motion explains, working-resolution pixels."""
        height, width = pair.current.shape
        cells = (segment.rows, segment.columns)
        region = self._region(segment, field, width, height)
        motion = np.median(field.residual[cells], axis=0) * np.float32(field.scale)
        still = field.still(region, width, height)
        seen = support(pair, region, still, motion, noise_gray, self._config.evidence_sigma)
        inside = _cell_mask(segment, field.residual.shape[:2], region, width, height)
        found = self._supported(seen, inside)
        joined = joined_patches(found, self._config.join_gap_share)
        return [patch.moved(region.left, region.top) for patch in joined if self._plausible(patch, width * height)]

    @staticmethod
    def _region(segment: Segment, field: MotionField, width: int, height: int) -> Box:
        rows, columns = field.residual.shape[:2]
        r, c = segment.rows, segment.columns
        box = Box(int(c.min()) * width // columns, int(r.min()) * height // rows,
                  -(-(int(c.max()) + 1) * width // columns), -(-(int(r.max()) + 1) * height // rows))
        margin = MARGIN_PX
        if not field.background.smooth:
            margin = max(margin, round(SPACE_MARGIN_SHARE * min(box.width, box.height)))
        return box.grown(margin, width, height)

    def _supported(self, seen: Support, inside: BoolArray) -> list[Patch]:
        """Patches that touch the segment, cut down to the pixels near their strongest gain.

        A soft shadow moves with its object, but its gain is far below that of the object's own edges.
        """
        found = []
        for mask in connected_patches(seen.mask, self._config.closing_px):
            if not (mask & inside).any() or np.count_nonzero(mask) < MIN_PIXELS:
                continue
            peak = np.percentile(seen.gain[mask], PEAK_PERCENTILE)
            strong = mask & (seen.gain > self._config.peak_share * peak)
            if np.count_nonzero(strong) >= MIN_PIXELS:
                found.append(bounding_patch(strong))
        return found

    def _plausible(self, patch: Patch, image_area: int) -> bool:
        config = self._config
        return (patch.fill >= config.min_fill and min(patch.box.width, patch.box.height) >= config.min_side_px
                and patch.box.area <= config.max_area_share * image_area)

    @staticmethod
    def _candidate(patch: Patch, field: MotionField, pair: ImagePair, name: int) -> Candidate:
        box, scale = patch.box, field.scale
        rows, columns = field.residual.shape[:2]
        height, width = pair.current.shape
        cells = (slice(box.top * rows // height, -(-box.bottom * rows // height)),
                 slice(box.left * columns // width, -(-box.right * columns // width)))
        motion, sigmas, known = field.own_motion(*cells)
        around = field.known_around(*cells)
        centre = np.array([box.left + box.right, box.top + box.bottom]) / (2.0 * scale)
        size = np.array([box.width, box.height]) / scale
        return Candidate(centre, size, motion.astype(np.float64) / field.seconds, patch.pixels / scale ** 2,
                         log_odds(patch.pixels, sigmas, known, around), name)


def _cell_mask(segment: Segment, grid: tuple[int, ...], region: Box, width: int, height: int) -> BoolArray:
    """The segment's cells as pixels of ``region``."""
    cells = np.zeros(grid, np.bool_)
    cells[segment.rows, segment.columns] = True
    ys = np.arange(region.top, region.bottom) * grid[0] // height
    xs = np.arange(region.left, region.right) * grid[1] // width
    mask: BoolArray = cells[np.ix_(ys, xs)]
    return mask
