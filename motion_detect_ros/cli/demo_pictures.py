"""Pictures of the demo: a video and a contact sheet, detections over the truth."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from motion_detect_ros.cli.contact_sheet import Tile, contact_sheet, spread_over
from motion_detect_ros.cli.demo_table import Run
from motion_detect_ros.cli.progress import track
from motion_detect_ros.cli.video import VideoWriter
from motion_detect_ros.core.drawing import draw_boxes, draw_detections
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.types import ByteArray, DoubleArray, RecordArray, empty_detections
from motion_detect_ros.results.metrics import boxes_of, match
from motion_detect_ros.sources.bags import BagFrames

TILES, TILE_IOU = 12, 0.3
TRUTH_BGR = (255, 255, 255)
LEGEND = 'white: moves in truth   colour: found, with id and the way it goes in 0.5 s'
_LEGEND_BGR, _SHADOW_BGR = (255, 255, 255), (0, 0, 0)


def write_pictures(bag: Path, truth: RecordArray, run: Run, fps: float, video: Path, sheet: Path) -> None:
    """Draw every image of ``bag`` with its detections, all into ``video`` and a few into ``sheet``.

    truth: ``TRUTH_DTYPE``, frames counted as the images of the bag. Raises: BackendError where a file cannot be
    written.
    """
    frames, tiles = BagFrames(bag), []
    chosen = {run.wanted[place] for place in spread_over(len(run.wanted), TILES)}
    with VideoWriter(video, fps) as movie:
        for frame in track(frames, frames.frame_count, 'draw'):
            moving = truth[(truth['frame'] == frame.index) & (truth['moving'] == 1)]
            records = run.records.get(frame.index)
            picture = annotate(frame.image, empty_detections() if records is None else records, moving)
            movie.write(picture)
            if frame.index in chosen:
                tiles.append(Tile(picture, caption(frame.index, records, moving)))
    if not cv2.imwrite(str(sheet), contact_sheet(tiles)):
        raise BackendError(f'{sheet}: cannot be written')


def annotate(image: ByteArray, records: RecordArray, truth: RecordArray) -> ByteArray:
    """A BGR copy of the image with truth boxes (``TRUTH_DTYPE``) in white under the detections, and a legend."""
    canvas = image.copy()
    draw_boxes(canvas, truth_boxes(truth).astype(np.float32), TRUTH_BGR)
    canvas = draw_detections(canvas, records)
    for color, shift in ((_SHADOW_BGR, 1), (_LEGEND_BGR, 0)):  # a heavier stroke would be a wider text in OpenCV 5
        place = 8 + shift, canvas.shape[0] - 10 + shift
        cv2.putText(canvas, LEGEND, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, color, 1, cv2.LINE_AA)
    return canvas


def caption(frame: int, records: RecordArray | None, truth: RecordArray) -> str:
    """One line about a frame: how many movers were found, how many boxes are on nothing that moves."""
    if records is None:
        return f'frame {frame}: no answer'
    hits = int(match(boxes_of(records), truth_boxes(truth), TILE_IOU).sum())
    return f'frame {frame}: {hits} of {len(truth)} found, {len(records) - hits} false'


def truth_boxes(truth: RecordArray) -> DoubleArray:
    """(N, 4) float64 x, y, width, height of ``TRUTH_DTYPE`` records, pixels."""
    return np.stack([truth[name] for name in ('x', 'y', 'w', 'h')], axis=-1).astype(np.float64)
