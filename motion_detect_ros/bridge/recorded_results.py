"""Which topics of a bag are results of this package: played beside the running detector they would pass for its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from motion_detect_ros.bridge import topics
from motion_detect_ros.bridge.load import LOAD
from motion_detect_ros.sources.bag_reader import chosen_topics
from motion_detect_ros.sources.raw import TopicInfo, printable


def _type_of(kind: Any) -> str:
    return f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'


#: Name, below any namespace -> type. Names alone would be too little: others publish a ``flow`` or ``detections`` too.
RESULTS = {
    **{topic.name.strip('/').replace('~', 'overlay'): _type_of(topic.kind) for topic in (
        topics.DIAGNOSTICS, topics.EGO_MOTION, topics.FLOW, topics.DETECTIONS, topics.OVERLAY, topics.OVERLAY_JPEG,
        topics.MARKERS, topics.FLOW_COLORS, LOAD)},
    'detections_2d': 'vision_msgs/msg/Detection2DArray',  # may not be installed
}


def is_result(topic: TopicInfo) -> bool:
    """Whether name and type are those of a topic that stages or overlay publish, in whatever namespace."""
    words = topic.name.strip('/').split('/')
    return any(RESULTS.get('/'.join(words[start:])) == topic.msgtype for start in range(len(words)))


def played_topics(
    bag: str, recorded: Iterable[TopicInfo], wanted: str, results: bool,
) -> tuple[tuple[TopicInfo, ...], str]:
    """What a player plays, never a ``/clock``; and the names of the results that it leaves out, separated by commas.

    wanted: names separated by commas, all of which are played; empty = all, without results where these are not asked.
    Raises: SourceError for a name that is not there, or where there is no message.
    """
    topics_of_bag = tuple(recorded)
    left_out = () if results or wanted.strip(' ,') else tuple(filter(is_result, topics_of_bag))
    chosen = chosen_topics(bag, tuple(topic for topic in topics_of_bag if topic not in left_out), wanted)
    played = tuple(topic for topic in chosen if topic.name != topics.CLOCK.name)  # times of recording are the clock
    return played, ', '.join(sorted({printable(topic.name) for topic in left_out}))
