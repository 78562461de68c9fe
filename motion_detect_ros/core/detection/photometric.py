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
from typing import Any

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.detection.image_pair import ImagePair
from motion_detect_ros.core.detection.photometric_kernels import BESIDE_PX, SLACK_PX, compare
from motion_detect_ros.core.detection.prediction_errors import PredictionErrors
from motion_detect_ros.core.geometry.boxes import Box
from motion_detect_ros.core.threads import HELPERS
from motion_detect_ros.core.types import BoolArray, FloatArray

#: One tile, all of it wanted.
WHOLE = np.ones((1, 1), np.bool_)


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

    background: errors under its flow, known within the places' reach; places: at least one; noise_gray: one deviation;
    parts: threads.
    """
    work = _Work.of(pair, places)
    limits = _limits(noise_gray, threshold_sigma)

    def every(first: int) -> None:
        compare(*pair.pictures, pair.back, background.values, work.boxes, background.flow[None], False, WHOLE,
                work.motions, *limits, first, parts, *work.scratch(), work.starts, work.foreground, work.gain)

    HELPERS.share(every, range(parts))
    return work.tests(pair.mask)


def photometric_tests_apart(
    pair: ImagePair, flows: Sequence[FloatArray], places: Sequence[Place], noise_gray: float, threshold_sigma: float,
) -> PhotometricTests:
    """The same, each against a background that moves in its own way. flows: (2,) of each, beyond the ego-motion, pixels
    over the pair.
    """
    work = _Work.of(pair, places)
    compare(*pair.pictures, pair.back, np.empty((1, work.area), np.uint16), work.boxes,
            np.stack(flows)[:, None, None], True, WHOLE, work.motions, *_limits(noise_gray, threshold_sigma), 0, 1,
            *work.scratch(), work.starts, work.foreground, work.gain)
    return work.tests(pair.mask)


@dataclass(frozen=True)
class _Work:
    """What kernels fill for several places. ``boxes``: (n, 5) with the reach; ``width``, ``height``, ``area``: of the
    largest with what it reaches to and one pixel beside that; ``pixels``: of the largest.
    """

    boxes: npt.NDArray[np.int64]
    motions: FloatArray
    starts: npt.NDArray[np.int64]
    foreground: BoolArray
    gain: FloatArray
    width: int
    height: int
    area: int
    pixels: int

    @classmethod
    def of(cls, pair: ImagePair, places: Sequence[Place]) -> _Work:
        """Empty. places: at least one."""
        boxes = np.array([(*each.region.edges, each.reach) for each in places])
        sides = boxes[:, 2:4] - boxes[:, :2]
        pixels = sides.prod(axis=1)
        starts = np.concatenate([[0], np.cumsum(pixels)])
        reached = np.minimum(sides + 2 * (boxes[:, 4:] + BESIDE_PX), pair.current.shape[::-1])
        width, height = reached.max(axis=0).tolist()
        return cls(boxes, np.stack([each.motion for each in places]), starts, np.zeros(starts[-1], np.bool_),
                   np.empty(starts[-1], np.float32), width, height, int(reached.prod(axis=1).max()), int(pixels.max()))

    def scratch(self) -> tuple[npt.NDArray[Any], ...]:
        """What each thread of ``compare`` needs for itself."""
        wide = self.width + 2 * BESIDE_PX
        return (np.empty((2, wide), np.uint32), np.empty((4, wide), np.uint8), np.empty((9, wide), np.float32),
                np.empty(wide, np.int32), np.empty(self.area, np.uint16),
                np.empty((self.height + 2 * BESIDE_PX, 2), np.int64), np.empty((self.pixels, 4), np.int32),
                np.empty(self.area, np.bool_))

    def tests(self, mask: BoolArray | None) -> PhotometricTests:
        """As they are now. mask: (H, W), False = not the scene."""
        tests = PhotometricTests(self.boxes[:, :4], self.starts, self.foreground, self.gain)
        if mask is not None:
            for n, (left, top, right, bottom) in enumerate(tests.boxes.tolist()):
                pixels = tests[n].foreground
                pixels &= mask[top:bottom, left:right]
        return tests


def _limits(noise_gray: float, threshold_sigma: float) -> tuple[np.float32, np.float32, np.float32]:
    """Variance of the noise, mean error from which an image changed, least gain."""
    return (np.float32(noise_gray ** 2), np.float32((noise_gray * threshold_sigma) ** 2),
            np.float32(threshold_sigma ** 2))


def reach_px(object_motion: FloatArray) -> int:
    """Largest distance of an object's pixels from their origins, with the slack of the test.

    object_motion: (2,) pixels over the pair, against the background.
    """
    return math.ceil(float(np.hypot(object_motion[0], object_motion[1]))) + SLACK_PX
