"""False boxes over flights in which nothing moves: houses, trees and parked cars under a restless camera.

    python -m motion_detect_ros.benchmarks.silence [--seeds N] [--frames N] [--preset NAME ...] [--set NAME=VALUE ...]
        [--jobs N] [--write docs/accuracy.md]

The camera shakes and zooms more than in the default flight, the exposure jumps every two seconds, rain falls. Prints
boxes in 100 frames for each preset and seed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from motion_detect_ros.benchmarks.accuracy import add_settings, read_changes
from motion_detect_ros.benchmarks.accuracy_clips import in_processes
from motion_detect_ros.benchmarks.command import reports_errors
from motion_detect_ros.benchmarks.generated import show
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import ByteArray, RecordArray
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.frames import SourceFrame
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

SECTION = 'silence'
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
    """One flight, and the preset and settings (dotted names) it is detected with."""

    preset: str
    changes: Mapping[str, Any]
    seed: int
    frames: int = FRAMES
    width: int = WIDTH_PX
    height: int = HEIGHT_PX
    cars: int = 0
    people: int = 0

    def pictures(self) -> Iterator[SourceFrame]:
        """Rendered one after the other, exposure and rain included."""
        for frame, _ in self.judged():
            yield frame

    def judged(self) -> Iterator[tuple[SourceFrame, RecordArray]]:
        """The same, each with its truth."""
        flight = SyntheticFlight(FlightConfig(
            width=self.width, height=self.height, focal_px=0.75 * self.width, frames=self.frames, seed=self.seed,
            cars=self.cars, people=self.people, shake_deg=SHAKE_DEG, zoom_share=ZOOM_SHARE))
        random = np.random.default_rng([self.seed, 11])
        gain = 1.0
        for frame in flight:
            if frame.index % JUMP_EVERY == 0:
                gain = 1.0 + random.uniform(-JUMP_SHARE, JUMP_SHARE)
            image = cv2.convertScaleAbs(frame.image, alpha=gain)
            yield SourceFrame(frame.index, _rained_on(image, random), frame.stamp_ns), frame.truth

    def boxes(self) -> int:
        """How many boxes the detector reports; every one is false where nothing moves."""
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


@reports_errors
def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 for wrong settings."""
    parser = argparse.ArgumentParser(prog='silence', description='False boxes over flights in which nothing moves.')
    parser.add_argument('--seeds', type=int, default=SEEDS, metavar='N', help=f'flights a preset (default: {SEEDS})')
    parser.add_argument('--frames', type=int, default=FRAMES, metavar='N', help=f'of each flight (default: {FRAMES})')
    parser.add_argument('--preset', nargs='+', default=list(PRESETS), metavar='NAME', help='presets to fly with')
    add_settings(parser)
    parser.add_argument('--jobs', type=int, default=2, metavar='N', help='processes (default: 2)')
    parser.add_argument('--write', type=Path, metavar='FILE', help='put the table into this document, too')
    options = parser.parse_args(arguments)
    changes = read_changes(options.set)
    flights = [Flight(preset, changes, seed, options.frames)
               for preset in options.preset for seed in range(1, options.seeds + 1)]
    counts = in_processes(Flight.boxes, flights, options.jobs)
    lines = ['| preset | seed | boxes in 100 frames |', '|---|---|---|',
             *(f'| {flight.preset} | {flight.seed} | {100.0 * count / flight.frames:.1f} |'
               for flight, count in zip(flights, counts, strict=True))]
    show(lines, options.write, SECTION)
    return 0


if __name__ == '__main__':
    sys.exit(main())
