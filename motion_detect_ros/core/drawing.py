"""Visualisation: boxes on the image, flow as colour."""

from __future__ import annotations

import colorsys

import cv2
import numpy as np

from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray, RecordArray

#: So many last digits of an id are shown.
LABEL_DIGITS = 5
#: Hue step between consecutive ids; the golden ratio keeps any few neighbours apart.
HUE_STEP = 0.618033988749895
#: Arrows show the displacement in this time, seconds.
ARROW_S = 0.5
#: Coordinates are cut here before they are drawn, pixels.
FAR_PX = 30_000.0
UNKNOWN_FLOW_BGR = (60, 60, 60)


def color_of(identity: int) -> tuple[int, int, int]:
    """BGR colour of a track, the same in every frame."""
    red, green, blue = colorsys.hsv_to_rgb(identity * HUE_STEP % 1.0, 0.85, 1.0)
    return round(255 * blue), round(255 * green), round(255 * red)


def label_of(identity: int) -> str:
    """How people get an id shown, in pictures and markers: its last digits, as ids of the nodes are long."""
    return str(identity)[-LABEL_DIGITS:]


def draw_detections(image: ByteArray, records: RecordArray) -> ByteArray:
    """A BGR copy of ``image`` (H, W[, 3]) with box, id and velocity arrow of every detection.

    image: uint8; records: dtype ``DETECTION_DTYPE``, pixels of ``image``. A record whose box is not finite is left out,
    an arrow whose velocity is not finite too.
    """
    canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    thickness = line_px(canvas.shape[1])
    for record in records:
        if all(np.isfinite(record[name]) for name in ('u', 'v', 'width', 'height')):
            _draw_one(canvas, record, thickness)
    return canvas


def line_px(width: int) -> int:
    """Thickness of lines on a picture of this width, pixels."""
    return max(1, round(width / 640))


def draw_boxes(
    image: ByteArray, boxes: FloatArray | DoubleArray, color: tuple[int, int, int], thickness_px: int = 1,
) -> None:
    """Rectangles into a BGR image. boxes: (N, 4) x, y, w, h, pixels."""
    for x, y, w, h in np.asarray(boxes, np.float64).reshape(-1, 4):
        cv2.rectangle(image, _pixel(x, y), _pixel(x + w, y + h), color, thickness_px)


def flow_to_color(flow: FloatArray, full_px: float | None = None) -> ByteArray:
    """(gh, gw, 3) BGR: hue = direction, brightness = length, grey = unknown.

    flow: (gh, gw, 2) pixels; full_px: length shown at full brightness, by default the 98th percentile.
    """
    known = np.isfinite(flow[..., 0])
    x, y = np.where(known, flow[..., 0], 0.0), np.where(known, flow[..., 1], 0.0)
    length, degrees = cv2.cartToPolar(x.astype(np.float32), y.astype(np.float32), angleInDegrees=True)
    if full_px is None:
        full_px = float(np.percentile(length[known], 98)) if known.any() else 1.0
    value = np.clip(255.0 * length / max(full_px, 1e-6), 0, 255)
    hsv = np.stack([degrees / 2.0, np.full_like(value, 255.0), value], axis=-1).astype(np.uint8)
    color = cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)
    color[~known] = UNKNOWN_FLOW_BGR
    return color


def _pixel(x: float, y: float) -> tuple[int, int]:
    """Rounded, and near enough to the image for OpenCV's 32-bit coordinates."""
    return round(min(max(x, -FAR_PX), FAR_PX)), round(min(max(y, -FAR_PX), FAR_PX))


def _draw_one(canvas: ByteArray, record: np.void, thickness: int) -> None:
    u, v = float(record['u']), float(record['v'])
    half_w, half_h = float(record['width']) / 2, float(record['height']) / 2
    color = color_of(int(record['id']))
    left_top = _pixel(u - half_w, v - half_h)
    cv2.rectangle(canvas, left_top, _pixel(u + half_w, v + half_h), color, thickness)
    ahead_u, ahead_v = ARROW_S * float(record['vel_u']), ARROW_S * float(record['vel_v'])
    if np.isfinite(ahead_u) and np.isfinite(ahead_v):
        tip = _pixel(u + ahead_u, v + ahead_v)
        cv2.arrowedLine(canvas, _pixel(u, v), tip, color, thickness, cv2.LINE_AA, tipLength=0.25)
    cv2.putText(canvas, label_of(int(record['id'])), (left_top[0], left_top[1] - 3), cv2.FONT_HERSHEY_SIMPLEX,
                0.4 * thickness, color, thickness, cv2.LINE_AA)
