"""The part of ``selftest`` that needs ROS: transport, and the rate at which a camera's images arrive."""

from __future__ import annotations

import os
import time

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.validate_topic_name import validate_topic_name

from motion_detect_ros.bridge.console import ImageLog
from motion_detect_ros.bridge.gaps import GapWatch
from motion_detect_ros.bridge.image_stream import LOST_SHARE
from motion_detect_ros.bridge.images import stamp_ns
from motion_detect_ros.bridge.qos import image_qos
from motion_detect_ros.bridge.topics import COMPRESSED, IMAGE, NO_CAMERA
from motion_detect_ros.bridge.transport import PROFILE_VARIABLE, profile_set
from motion_detect_ros.core.errors import ConfigError

#: Stamps older than this are of another clock, seconds.
MAX_AGE_S = 10.0


def profile() -> tuple[str, bool, str, str]:
    """Whether processes that are started from here get the shared-memory profile."""
    file = os.environ.get(PROFILE_VARIABLE, '')
    there = profile_set() and os.path.isfile(file)  # noqa: PTH113 it may hold several
    return 'transport', there, f'{PROFILE_VARIABLE}={file or "(not set)"}', \
        'export it for the nodes and for the camera driver (README, Transport)'


def checked(topic: str) -> None:
    """Raises: ConfigError for what is no name of a topic."""
    try:
        validate_topic_name(topic)
    except InvalidTopicNameException as error:
        reason = str(error).partition(': ')[2].partition(':\n')[0]
        raise ConfigError(f'--topic: expected a topic, such as /image_raw, got {topic!r}: {reason}') from None


def listen(topic: str, best_effort: bool, seconds: float) -> tuple[bool, str, str]:
    """Images of ``topic`` for so long: whether they come, are stamped by a clock like ours, and few are lost."""
    kind = COMPRESSED.kind if topic.endswith('/compressed') else IMAGE.kind
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node('selftest', context=context)
    executor, gaps, ages_s = SingleThreadedExecutor(context=context), GapWatch(), list[float]()

    def on_image(msg: object) -> None:
        stamp = stamp_ns(msg.header)  # type: ignore[attr-defined]
        gaps.add(stamp)
        ages_s.append(time.time() - stamp * 1e-9)

    node.create_subscription(kind, topic, on_image, image_qos('best_effort' if best_effort else 'reliable', 5))
    executor.add_node(node)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    types = [info.topic_type for info in node.get_publishers_info_by_topic(topic)]
    publishers = types.count(f'sensor_msgs/msg/{kind.__name__}')
    elsewhere = ImageLog(node, topic, [each.name for each in NO_CAMERA]).elsewhere()
    node.destroy_node()
    rclpy.try_shutdown(context=context)
    passed, found, cure = judged(publishers, ages_s, gaps, seconds, elsewhere)
    if types and not publishers:
        found += f', {topic} is of type {types[0]}'
    return passed, found, cure


def judged(
    publishers: int, ages_s: list[float], gaps: GapWatch, seconds: float, elsewhere: str = '',
) -> tuple[bool, str, str]:
    """What the images say. ages_s: of their stamps on arrival; elsewhere: which other topics have images."""
    if not ages_s:
        return False, f'no images from {publishers} publishers', (
            f'start the driver; {elsewhere}' if not publishers else
            'try --best-effort (the nodes find out by themselves)')
    losses = gaps.losses()
    lost = losses.share if losses else 0.0
    found = f'{len(ages_s) / seconds:.1f} Hz, {lost:.0%} lost on the way, stamps {ages_s[-1]:.2f} s old'
    if lost > LOST_SHARE:
        return False, found, 'the Fast DDS profile is needed on both sides (README, Transport), or compressed images'
    return abs(ages_s[-1]) <= MAX_AGE_S, found, 'the driver must stamp with the clock of this machine'
