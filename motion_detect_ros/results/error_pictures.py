"""Where detections go wrong: the frames with most errors, every box coloured by what became of it."""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np

from motion_detect_ros.core.drawing import draw_boxes
from motion_detect_ros.core.types import ByteArray, DoubleArray
from motion_detect_ros.results.metrics import FrameVerdict, boxes_of_truth

FOUND_BGR, MISSED_BGR = (255, 255, 255), (0, 0, 255)
HIT_BGR, FALSE_BGR, IGNORED_BGR = (0, 220, 0), (0, 220, 255), (150, 150, 150)
LEGEND = (('truth, found', FOUND_BGR), ('truth, missed', MISSED_BGR), ('detection, right', HIT_BGR),
          ('detection, false', FALSE_BGR), ('detection, not counted', IGNORED_BGR))
#: Lines are a pixel thick up to this width of the image, two up to twice as much.
LINE_WIDTH_PX = 960
_LEGEND_BGR, _LEGEND_LINE_PX, _LEGEND_TEXT_PX, _LEGEND_SCALE = (32, 32, 32), 20, 185, 0.45


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
    """A BGR copy of the image, (H, W[, 3]) uint8, with truth and detections, (N, 4) x, y, w, h, in the colours of
    ``LEGEND``, which stands in a strip under it.
    """
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    truth = boxes_of_truth(verdict.wanted)
    wrong = ~verdict.hit & ~verdict.ignored
    thick = max(1, round(canvas.shape[1] / LINE_WIDTH_PX))
    for group, color, stroke in (
            (truth[verdict.found], FOUND_BGR, 1), (boxes[verdict.ignored], IGNORED_BGR, 1),
            (boxes[verdict.hit], HIT_BGR, thick), (truth[~verdict.found], MISSED_BGR, thick + 1),
            (boxes[wrong], FALSE_BGR, thick + 1)):
        draw_boxes(canvas, group, color, stroke)
    return cv2.vconcat([canvas, _legend(canvas.shape[1])])


def caption(frame: int, verdict: FrameVerdict) -> str:
    """What happened in a frame, one line."""
    return (f'frame {frame}: {int(verdict.found.sum())} of {len(verdict.wanted)} found, '
            f'{int((~verdict.hit & ~verdict.ignored).sum())} false')


def _legend(width: int) -> ByteArray:
    """(h, width, 3): the texts of ``LEGEND`` beside each other, on as many lines as they need."""
    columns = max(1, width // _LEGEND_TEXT_PX)
    strip = np.full((_LEGEND_LINE_PX * -(-len(LEGEND) // columns), width, 3), _LEGEND_BGR, np.uint8)
    for number, (text, color) in enumerate(LEGEND):
        line, column = divmod(number, columns)
        place = 6 + column * _LEGEND_TEXT_PX, (line + 1) * _LEGEND_LINE_PX - 6
        cv2.putText(strip, text, place, cv2.FONT_HERSHEY_SIMPLEX, _LEGEND_SCALE, color, 1, cv2.LINE_AA)
    return strip
