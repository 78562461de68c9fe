"""Where the detector fails: the worst frames of a clip on one sheet, every box coloured by what became of it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from motion_detect_ros.benchmarks.accuracy_clips import IOUS, ClipRun
from motion_detect_ros.cli.contact_sheet import Tile, contact_sheet
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.results.error_pictures import caption, draw_verdict, worst_frames
from motion_detect_ros.results.metrics import COUNTINGS, FrameVerdict, judge_frame

#: Frames on a sheet, columns, width of each, pixels.
TILES, COLUMNS, TILE_WIDTH_PX = 6, 2, 960
#: Bad frames come in runs; those chosen are at least this share of the clip apart.
APART_SHARE = 1 / 15


def verdicts(run: ClipRun, counting: str, iou: float = IOUS[0]) -> dict[int, FrameVerdict]:
    """What became of every box of every counted frame; counting: a key of ``COUNTINGS``."""
    truth, boxes = run.clip.read_truth(), run.boxes()
    return {frame: judge_frame(truth[truth['frame'] == frame], boxes.get(frame, np.empty((0, 4))), iou,
                               COUNTINGS[counting])
            for frame in range(run.skip, run.frames)}


def write_sheets(runs: Sequence[ClipRun], folder: Path, counting: str) -> list[Path]:
    """One sheet a clip, ``<clip>.png``; none for a clip without errors. Raises: BackendError where it cannot write."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for run in runs:
        path = folder / f'{run.clip.name}.png'
        if tiles := _tiles(run, counting):
            if not cv2.imwrite(str(path), contact_sheet(tiles, COLUMNS, TILE_WIDTH_PX)):
                raise BackendError(f'{path}: cannot be written')
            written.append(path)
    return written


def _tiles(run: ClipRun, counting: str) -> list[Tile]:
    judged = verdicts(run, counting)
    apart = max(1, round(APART_SHARE * len(judged)))
    chosen = worst_frames({frame: verdict.errors for frame, verdict in judged.items()}, TILES, apart)
    boxes = run.boxes()
    return [Tile(draw_verdict(frame.image, boxes[frame.index], judged[frame.index]),
                 caption(frame.index, judged[frame.index]))
            for frame in islice(run.clip.source(), run.clip.limit) if frame.index in chosen]
