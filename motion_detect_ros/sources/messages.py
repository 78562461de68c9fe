"""ROS messages without a ROS installation: rosbags' Jazzy type store builds, writes and reads their CDR bytes."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.core.types import NANOSECONDS, ByteArray, CameraModel, DoubleArray, RecordArray
from motion_detect_ros.sources.box_definitions import DEFINITIONS
from motion_detect_ros.sources.camera_info import distortion_model_of
from motion_detect_ros.sources.raw import CDR

IMAGE = 'sensor_msgs/msg/Image'
COMPRESSED_IMAGE = 'sensor_msgs/msg/CompressedImage'
CAMERA_INFO = 'sensor_msgs/msg/CameraInfo'
IMU = 'sensor_msgs/msg/Imu'
NAV_SAT_FIX = 'sensor_msgs/msg/NavSatFix'
POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'
#: Encoding of the messages of a ROS 1 bag.
ROS1 = 'ros1'

#: What rosbags raises on bytes that are not the message they claim to be.
_DECODE_ERRORS = (SerdeError, struct.error, ValueError, IndexError, TypeError, AssertionError, MemoryError)

#: sensor_msgs/PointField datatype of each numpy type a record may have.
_POINT_FIELD_TYPES = {'i1': 1, 'u1': 2, 'i2': 3, 'u2': 4, 'i4': 5, 'u4': 6, 'f4': 7, 'f8': 8}


@cache
def typestore() -> Typestore:
    """The message definitions of ROS 2 Jazzy, and those of ``vision_msgs`` and Foxglove for boxes."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def make(msgtype: str, **fields: Any) -> Any:
    """A message of ``msgtype``; fields not given are zero or empty.

    The few defaults of ROS that are not zero (a quaternion's w, the status of a NavSatFix) are the caller's to give.
    Raises: MessageError for a field the type does not have.
    """
    values = {name: fields.pop(name) if name in fields else _zero(node)
              for name, node in typestore().fielddefs[msgtype][1]}
    if fields:
        raise MessageError(f'{msgtype} has no field {", ".join(sorted(fields))}')
    return typestore().types[msgtype](**values)


def serialize(message: Any) -> bytes:
    """CDR bytes (little endian) of a message made by ``make`` or ``deserialize``."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))


def deserialize(data: bytes, msgtype: str) -> Any:
    """The message in CDR bytes. Raises: MessageError where they do not hold one of ``msgtype``."""
    try:
        return typestore().deserialize_cdr(data, msgtype)
    except _DECODE_ERRORS as error:
        raise MessageError(f'{len(data)} bytes are no {msgtype}: {error}') from None


def ros1_encoding(msgtype: str) -> str:
    """What ``from_ros1`` makes of messages of a type: ``cdr``, or ``ros1`` where Jazzy does not have the type."""
    return CDR if msgtype in typestore().fielddefs else ROS1


def from_ros1(data: bytes, msgtype: str) -> bytes:
    """CDR bytes of a message as ROS 1 wrote it; ``msgtype`` by its name in ROS 2 (``sensor_msgs/msg/Image``).

    The number that headers had in ROS 1 is dropped. No bytes where they are no such message, which ``deserialize``
    refuses; those of types that Jazzy does not have stay as they are.
    """
    if ros1_encoding(msgtype) == ROS1:
        return bytes(data)
    try:
        return bytes(typestore().ros1_to_cdr(data, msgtype))
    except _DECODE_ERRORS:
        return b''


def message_definition(msgtype: str) -> str:
    """The text of a message type and of all it contains, as MCAP schemas (``ros2msg``) hold it."""
    return typestore().generate_msgdef(msgtype, ros_version=2)[0]


def header(stamp_ns: int, frame_id: str) -> Any:
    """std_msgs/Header; stamp in nanoseconds. Raises: MessageError for one that it cannot hold."""
    seconds, nanoseconds = split_stamp(stamp_ns)
    stamp = make('builtin_interfaces/msg/Time', sec=seconds, nanosec=nanoseconds)
    return make('std_msgs/msg/Header', stamp=stamp, frame_id=frame_id)


def split_stamp(stamp_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds of a time, as builtin_interfaces/Time has them (int32, uint32).

    Raises: MessageError where the seconds do not fit.
    """
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    if not -2 ** 31 <= seconds < 2 ** 31:
        raise MessageError(f'stamp: expected seconds from {-2 ** 31} to {2 ** 31 - 1}, got {seconds}')
    return seconds, nanoseconds


def stamp_of(message: Any) -> int:
    """Header stamp of a message, ns."""
    return int(message.header.stamp.sec) * NANOSECONDS + int(message.header.stamp.nanosec)


def image(pixels: ByteArray, stamp_ns: int, frame_id: str) -> Any:
    """sensor_msgs/Image of (H, W) mono8 or (H, W, 3) bgr8 pixels."""
    height, width = pixels.shape[:2]
    return make(
        IMAGE, header=header(stamp_ns, frame_id), height=height, width=width,
        encoding='mono8' if pixels.ndim == 2 else 'bgr8', step=pixels.nbytes // height,
        data=np.ascontiguousarray(pixels).reshape(-1))


def compressed_image(data: bytes, image_format: str, stamp_ns: int, frame_id: str) -> Any:
    """sensor_msgs/CompressedImage around the bytes of a picture file; image_format: ``jpeg`` or ``png``."""
    return make(
        COMPRESSED_IMAGE, header=header(stamp_ns, frame_id), format=image_format, data=np.frombuffer(data, np.uint8))


def camera_info(
    camera: CameraModel, stamp_ns: int, frame_id: str, projection: DoubleArray | None = None,
) -> Any:
    """sensor_msgs/CameraInfo of an image as the camera gives it.

    projection: (3, 4) float64, where it holds more than the camera matrix (offset to a reference camera).
    A camera with focal length 0 is uncalibrated: the message then says so with K = 0, as its definition asks.
    """
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], np.float64)
    if not camera.fx:
        matrix[:] = 0
    if projection is None:
        projection = np.hstack([matrix, np.zeros((3, 1))])
    return make(
        CAMERA_INFO, header=header(stamp_ns, frame_id), height=camera.height, width=camera.width,
        distortion_model=distortion_model_of(camera), d=np.array(camera.distortion or [0.0] * 5),
        k=matrix.reshape(-1), r=np.eye(3).reshape(-1),
        p=np.asarray(projection, np.float64).reshape(-1))


def point_cloud(records: RecordArray, stamp_ns: int, frame_id: str) -> Any:
    """sensor_msgs/PointCloud2 whose fields are those of a (N,) structured array, in its order and layout."""
    size = records.dtype.itemsize
    return make(
        POINT_CLOUD, header=header(stamp_ns, frame_id), height=1, width=len(records),
        fields=[*_point_fields(records.dtype)],
        point_step=size, row_step=size * len(records), is_dense=True,
        data=np.frombuffer(records.tobytes(), np.uint8))


@cache
def _point_fields(dtype: np.dtype[Any]) -> tuple[Any, ...]:
    return tuple(make('sensor_msgs/msg/PointField', name=name, offset=offset, count=1,
                      datatype=_POINT_FIELD_TYPES[kind.str[1:]]) for name, (kind, offset) in _layout(dtype))


def _layout(dtype: np.dtype[Any]) -> list[tuple[str, tuple[np.dtype[Any], int]]]:
    return [(name, (entry[0], entry[1])) for name, entry in (dtype.fields or {}).items()]


def _zero(node: Any) -> Any:
    """The value a new ROS message has in a field of rosbags' type description ``node``."""
    kind, detail = node
    if kind == Nodetype.NAME:
        return make(detail)
    if kind == Nodetype.BASE:
        return {'string': '', 'bool': False}.get(detail[0], 0.0 if detail[0].startswith('float') else 0)
    (element_kind, element), length = detail
    if element_kind == Nodetype.BASE and element[0] != 'string':
        return np.zeros(length if kind == Nodetype.ARRAY else 0, element[0])
    return [_zero((element_kind, element)) for _ in range(length if kind == Nodetype.ARRAY else 0)]
