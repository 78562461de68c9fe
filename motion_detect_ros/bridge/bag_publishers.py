"""Publishers for the topics of a bag."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.exceptions import InvalidTopicNameException

from motion_detect_ros.bridge.managed_node import ManagedNode
from motion_detect_ros.bridge.serialized import IMAGE_TYPES, message_class, quality_of
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.sources.raw import LOST, RawMessage, TopicInfo


class BagPublishers:
    """One for each topic whose type is installed; what cannot be published is named, and costs itself only."""

    def __init__(self, node: ManagedNode, topics: Iterable[TopicInfo]) -> None:
        """Topics of two types, as MCAP allows them and ROS does not, are published with the first one."""
        self._publishers: dict[str, Any] = {}
        self._types: dict[str, str] = {}
        for topic in topics:
            try:
                self._add(node, topic)
            except MessageError as error:
                node.bad_input(error)

    @property
    def topics(self) -> list[str]:
        """The names that are published."""
        return list(self._publishers)

    @property
    def images(self) -> list[Any]:
        """The publishers of images."""
        return [each for name, each in self._publishers.items() if self._types[name] in IMAGE_TYPES]

    def takes(self, message: RawMessage) -> bool:
        """Whether it is of the type that its topic is published with."""
        return self._types.get(message.topic) == message.msgtype

    def fault_of(self, message: RawMessage) -> str:
        """Why it cannot be published, empty where it can."""
        if message.data != LOST:
            return ''
        return f'{message.topic}: left out: a message that cannot be read as {message.msgtype}'

    def publish(self, message: RawMessage) -> None:
        """The bytes as they are."""
        self._publishers[message.topic].publish(message.data)

    def _add(self, node: ManagedNode, topic: TopicInfo) -> None:
        """Raises: MessageError where it cannot be published."""
        first = self._types.get(topic.name)
        if first is not None:
            raise MessageError(f'topic {topic.name}: expected one type, got {first} and {topic.msgtype}; '
                               'the first is played')
        try:
            self._publishers[topic.name] = node.advertise(
                message_class(topic.msgtype), topic.name.lstrip('/'), quality_of(topic))
        except InvalidTopicNameException as error:  # MCAP files of other tools
            raise MessageError(f'topic {topic.name}: {error}'.splitlines()[0]) from None
        self._types[topic.name] = topic.msgtype
