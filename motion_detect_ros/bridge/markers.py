"""Detections as rays in the optical frame, for RViz and Foxglove."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from motion_detect_ros.core.drawing import color_of
from motion_detect_ros.core.types import RecordArray

RAYS, LABELS = 'bearing', 'label'
#: A camera tells directions, not distances: rays end at this length, metres.
LENGTH_M = 1.0
#: Shaft diameter, head diameter, head length; height of the text; how far behind the tip it stands, metres.
ARROW_M = (0.015, 0.04, 0.08)
TEXT_M = 0.06
TEXT_AT_M = 1.08
#: Marker ids are int32.
ID_MASK = 0x7FFFFFFF


class MarkerWriter:
    """Remembers which objects are shown, so that those that vanish are deleted."""

    def __init__(self) -> None:
        self._shown: frozenset[int] = frozenset()

    def message(self, records: RecordArray, header: Header) -> MarkerArray:
        """An arrow along the bearing and a label (id, time to contact where known) for every object.

        records: dtype ``DETECTION_DTYPE``; those without a bearing (uncalibrated camera) are left out. header: of the
        image they were seen in; the rays start at the origin of its frame, which is the optical one.
        """
        seen = [record for record in records if np.isfinite(_ray(record)).all()]
        ids = frozenset(_id(record) for record in seen)
        markers = [marker for record in seen for marker in (_arrow(record, header), _label(record, header))]
        for gone in sorted(self._shown - ids):
            markers += [Marker(header=header, ns=name, id=gone, action=Marker.DELETE) for name in (RAYS, LABELS)]
        self._shown = ids
        return MarkerArray(markers=markers)

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
                  scale=Vector3(x=shaft, y=head, z=length), points=[Point(), _at(record, LENGTH_M)])


def _label(record: Any, header: Header) -> Marker:
    ttc_s = float(record['ttc'])
    text = f'{int(record["id"])}' + (f': {ttc_s:.1f} s' if math.isfinite(ttc_s) else '')
    marker = Marker(header=header, ns=LABELS, id=_id(record), type=Marker.TEXT_VIEW_FACING, action=Marker.ADD,
                    color=_color(record), scale=Vector3(z=TEXT_M), text=text)
    marker.pose.position = _at(record, TEXT_AT_M)
    return marker
