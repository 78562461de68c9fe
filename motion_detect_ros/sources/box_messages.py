"""Detections as messages that tools of others know: ``vision_msgs/Detection2DArray``, and what Foxglove draws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

from motion_detect_ros.core.drawing import color_of
from motion_detect_ros.core.types import RecordArray
from motion_detect_ros.sources import messages

DETECTION_ARRAY = 'vision_msgs/msg/Detection2DArray'
ANNOTATIONS = 'foxglove_msgs/msg/ImageAnnotations'
#: The only class there is.
MOVING = 'moving'
#: Height of the text beside lines of 1 px.
FONT_PX = 12.0


def detection_array(records: RecordArray, stamp_ns: int, frame_id: str) -> Any:
    """vision_msgs/Detection2DArray of records (``DETECTION_DTYPE``): centre and size in pixels, score, id as text.

    The same content as the topic ``detections_2d`` of the nodes.
    """
    header = messages.header(stamp_ns, frame_id)
    return messages.make(DETECTION_ARRAY, header=header, detections=[
        _detection(each, header) for each in _figures(records, ('score', 'id'))])


def image_annotations(records: RecordArray, stamp_ns: int, thickness: int = 1) -> Any:
    """foxglove_msgs/ImageAnnotations of records (``DETECTION_DTYPE``): a rectangle and an id each, coloured by the id.

    thickness: of the lines, pixels.
    """
    stamp = messages.header(stamp_ns, '').stamp
    drawn = [_rectangle(each, stamp, thickness) for each in _figures(records, ('id',))]
    return messages.make(ANNOTATIONS, points=[rectangle for rectangle, _ in drawn], texts=[text for _, text in drawn])


def _figures(records: RecordArray, names: Sequence[str]) -> Iterator[tuple[Any, ...]]:
    """Of each record its centre and size, pixels, and these fields, as numbers of Python."""
    return zip(*(records[name].tolist() for name in ('u', 'v', 'width', 'height', *names)), strict=True)


def _rectangle(figures: tuple[Any, ...], stamp: Any, thickness: int) -> tuple[Any, Any]:
    """The outline of a box, and the text over its left top corner."""
    u, v, width, height, identity = figures
    types = messages.typestore().types
    point, color_type = types['foxglove_msgs/msg/Point2'], types['foxglove_msgs/msg/Color']
    corners = [point(x=u + x * width / 2, y=v + y * height / 2) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    blue, green, red = (value / 255.0 for value in color_of(identity))
    color, none = color_type(r=red, g=green, b=blue, a=1.0), color_type(r=0.0, g=0.0, b=0.0, a=0.0)
    outline_type: Any = types['foxglove_msgs/msg/PointsAnnotation']
    outline = outline_type(timestamp=stamp, type=outline_type.LINE_LOOP, points=corners, outline_color=color,
                           outline_colors=[], fill_color=none, thickness=float(thickness))
    text = types['foxglove_msgs/msg/TextAnnotation'](
        timestamp=stamp, position=corners[0], text=str(identity), font_size=FONT_PX * thickness, text_color=color,
        background_color=none)
    return outline, text


def _detection(figures: tuple[Any, ...], header: Any) -> Any:
    u, v, width, height, score, identity = figures
    types = messages.typestore().types
    centre = types['vision_msgs/msg/Pose2D'](position=types['vision_msgs/msg/Point2D'](x=u, y=v), theta=0.0)
    box = types['vision_msgs/msg/BoundingBox2D'](center=centre, size_x=width, size_y=height)
    hypothesis = types['vision_msgs/msg/ObjectHypothesis'](class_id=MOVING, score=score)
    result = types['vision_msgs/msg/ObjectHypothesisWithPose'](hypothesis=hypothesis, pose=_no_pose())
    return types['vision_msgs/msg/Detection2D'](header=header, results=[result], bbox=box, id=str(identity))


@cache
def _no_pose() -> Any:
    """Position unknown, as a new message of ROS has it: no rotation, zero covariance."""
    orientation = messages.make('geometry_msgs/msg/Quaternion', w=1.0)
    return messages.make('geometry_msgs/msg/PoseWithCovariance', pose=messages.make(
        'geometry_msgs/msg/Pose', orientation=orientation))
