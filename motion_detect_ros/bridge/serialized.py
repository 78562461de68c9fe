"""Messages by name and as bytes: what replaying a bag needs."""

from __future__ import annotations

import struct
from importlib import import_module
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.type_support import check_is_valid_msg_type

from motion_detect_ros.bridge.qos import image_qos, imu_qos, latched_qos, record_qos
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.sources.raw import TopicInfo

#: Types whose first field is a std_msgs/Header: its stamp stands at byte 4 of the serialised message.
IMAGE_TYPES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')
IMU_TYPE = 'sensor_msgs/msg/Imu'
#: Published once and kept for late subscribers.
STATIC_TRANSFORMS = 'tf_static'


def message_class(name: str) -> Any:
    """The Python class of ``package/msg/Type``. Raises: MessageError where it is not installed."""
    package, _, kind = name.partition('/')
    try:
        found = getattr(import_module(f'{package}.msg'), kind.rpartition('/')[2])
        check_is_valid_msg_type(found)
        return found
    except Exception:  # no name at all, no message, a package that does not load
        raise MessageError(f'message type {name}: expected an installed package, found none') from None


def header_stamp_ns(data: bytes) -> int:
    """Stamp of a serialised (CDR) message that begins with a Header, nanoseconds.

    Raises: MessageError for fewer bytes than a stamp takes.
    """
    if len(data) < 12:
        raise MessageError(f'serialised message: expected at least 12 bytes, got {len(data)}')
    order = '<' if data[1] & 1 else '>'
    seconds, nanoseconds = struct.unpack_from(f'{order}iI', data, 4)
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def is_static(topic: str) -> bool:
    """Whether its messages hold from then on, for those who come late too."""
    return topic.rpartition('/')[2] == STATIC_TRANSFORMS


def quality_of(topic: TopicInfo) -> QoSProfile:
    """What a player offers for a recorded topic."""
    if is_static(topic.name):
        return latched_qos()
    if topic.msgtype == IMU_TYPE:
        return imu_qos()
    return image_qos() if topic.msgtype in IMAGE_TYPES else record_qos()
