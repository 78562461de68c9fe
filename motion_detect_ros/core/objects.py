"""From segments of clustered cells to candidate objects with boxes refined on the image."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.background import Background
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.evidence import Box, ImagePair, gain_map, image_noise, supported_box
from motion_detect_ros.core.segments import Segment
from motion_detect_ros.core.tracks import Candidate
from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray, PreparedFrame
from motion_detect_ros.core.warp import at_scale, grid_points


class ObjectFinder:
    """Checks every segment against the images and fits its box."""

    def __init__(self, config: PipelineConfig) -> None:
        self._config = config.objects

    def find(
        self, segments: list[Segment], residual: FloatArray, background: Background, frame: PreparedFrame,
        earlier: ByteArray, matrix: DoubleArray, seconds: float, names: npt.NDArray[np.uint32],
    ) -> list[Candidate]:
        """Candidates in full-resolution pixels.

        residual: (gh, gw, 2) full-resolution pixels over ``seconds``; matrix: (3, 3) earlier -> current, full
        resolution; names: (K,) number of each neuron.
        """
        if not segments:
            return []
        pair = ImagePair(frame.gray, earlier, at_scale(matrix, frame.scale))
        rows, columns = residual.shape[:2]
        height, width = frame.gray.shape
        noise = image_noise(pair, grid_points(rows, columns, width, height), background.flow * np.float32(frame.scale))
        found = (self._candidate(s, residual, background, pair, noise, frame.scale, seconds, names) for s in segments)
        return [candidate for candidate in found if candidate is not None]

    def _candidate(
        self, segment: Segment, residual: FloatArray, background: Background, pair: ImagePair, noise_gray: float,
        scale: float, seconds: float, names: npt.NDArray[np.uint32],
    ) -> Candidate | None:
        r, c = segment.rows, segment.columns
        motion = np.median(residual[r, c], axis=0)
        still = np.median(background.flow[r, c], axis=0)
        height, width = pair.current.shape
        cell_h, cell_w = height / residual.shape[0], width / residual.shape[1]
        cells = Box(int(c.min() * cell_w), int(r.min() * cell_h),
                    int(np.ceil((c.max() + 1) * cell_w)), int(np.ceil((r.max() + 1) * cell_h)))
        roi = cells.grown(8, width, height)
        gain = gain_map(pair, roi, still * np.float32(scale), motion * np.float32(scale), noise_gray)
        inside = np.zeros(residual.shape[:2], bool)
        inside[r, c] = True
        ys = np.minimum((np.arange(roi.top, roi.bottom) / cell_h).astype(int), residual.shape[0] - 1)
        xs = np.minimum((np.arange(roi.left, roi.right) / cell_w).astype(int), residual.shape[1] - 1)
        box, pixels = supported_box(gain > self._config.evidence_sigma ** 2, inside[np.ix_(ys, xs)], 6)
        if box is None:
            return None
        share = pixels / ((box.right - box.left) * (box.bottom - box.top))
        size = np.array([box.right - box.left, box.bottom - box.top]) / scale
        if share < self._config.min_evidence or size.min() < self._config.min_side_px:
            return None
        if size.prod() * scale * scale > self._config.max_area_share * width * height:
            return None
        centre = (np.array([box.left + box.right, box.top + box.bottom]) / 2.0
                  + [roi.left, roi.top]) / scale
        return Candidate(centre, size, (motion - still).astype(float) / seconds, pixels / scale ** 2,
                         float(min(1.0, share)), int(names[segment.neuron]))
