"""Detections as rays and boxes in the optical frame, for RViz and Foxglove."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Vector3
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from motion_detect_ros.core.drawing import color_of, label_of
from motion_detect_ros.core.geometry.bearings import PIXEL_CENTRE
from motion_detect_ros.core.geometry.distortion import undistorted
from motion_detect_ros.core.types import CameraModel, RecordArray
from motion_detect_ros.sources.camera_info import camera_of

RAYS, LABELS, BOXES = 'bearing', 'label', 'box'
#: A camera tells directions, not distances: rays end at this length, metres.
LENGTH_M = 1.0
#: Shaft diameter, head diameter, head length; height of the text; how far behind the tip it stands, metres.
ARROW_M = (0.015, 0.04, 0.08)
TEXT_M = 0.06
TEXT_AT_M = 1.08
#: Width of the lines of a box, share of its distance.
LINE_SHARE = 0.003
#: A marker that nobody renews or deletes vanishes after this, seconds.
LIFETIME_S = 2
#: Marker ids are int32.
ID_MASK = 0x7FFFFFFF


class MarkerWriter:
    """Remembers which objects are shown, so that those that vanish are deleted.

    box_distance_m: where boxes are drawn besides, as a camera tells no distance; 0 = no boxes. rectified: as for
    ``camera_of``.
    """

    def __init__(self, box_distance_m: float = 0.0, rectified: bool = False) -> None:
        self._shown: frozenset[int] = frozenset()
        self._camera: CameraModel | None = None
        self._box_distance_m, self._rectified = box_distance_m, rectified

    def use_camera(self, info: CameraInfo) -> None:
        """The calibration of the images, which boxes need."""
        self._camera = camera_of(info, self._rectified)

    def message(self, records: RecordArray, header: Header) -> MarkerArray:
        """An arrow along the bearing, a label and a box for every object; on the label stand the last digits of the id,
        and the time to contact where known.

        records: dtype ``DETECTION_DTYPE``; those without a bearing (uncalibrated camera) are left out. header: of the
        image they were seen in; the rays start at the origin of its frame, which is the optical one.
        """
        seen = [record for record in records if np.isfinite(_ray(record)).all()]
        ids = frozenset(_id(record) for record in seen)
        markers = [marker for record in seen for marker in (
            _arrow(record, header), _label(record, header), *self._boxes(record, header))]
        for gone in sorted(self._shown - ids):
            markers += [Marker(header=header, ns=name, id=gone, action=Marker.DELETE) for name in self._names()]
        self._shown = ids
        return MarkerArray(markers=markers)

    def _names(self) -> tuple[str, ...]:
        return (RAYS, LABELS, BOXES) if self._box_distance_m else (RAYS, LABELS)

    def _boxes(self, record: Any, header: Header) -> list[Marker]:
        if self._camera is None or not self._box_distance_m:
            return []
        return _box(record, header, self._camera, self._box_distance_m)

    def clear(self) -> None:
        """Nobody holds any marker."""
        self._shown = frozenset()


def _id(record: Any) -> int:
    return int(record['id']) & ID_MASK


def _ray(record: Any) -> tuple[float, float, float]:
    return float(record['bearing_x']), float(record['bearing_y']), float(record['bearing_z'])


def _at(record: Any, length_m: float) -> Point:
    x, y, z = _ray(record)
    return Point(x=x * length_m, y=y * length_m, z=z * length_m)


def _color(record: Any) -> ColorRGBA:
    blue, green, red = (value / 255.0 for value in color_of(int(record['id'])))
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


def _arrow(record: Any, header: Header) -> Marker:
    shaft, head, length = ARROW_M
    return Marker(header=header, ns=RAYS, id=_id(record), type=Marker.ARROW, action=Marker.ADD, color=_color(record),
                  scale=Vector3(x=shaft, y=head, z=length), points=[Point(), _at(record, LENGTH_M)],
                  lifetime=Duration(sec=LIFETIME_S))


def _box(record: Any, header: Header, camera: CameraModel, distance_m: float) -> list[Marker]:
    """The outline of the box on a plane across the optical axis; none where the lens has no ray for a corner."""
    right, down = record['width'] / 2.0, record['height'] / 2.0
    corners = [(record['u'] + x * right - PIXEL_CENTRE, record['v'] + y * down - PIXEL_CENTRE)
               for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    plane = undistorted(np.array(corners), camera)
    if not np.isfinite(plane).all():
        return []
    points = [Point(x=float(x) * distance_m, y=float(y) * distance_m, z=distance_m) for x, y in plane]
    return [Marker(header=header, ns=BOXES, id=_id(record), type=Marker.LINE_STRIP, action=Marker.ADD,
                   color=_color(record), scale=Vector3(x=LINE_SHARE * distance_m), points=points,
                   lifetime=Duration(sec=LIFETIME_S))]


def _label(record: Any, header: Header) -> Marker:
    ttc_s = float(record['ttc'])
    text = label_of(int(record['id'])) + (f': {ttc_s:.1f} s' if math.isfinite(ttc_s) else '')
    marker = Marker(header=header, ns=LABELS, id=_id(record), type=Marker.TEXT_VIEW_FACING, action=Marker.ADD,
                    color=_color(record), scale=Vector3(z=TEXT_M), text=text, lifetime=Duration(sec=LIFETIME_S))
    marker.pose.position = _at(record, TEXT_AT_M)
    return marker
