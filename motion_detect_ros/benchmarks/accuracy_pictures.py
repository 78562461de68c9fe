"""Where the detector fails: the worst frames of a clip on one sheet, every box coloured by what became of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from motion_detect_ros.benchmarks.accuracy_clips import COUNTINGS, IOUS, ClipRun
from motion_detect_ros.cli.contact_sheet import Tile, contact_sheet
from motion_detect_ros.cli.metrics import FrameVerdict, boxes_of_truth, judge_frame
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.types import ByteArray, DoubleArray

#: Frames on a sheet, columns, width of each, pixels.
TILES, COLUMNS, TILE_WIDTH_PX = 6, 2, 960
#: Bad frames come in runs; those chosen are at least this share of the clip apart.
APART_SHARE = 1 / 15
FOUND_BGR, MISSED_BGR = (255, 255, 255), (0, 0, 255)
HIT_BGR, FALSE_BGR, IGNORED_BGR = (0, 220, 0), (0, 220, 255), (150, 150, 150)
LEGEND = (('truth, found', FOUND_BGR), ('truth, missed', MISSED_BGR), ('detection, right', HIT_BGR),
          ('detection, false', FALSE_BGR), ('detection, not counted', IGNORED_BGR))
_FONT, _LEGEND_SCALE, _LEGEND_PITCH_PX, _LEGEND_WIDTH_PX = cv2.FONT_HERSHEY_SIMPLEX, 0.5, 18, 190
#: x, y, w, h @ _CORNERS = left, top, right, bottom.
_CORNERS = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)


def verdicts(run: ClipRun, counting: str, iou: float = IOUS[0]) -> dict[int, FrameVerdict]:
    """What became of every box of every counted frame; counting: a key of ``COUNTINGS``."""
    truth, boxes = run.clip.read_truth(), run.boxes()
    return {frame: judge_frame(truth[truth['frame'] == frame], boxes.get(frame, np.empty((0, 4))), iou,
                               COUNTINGS[counting])
            for frame in range(run.skip, run.frames)}


def worst_frames(errors: Mapping[int, int], wanted: int, apart: int) -> list[int]:
    """At most ``wanted`` frames with most errors (at least one), no two closer than ``apart``, in order of time."""
    chosen: list[int] = []
    for frame in sorted(errors, key=lambda frame: (-errors[frame], frame)):
        if len(chosen) == wanted or not errors[frame]:
            break
        if all(abs(frame - other) >= apart for other in chosen):
            chosen.append(frame)
    return sorted(chosen)


def draw_verdict(image: ByteArray, boxes: DoubleArray, verdict: FrameVerdict) -> ByteArray:
    """A BGR copy of the image with truth and detections, (N, 4) x, y, w, h, in the colours of ``LEGEND``."""
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    truth = boxes_of_truth(verdict.wanted)
    wrong = ~verdict.hit & ~verdict.ignored
    thick = max(1, round(canvas.shape[1] / TILE_WIDTH_PX))
    for group, color, stroke in (
            (truth[verdict.found], FOUND_BGR, 1), (boxes[verdict.ignored], IGNORED_BGR, 1),
            (boxes[verdict.hit], HIT_BGR, thick), (truth[~verdict.found], MISSED_BGR, thick + 1),
            (boxes[wrong], FALSE_BGR, thick + 1)):
        for left, top, right, bottom in np.rint(group @ _CORNERS).astype(int).tolist():
            cv2.rectangle(canvas, (left, top), (right, bottom), color, stroke)
    _draw_legend(canvas)
    return canvas


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
                 _caption(frame.index, judged[frame.index]))
            for frame in islice(run.clip.source(), run.clip.limit) if frame.index in chosen]


def _caption(frame: int, verdict: FrameVerdict) -> str:
    return (f'frame {frame}: {int(verdict.found.sum())} of {len(verdict.wanted)} found, '
            f'{int((~verdict.hit & ~verdict.ignored).sum())} false')


def _draw_legend(canvas: ByteArray) -> None:
    bottom = canvas.shape[0]
    canvas[max(0, bottom - _LEGEND_PITCH_PX * len(LEGEND) - 8):, :_LEGEND_WIDTH_PX] //= 4
    for line, (text, color) in enumerate(LEGEND):
        place = 8, bottom - 8 - _LEGEND_PITCH_PX * (len(LEGEND) - 1 - line)
        cv2.putText(canvas, text, place, _FONT, _LEGEND_SCALE, color, 1, cv2.LINE_AA)
