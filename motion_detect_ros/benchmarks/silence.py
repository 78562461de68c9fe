"""False boxes over flights in which nothing moves: houses, trees and parked cars under a restless camera.

    python -m motion_detect_ros.benchmarks.silence [--seeds N] [--frames N] [--preset NAME ...] [--set NAME=VALUE ...]
        [--size WIDTHxHEIGHT] [--jobs N]

The camera shakes and zooms more than in the default flight, the exposure jumps every two seconds, rain falls. Prints
boxes in 100 frames for each preset and seed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from motion_detect_ros.benchmarks.accuracy import read_changes
from motion_detect_ros.benchmarks.accuracy_clips import in_processes
from motion_detect_ros.core.errors import MotionDetectError
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import ByteArray
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.frames import SourceFrame
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

PRESETS = ('visdrone', 'kitti')
#: Seeds, frames of each flight, and the size of its pictures.
SEEDS, FRAMES, WIDTH_PX, HEIGHT_PX = 3, 300, 960, 540
#: Camera: deviation of the shake, degrees, and amplitude of the zoom, share.
SHAKE_DEG, ZOOM_SHARE = 0.12, 0.08
#: Exposure jumps so often, frames, by up to this share.
JUMP_EVERY, JUMP_SHARE = 40, 0.2
#: Streaks of rain in a frame of 960 x 540, their length and slant, pixels, and how much lighter they are, grey levels.
STREAKS, STREAK_PX, SLANT_PX, STREAK_GRAY = 120, 14, 3, 30


@dataclass(frozen=True)
class Flight:
    """One flight without movers, and the preset and settings (dotted names) it is detected with."""

    preset: str
    changes: Mapping[str, Any]
    seed: int
    frames: int = FRAMES
    width: int = WIDTH_PX
    height: int = HEIGHT_PX

    def pictures(self) -> Iterator[SourceFrame]:
        """Rendered one after the other, exposure and rain included."""
        flight = SyntheticFlight(FlightConfig(
            width=self.width, height=self.height, focal_px=0.75 * self.width, frames=self.frames, seed=self.seed,
            cars=0, people=0, shake_deg=SHAKE_DEG, zoom_share=ZOOM_SHARE))
        random = np.random.default_rng([self.seed, 11])
        gain = 1.0
        for frame in flight:
            if frame.index % JUMP_EVERY == 0:
                gain = 1.0 + random.uniform(-JUMP_SHARE, JUMP_SHARE)
            image = cv2.convertScaleAbs(frame.image, alpha=gain)
            yield SourceFrame(frame.index, _rained_on(image, random), frame.stamp_ns)

    def false_boxes(self) -> int:
        """How many boxes the detector reports; every one is false."""
        pipeline = MotionPipeline(with_settings(load_preset(self.preset), self.changes))
        return sum(len(pipeline.process(frame.image, frame.stamp_ns).detections) for frame in self.pictures())


def _rained_on(image: ByteArray, random: np.random.Generator) -> ByteArray:
    height, width = image.shape[:2]
    rain = np.zeros((height, width), np.uint8)
    streaks = round(STREAKS * width * height / (WIDTH_PX * HEIGHT_PX))
    for x, y in random.integers(0, [width, height], (streaks, 2)).tolist():
        cv2.line(rain, (x, y), (x + SLANT_PX, y + STREAK_PX), STREAK_GRAY, 1, cv2.LINE_AA)
    out: ByteArray = cv2.add(image, cv2.merge([rain] * 3))
    return out


def _count(flight: Flight) -> int:
    return flight.false_boxes()


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog='python -m motion_detect_ros.benchmarks.silence', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seeds', type=int, default=SEEDS)
    parser.add_argument('--frames', type=int, default=FRAMES)
    parser.add_argument('--preset', nargs='+', default=list(PRESETS), metavar='NAME')
    parser.add_argument('--set', action='append', default=[], metavar='NAME=VALUE', help='change a setting')
    parser.add_argument('--jobs', type=int, default=2)
    options = parser.parse_args(arguments)
    try:
        changes = read_changes(options.set)
        flights = [Flight(preset, changes, seed, options.frames)
                   for preset in options.preset for seed in range(1, options.seeds + 1)]
        counts = list(in_processes(_count, flights, options.jobs))
    except MotionDetectError as error:
        print(error, file=sys.stderr)
        return 2
    print('| preset | seed | boxes in 100 frames |\n|---|---|---|')
    for flight, count in zip(flights, counts, strict=True):
        print(f'| {flight.preset} | {flight.seed} | {100.0 * count / flight.frames:.1f} |')
    return 0


if __name__ == '__main__':
    sys.exit(main())
