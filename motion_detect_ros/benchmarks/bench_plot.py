"""A cost curve as a picture: both axes logarithmic, drawn with OpenCV alone."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from motion_detect_ros.benchmarks.bench_curves import Curve
from motion_detect_ros.core.types import ByteArray

WIDTH, HEIGHT = 880, 480
LEFT, RIGHT, TOP, BOTTOM = 80, 30, 50, 60
BLACK, GREY = (30, 30, 30), (215, 215, 215)
#: Of the series in turn, BGR.
COLOURS = ((30, 30, 30), (180, 110, 30), (40, 140, 40), (40, 60, 210), (150, 150, 150))
STEPS = (1, 2, 5)


def draw_curve(curve: Curve, path: Path) -> None:
    """Write ``path`` (PNG). Points without a logarithm (zero objects) are left out. Raises: OSError."""
    points = [point for point in curve.points if point.x > 0.0]
    x = _Axis([point.x for point in points], LEFT, WIDTH - RIGHT)
    y = _Axis([ms for point in points for ms in point.ms.values()], HEIGHT - BOTTOM, TOP)
    picture: ByteArray = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    _frame(picture, x, y, curve.unit)
    for colour, name in zip(COLOURS, curve.slopes, strict=False):
        line = np.array([(x.at(point.x), y.at(point.ms[name])) for point in points], np.int32)
        cv2.polylines(picture, [line], False, colour, 2, cv2.LINE_AA)
        for place in line:
            cv2.circle(picture, (int(place[0]), int(place[1])), 4, colour, -1, cv2.LINE_AA)
    for index, (name, exponent) in enumerate(curve.slopes.items()):
        left = LEFT + index * (WIDTH - LEFT) // len(curve.slopes)
        _text(picture, f'{name} ~ x^{exponent:.2f}', (left, 28), COLOURS[index % len(COLOURS)])
    path.parent.mkdir(parents=True, exist_ok=True)
    done, buffer = cv2.imencode('.png', picture)
    path.write_bytes(buffer.tobytes() if done else b'')


class _Axis:
    """Values to pixels, logarithmic, between the round numbers around the data."""

    def __init__(self, values: list[float], first_px: int, last_px: int) -> None:
        known = [value for value in values if value > 0.0]
        self._low, self._high = math.log(min(known) / 1.15), math.log(max(known) * 1.15)
        self._first, self._last = first_px, last_px

    def at(self, value: float) -> int:
        """Pixel of a value."""
        share = (math.log(max(value, 1e-9)) - self._low) / (self._high - self._low)
        return round(self._first + share * (self._last - self._first))

    def ticks(self) -> list[float]:
        """1, 2 and 5 times powers of ten within the range."""
        low, high = math.exp(self._low), math.exp(self._high)
        powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        return [step * 10.0 ** power for power in powers for step in STEPS if low <= step * 10.0 ** power <= high]


def _frame(picture: ByteArray, x: _Axis, y: _Axis, unit: str) -> None:
    for tick in x.ticks():
        cv2.line(picture, (x.at(tick), TOP), (x.at(tick), HEIGHT - BOTTOM), GREY, 1)
        _text(picture, f'{tick:g}', (x.at(tick) - 12, HEIGHT - BOTTOM + 20), BLACK)
    for tick in y.ticks():
        cv2.line(picture, (LEFT, y.at(tick)), (WIDTH - RIGHT, y.at(tick)), GREY, 1)
        _text(picture, f'{tick:g}', (LEFT - 52, y.at(tick) + 5), BLACK)
    cv2.rectangle(picture, (LEFT, TOP), (WIDTH - RIGHT, HEIGHT - BOTTOM), BLACK, 1)
    _text(picture, unit, (LEFT, HEIGHT - 14), BLACK)
    _text(picture, 'ms', (LEFT - 52, TOP - 6), BLACK)


def _text(picture: ByteArray, words: str, place: tuple[int, int], colour: tuple[int, int, int]) -> None:
    cv2.putText(picture, words, place, cv2.FONT_HERSHEY_SIMPLEX, 0.48, colour, 1, cv2.LINE_AA)
