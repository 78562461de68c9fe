"""Publishers for the topics of a bag."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation

from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.serialized import IMAGE_TYPES, message_class, quality_of
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.sources.raw import CDR, LOST, RawMessage, TopicInfo, one_line, printable

#: What ROS takes as it is; in other names it replaces ~ and {}, or ends at a character 0.
_NAME = re.compile(r'/*[A-Za-z_]\w*(/[A-Za-z_]\w*)*', re.ASCII)


def is_name(topic: str) -> bool:
    """Whether ROS takes the name of a recorded topic as it is."""
    return _NAME.fullmatch(topic) is not None


class BagPublishers:
    """One for each topic in CDR whose type is installed; what cannot be published costs itself only.

    Topics that are left out are named in one warning.
    """

    def __init__(self, node: ManagedNode, topics: Iterable[TopicInfo]) -> None:
        """Topics of two types, as MCAP allows them and ROS does not, are published with the first one."""
        self._node = node
        self._publishers: dict[str, Any] = {}
        self._played: dict[str, TopicInfo] = {}
        faults: list[str] = []
        for topic in topics:
            try:
                self._add(topic)
            except MessageError as error:
                faults.append(printable(f'topic {topic.name}: {error}'))
        if faults:
            node.bad_input(MessageError('; '.join(faults)))

    @property
    def topics(self) -> list[str]:
        """The names that are published."""
        return list(self._publishers)

    @property
    def images(self) -> list[Any]:
        """The publishers of images."""
        return [each for name, each in self._publishers.items() if self._played[name].msgtype in IMAGE_TYPES]

    def takes(self, message: RawMessage) -> bool:
        """Whether it is of the type that its topic is published with."""
        topic = self._played.get(message.topic)
        return topic is not None and topic.holds(message)

    def publish(self, message: RawMessage) -> None:
        """The bytes as they are. Raises: MessageError where they are lost, or DDS refuses them."""
        if message.data == LOST:
            raise MessageError(f'{message.topic}: left out: a message that cannot be read as {message.msgtype}')
        try:
            self._publishers[message.topic].publish(message.data)
        except rclpy_implementation.RCLError as error:
            if not self._node.context.ok():
                raise
            raise MessageError(f'{message.topic}: left out: a message of {len(message.data)} bytes that is refused as '
                               f'{message.msgtype}: {one_line(error)}') from None

    def _add(self, topic: TopicInfo) -> None:
        """Raises: MessageError where it cannot be published."""
        if topic.encoding != CDR:
            raise MessageError(f'expected messages in {CDR}, got {topic.encoding}')
        if topic.name in self._played:
            raise MessageError(f'expected one type, got {self._played[topic.name].msgtype} and {topic.msgtype}; '
                               'the first is played')
        if not is_name(topic.name):
            raise MessageError('expected a name of letters, digits and _, its parts joined by /')
        try:
            self._publishers[topic.name] = self._node.advertise(
                message_class(topic.msgtype), topic.name.lstrip('/'), quality_of(topic))
        except InvalidTopicNameException as error:  # too long
            raise MessageError(str(error).splitlines()[0]) from None
        except rclpy_implementation.RCLError as error:  # the node has a topic of this name with another type
            raise MessageError(one_line(error)) from None
        self._played[topic.name] = topic
