"""Photometric test: which pixels does an object's motion explain better than the background flow?

Two hypotheses for every pixel of a candidate: it moved with the background, or with the object. Each predicts the
pixel from the reference frame. The likelihood gain is the squared error of the first less that of the second, over the
variance of the image noise, averaged over a small window. It is near zero for flow smeared around an object and for
false flow on textureless ground.

Uncovered background may fit the object's motion too (the ghost of every difference image). A pixel of the object at p
was at p - motion before, and there the image changed as well; for a ghost that place lies behind the object, where
nothing changed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.image_pair import ImagePair
from motion_detect_ros.core.detection.photometric_kernels import BESIDE_PX, SLACK_PX, compare
from motion_detect_ros.core.detection.prediction_errors import PredictionErrors
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.threads import HELPERS
from motion_detect_ros.core.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Place:
    """``region`` that an object may cover; ``reach``: how far beyond it its pixels may come from (``reach_px``), those
    from farther away count as background; ``motion``: (2,) over the pair, beyond the ego-motion; working pixels.
    """

    region: Box
    reach: int
    motion: FloatArray


@dataclass(frozen=True)
class PhotometricTest:
    """``foreground``: (h, w) mask of the moving object; ``gain``: (h, w) likelihood gain, 0 where the background alone
    explains a pixel.
    """

    foreground: BoolArray
    gain: FloatArray


@dataclass(frozen=True)
class PhotometricTests:
    """Those of several regions. ``boxes``: (n, 4) left, top, right, bottom of them; ``starts``: (n + 1,) where the
    pixels of each begin in ``foreground`` and ``gain``.
    """

    boxes: npt.NDArray[np.int64]
    starts: npt.NDArray[np.int64]
    foreground: BoolArray
    gain: FloatArray

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index: int) -> PhotometricTest:
        left, top, right, bottom = self.boxes[index].tolist()
        shape, there = (bottom - top, right - left), slice(self.starts[index], self.starts[index + 1])
        return PhotometricTest(self.foreground[there].reshape(shape), self.gain[there].reshape(shape))


def photometric_tests(
    pair: ImagePair, background: PredictionErrors, places: Sequence[Place], noise_gray: float, threshold_sigma: float,
    parts: int = 1,
) -> PhotometricTests:
    """Which pixels of each place its motion explains better than the background, by ``threshold_sigma`` noise levels.

    background: errors under its flow, known within the places' reach; noise_gray: one deviation; parts: threads.
    """
    boxes = np.array([(*each.region.edges, each.reach) for each in places])
    motions = np.stack([each.motion for each in places])
    sides = boxes[:, 2:4] - boxes[:, :2]
    starts = np.concatenate([[0], np.cumsum(sides.prod(axis=1))])
    foreground, gain = np.zeros(starts[-1], np.bool_), np.empty(starts[-1], np.float32)
    size = np.array(pair.current.shape[::-1])
    windows = np.minimum(sides + 2 * np.maximum(boxes[:, 4:], BESIDE_PX), size)  # at most so large
    width, height = (windows.max(axis=0) + 2 * BESIDE_PX).tolist()
    pixels, area = int(np.diff(starts).max()), int(windows.prod(axis=1).max())

    def every(first: int) -> None:
        compare(*pair.pictures, pair.back, background.values, background.box.left, background.box.top, boxes,
                background.flow, motions, np.float32(noise_gray ** 2),
                np.float32((noise_gray * threshold_sigma) ** 2), np.float32(threshold_sigma ** 2), first, parts,
                np.empty((2, width), np.uint32), np.empty((4, width), np.uint8), np.empty((9, width), np.float32),
                np.empty(width, np.int32), np.empty(area, np.uint16), np.empty((height, 2), np.int64),
                np.empty((pixels, 4), np.int32), np.empty(area, np.bool_), starts, foreground, gain)

    HELPERS.share(every, range(parts))
    tests = PhotometricTests(boxes[:, :4], starts, foreground, gain)
    if pair.mask is not None:
        for n, place in enumerate(places):
            region, mask = place.region, tests[n].foreground
            mask &= pair.mask[region.top:region.bottom, region.left:region.right]
    return tests


def reach_px(object_motion: FloatArray) -> int:
    """Largest distance of an object's pixels from their origins, with the slack of the test.

    object_motion: (2,) pixels over the pair, against the background.
    """
    return math.ceil(float(np.hypot(object_motion[0], object_motion[1]))) + SLACK_PX
