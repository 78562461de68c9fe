"""What the lens and the sensor do to a perfect picture: motion blur, brightness, noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from motion_detect_ros.core.types import ByteArray, FloatArray
from motion_detect_ros.sources.synthetic.compiled import kernel
from motion_detect_ros.sources.synthetic.config import FlightConfig

_EXPOSURE_PERIOD_S = 5.0
_MAX_TAPS = 12


def motion_blur(image: FloatArray, flow: FloatArray, exposure: float) -> FloatArray:
    """Mean of (H, W, 3) float32 along each pixel's own path, ``exposure`` (share of the interval) long, centred.

    Centred, so that a blurred edge stays where the truth says it is. flow: (H, W, 2) float32, pixels per interval.
    """
    if exposure <= 0:
        return image
    return np.asarray(_smear(image, flow, np.float32(exposure)))


def expose(image: FloatArray, config: FlightConfig, index: int) -> ByteArray:
    """Brightness and noise of frame ``index``, then rounding to uint8."""
    phase = 2 * math.pi * (index / config.fps / _EXPOSURE_PERIOD_S + config.seed * 0.37)
    bright = image * np.float32(1 + config.exposure_drift * math.sin(phase))
    if config.noise_sigma > 0:
        rng = np.random.Generator(np.random.SFC64([config.seed, 7, index]))
        bright += np.float32(config.noise_sigma) * rng.standard_normal(bright.shape, dtype=np.float32)
    return np.asarray(np.clip(np.rint(bright), 0, 255), dtype=np.uint8)


@kernel
def _smear(image: Any, flow: Any, exposure: Any) -> Any:
    height, width = flow.shape[:2]
    out = np.zeros_like(image)
    for row in range(height):
        for column in range(width):
            length = exposure * math.sqrt(flow[row, column, 0] ** 2 + flow[row, column, 1] ** 2)
            taps = min(_MAX_TAPS, max(2, math.ceil(length) + 1))  # no more than a pixel apart
            weight = np.float32(1.0 / taps)
            for k in range(taps):
                share = exposure * np.float32(k / (taps - 1) - 0.5)
                x = max(np.float32(column) + share * flow[row, column, 0], np.float32(0))
                y = max(np.float32(row) + share * flow[row, column, 1], np.float32(0))
                left, top = min(int(x), width - 2), min(int(y), height - 2)
                a, b = min(x - np.float32(left), np.float32(1)), min(y - np.float32(top), np.float32(1))
                for c in range(3):
                    upper = image[top, left, c] + a * (image[top, left + 1, c] - image[top, left, c])
                    lower = image[top + 1, left, c] + a * (image[top + 1, left + 1, c] - image[top + 1, left, c])
                    out[row, column, c] += weight * (upper + b * (lower - upper))
    return out
