"""Images that no node can use, known by trying what an image without an answer holds."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from motion_detect_ros.bridge.serialized import header_stamp_ns
from motion_detect_ros.core.config import PreprocessingConfig
from motion_detect_ros.core.errors import MessageError, MotionDetectError
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.sources.bag_frames import decode_message
from motion_detect_ros.sources.bags import BagReader
from motion_detect_ros.sources.encoding import ImageDecoder
from motion_detect_ros.sources.raw import RawMessage, TopicInfo


class RefusedImages:
    """Those of an image topic whose bytes are no picture, or one that the detector refuses, as a replay in process
    counts them. Only images that are asked for are decoded: that takes as long as in the nodes.
    """

    def __init__(self, bag: Path, topic: TopicInfo, config: PreprocessingConfig) -> None:
        self._bag, self._topic, self._config = bag, topic, config
        self._known: dict[int, bool] = {}

    def among(self, stamps_ns: Collection[int]) -> frozenset[int]:
        """Which images of these stamps are refused. Raises: SourceError where the bag cannot be read."""
        unknown = set(stamps_ns) - self._known.keys()
        if unknown:
            with BagReader(self._bag) as reader:
                for message in filter(self._topic.holds, reader.messages([self._topic.name])):
                    stamp_ns = _stamp_of(message)
                    if stamp_ns is not None and stamp_ns in unknown:
                        self._known[stamp_ns] = self._refuses(message)
        return frozenset(stamp_ns for stamp_ns in stamps_ns if self._known.get(stamp_ns))

    def _refuses(self, message: RawMessage) -> bool:
        try:
            image, stamp_ns, _ = decode_message(message, ImageDecoder())
            Preprocessor(self._config).process(image, stamp_ns)
        except MotionDetectError:
            return True
        return False


def _stamp_of(message: RawMessage) -> int | None:
    try:
        return header_stamp_ns(message.data)
    except MessageError:
        return None
