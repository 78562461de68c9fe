"""All real clips through the detector, scored against their truth: the table of docs/accuracy.md.

    python -m motion_detect_ros.tools.accuracy [CLIP ...] [--data DIR] [--set NAME=VALUE ...]

``--data`` (default: the variable MOTION_DETECT_DATA) holds ``clips.json``: for each clip the folder of frames, the
truth file, the frame rate and the preset of its family.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from tqdm import tqdm

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import MotionDetectError, SourceError
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.core.types import DoubleArray
from motion_detect_ros.presets import load_preset
from motion_detect_ros.sources.frames import open_source
from motion_detect_ros.sources.truth import read_truth
from motion_detect_ros.tools.metrics import Score, score_boxes

DATA_VARIABLE = 'MOTION_DETECT_DATA'
IOUS = (0.3, 0.5)
#: Frames at the start that are not counted; on clips shorter than SHORT_FRAMES only the second number.
WARM_UP_FRAMES, SHORT_WARM_UP_FRAMES, SHORT_FRAMES = 10, 2, 30


@dataclass(frozen=True)
class Clip:
    """One entry of clips.json."""

    name: str
    frames: Path
    truth: Path
    fps: float
    preset: str


@dataclass(frozen=True)
class ClipResult:
    """``scores``: one for each IoU of ``IOUS``; ``frame_ms``: median compute time."""

    clip: Clip
    scores: tuple[Score, ...]
    frame_ms: float


def read_clips(data: Path) -> list[Clip]:
    """Raises: SourceError where ``clips.json`` is missing."""
    index = data / 'clips.json'
    if not index.is_file():
        raise SourceError(f'{data}: expected a folder with clips.json; set {DATA_VARIABLE} or --data')
    entries = json.loads(index.read_text(encoding='utf-8'))
    return [Clip(name, data / entry['frames'], data / entry['gt'], float(entry['fps']), entry['preset'])
            for name, entry in entries.items()]


def run_clip(clip: Clip, config: PipelineConfig) -> ClipResult:
    """Every frame of a clip through a fresh pipeline, scored for moving objects."""
    source = open_source(str(clip.frames), clip.fps)
    pipeline, boxes, times = MotionPipeline(config, source.camera), dict[int, DoubleArray](), []
    for frame in tqdm(source, total=source.frame_count, desc=clip.name, unit='frame', disable=None):
        result = pipeline.process(frame.image, frame.stamp_ns)
        r = result.detections
        boxes[frame.index] = np.column_stack([
            r['u'] - r['width'] / 2, r['v'] - r['height'] / 2, r['width'], r['height']]).astype(np.float64)
        times.append(result.times_ms.total)
    skip = WARM_UP_FRAMES if len(times) >= SHORT_FRAMES else SHORT_WARM_UP_FRAMES
    truth = read_truth(clip.truth)
    return ClipResult(clip, tuple(score_boxes(truth, boxes, iou, skip=skip) for iou in IOUS), float(np.median(times)))


def table(results: Sequence[ClipResult]) -> list[str]:
    """Markdown, a row a clip and the means."""
    lines = ['| clip | F1 at 0.3 | F1 at 0.5 | precision | recall | false boxes a frame | ms a frame |',
             '|---|---|---|---|---|---|---|']
    rows = [(*(score.f1 for score in result.scores), result.scores[0].precision, result.scores[0].recall,
             result.scores[0].false_per_frame, result.frame_ms) for result in results]
    names = [f'`{result.clip.name}`' for result in results]
    for name, row in zip([*names, f'mean of {len(rows)}'], [*rows, tuple(np.mean(rows, axis=0))], strict=True):
        lines.append(f'| {name} | ' + ' | '.join(f'{value:.2f}' for value in row[:5]) + f' | {row[5]:.0f} |')
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit code 2 where clips or settings are wrong."""
    parser = argparse.ArgumentParser(prog='accuracy', description='All real clips, scored.')
    parser.add_argument('clips', nargs='*', help='names of clips (default: all)')
    parser.add_argument('--data', type=Path, default=Path(os.environ.get(DATA_VARIABLE, '../shared/data')))
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE', help='settings on top of the presets')
    options = parser.parse_args(arguments)
    try:
        changes = {name: yaml.safe_load(value) for name, _, value in (text.partition('=') for text in options.set)}
        clips = [clip for clip in read_clips(options.data) if not options.clips or clip.name in options.clips]
        if not clips:
            raise SourceError(f'clips: expected some of {", ".join(clip.name for clip in read_clips(options.data))}')
        results = [run_clip(clip, with_settings(load_preset(clip.preset), changes)) for clip in clips]
    except MotionDetectError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    print('\n'.join(table(results)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
