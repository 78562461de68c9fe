"""The pictures of a bag as a frame source."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from motion_detect_ros.core.errors import MessageError, MotionDetectError, SourceError
from motion_detect_ros.core.types import ByteArray, CameraModel
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bag_reader import BagReader
from motion_detect_ros.sources.calibration import NONE, UNCALIBRATED, Calibration
from motion_detect_ros.sources.camera_info import camera_of
from motion_detect_ros.sources.encoding import ImageDecoder
from motion_detect_ros.sources.frames import SourceFrame, first_reason
from motion_detect_ros.sources.images import decode_image
from motion_detect_ros.sources.inertial import GyroSample, rates_of
from motion_detect_ros.sources.raw import CDR, RawMessage, TopicInfo, printable
from motion_detect_ros.sources.timeline import timeline
from motion_detect_ros.sources.window import WHOLE, Choice, Selection, Window

IMAGE_TYPES = (messages.IMAGE, messages.COMPRESSED_IMAGE)
_COMPRESSED = '/compressed'
#: Topic that is meant where several are of type Imu.
_IMU = 'imu'


class BagFrames:
    """One image topic (Image or CompressedImage) of a bag; stamps are those of the headers.

    Each picture has the calibration of its own ``camera_info``, as in the nodes (``Calibration``); those before the
    first one have that. ``complaints``: why any of those passed has none, or one without its distortion.
    """

    def __init__(
        self, path: str | Path, topic: str | None = None, window: Window = WHOLE, rectified: bool = False,
    ) -> None:
        """topic: with or without the leading slash; None where the bag has only one.

        window: by the times of recording, from that of the topic's first message; that the recording's clock was set,
        back or by more than a day ahead, is no time that passed, as in ``timeline``. rectified: as for ``camera_of``.
        Raises: SourceError for an empty bag, and for a wrong topic with a list of the image topics.
        """
        self._reader = BagReader(path)
        self.path = Path(path)
        self.name = self.path.resolve().stem
        self.topic = _choose_topic(self.path, self._reader.topics, topic)
        self.complaints: tuple[str, ...] = ()
        self.camera_topic = self._choose_camera_topic()
        self.camera_info = self._read_camera_info()
        self.camera = camera_of(self.camera_info, rectified) if self.camera_info is not None else None
        self._rectified = rectified
        self.bad_frames, self.bad_reason, self.frames_passed = 0, '', 0
        self._window = window

    @property
    def frame_count(self) -> int:
        """Recorded messages of the topic, readable or not."""
        return self.topic.count

    @property
    def damaged(self) -> str | None:
        """As of the bag."""
        return self._reader.damaged

    def __iter__(self) -> Iterator[SourceFrame]:
        """Frames in order; a malformed message costs itself only and is counted in ``bad_frames``."""
        self.bad_frames, self.bad_reason, self.frames_passed = 0, '', 0
        decoder, selection, calibration = ImageDecoder(), Selection(self._window), Calibration(self._rectified)
        if self.camera_info is not None:
            calibration.note(self.camera_info)
        for index, (position_ns, message) in enumerate(self._placed(calibration)):
            choice = selection.judge(index, position_ns)
            if choice is Choice.END:
                return
            self.frames_passed = index + 1
            if choice is Choice.SKIP:
                continue
            try:
                image, stamp_ns, frame_id = decode_message(message, decoder)
            except MotionDetectError as error:
                self.bad_frames += 1
                self.bad_reason = first_reason(self.bad_reason, index, error)
                continue
            yield SourceFrame(index, image, stamp_ns, self._camera_of(image, stamp_ns, calibration), frame_id)

    def _camera_of(self, image: ByteArray, stamp_ns: int, calibration: Calibration) -> CameraModel | None:
        height, width = image.shape[:2]
        camera, complaint = calibration.for_image(stamp_ns, width, height), calibration.complaint()
        # All zero is how a camera says that it is not calibrated: nothing is wrong with the bag.
        if complaint and calibration.state not in {NONE, UNCALIBRATED} and complaint not in self.complaints:
            self.complaints += (complaint,)
        return camera

    def _placed(self, calibration: Calibration) -> Iterator[tuple[int, RawMessage]]:
        """The messages, each with its time after the first one, ns, where the window asks for times; else with 0."""
        recorded = self._pictures(calibration)
        if not self._window.by_time:  # nothing waits for the message after it, which may be unreadable
            return ((0, message) for message in recorded)
        return ((timed.position_ns, timed.message) for timed in timeline(recorded))

    def _pictures(self, calibration: Calibration) -> Iterator[RawMessage]:
        """The messages of the topic, each after the ``camera_info`` up to the next one: its own may be behind it."""
        if self.camera_topic is None:
            yield from _messages(self._reader, self.topic.name, self.topic.msgtype)
            return
        waiting: RawMessage | None = None
        try:
            for message in self._reader.messages((self.topic.name, self.camera_topic)):
                if message.topic == self.camera_topic:
                    _note(message, calibration)
                elif _holds(message, self.topic.msgtype):
                    before, waiting = waiting, message
                    if before is not None:
                        yield before
        except (OSError, MotionDetectError):  # what was read before counts
            if waiting is not None:
                yield waiting
            raise
        if waiting is not None:
            yield waiting

    def gyro(self) -> Iterator[GyroSample]:
        """Angular rates of the only Imu topic, or of the one named ``imu``; stamps are those of the headers.

        Empty where there is none. Malformed messages and those without angular velocity are left out.
        Raises: SourceError, with a list, where there are several and none has that name.
        """
        return _gyro(BagReader(self.path), self.imu_topic)

    @property
    def imu_topic(self) -> str | None:
        """The topic that ``gyro`` reads. Raises: SourceError as ``gyro``."""
        found = [topic for topic in self._reader.topics if _holds(topic, messages.IMU) and topic.count]
        named = [topic for topic in found if topic.name.lstrip('/') == _IMU] or found
        if len(named) > 1:
            listed = ', '.join(f'{topic.name} ({topic.count})' for topic in found)
            raise SourceError(f'{self.path}: expected one topic of type Imu or one named /{_IMU}, got {listed}')
        return named[0].name if named else None

    def _choose_camera_topic(self) -> str | None:
        """The CameraInfo beside the image topic, or the only one in the bag that is beside no other image topic."""
        with_messages = [topic for topic in self._reader.topics if topic.count]
        infos = [topic.name for topic in with_messages if _holds(topic, messages.CAMERA_INFO)]
        own = _namespace(self.topic.name)
        beside = [name for name in infos if name.strip('/') == f'{own}/camera_info'.strip('/')]
        if beside or len(infos) != 1:
            return beside[0] if beside else None
        only, images = infos[0], (topic for topic in with_messages if _holds(topic, *IMAGE_TYPES))
        if _namespace(only) in {_namespace(topic.name) for topic in images} - {own}:
            self.complaints += (f'{printable(only)} left out, as it is beside another image topic: bearings are NaN',)
            return None
        return only

    def _read_camera_info(self) -> Any:
        """The first readable message of ``camera_topic``, None where there is none."""
        for message in _messages(self._reader, self.camera_topic, messages.CAMERA_INFO):
            try:
                return messages.deserialize(message.data, messages.CAMERA_INFO)
            except MessageError:
                continue
        return None


def _namespace(topic: str) -> str:
    """Of a topic of a camera, which its pictures and their ``camera_info`` share."""
    return topic.removesuffix(_COMPRESSED).strip('/').rpartition('/')[0]


def _note(message: RawMessage, calibration: Calibration) -> None:
    if _holds(message, messages.CAMERA_INFO):
        with suppress(MessageError):
            calibration.note(messages.deserialize(message.data, messages.CAMERA_INFO))


def decode_message(message: RawMessage, decoder: ImageDecoder) -> tuple[ByteArray, int, str]:
    """Picture, (H, W) grey or (H, W, 3) BGR uint8, header stamp (ns) and frame_id of an Image or CompressedImage.

    decoder: of the topic. Raises: MessageError, SourceError where it holds no picture.
    """
    content = messages.deserialize(message.data, message.msgtype)
    if message.msgtype == messages.COMPRESSED_IMAGE:
        image = decode_image(content.data.tobytes(), message.topic, decoder)
    else:
        image = decoder.decode(content.height, content.width, content.encoding, bool(content.is_bigendian),
                               content.step, content.data)
    return image, messages.stamp_of(content), str(content.header.frame_id)


def _messages(reader: BagReader, topic: str | None, msgtype: str) -> Iterator[RawMessage]:
    """Those of a topic that are of this type, in CDR, if not all are."""
    return (message for message in reader.messages([topic] if topic else ()) if _holds(message, msgtype))


def _holds(what: TopicInfo | RawMessage, *msgtypes: str) -> bool:
    """Whether it is of one of these types, in bytes that can be read."""
    return what.msgtype in msgtypes and what.encoding == CDR


def _gyro(reader: BagReader, topic: str | None) -> Iterator[GyroSample]:
    with reader:
        for message in _messages(reader, topic, messages.IMU):
            try:
                content = messages.deserialize(message.data, messages.IMU)
            except MessageError:
                continue
            if (rate := rates_of(content)) is not None:
                yield GyroSample(messages.stamp_of(content), rate)


def _choose_topic(path: Path, topics: tuple[TopicInfo, ...], wanted: str | None) -> TopicInfo:
    listed = ', '.join(printable(f'{topic.name} ({topic.form}, {topic.count})')
                       for topic in topics if topic.msgtype in IMAGE_TYPES) or 'none'
    images = [topic for topic in topics if _holds(topic, *IMAGE_TYPES)]
    if not sum(topic.count for topic in topics):
        raise SourceError(f'{path}: the bag is empty (0 messages in {len(topics)} topics)')
    if wanted is not None:
        chosen = [topic for topic in images if topic.name.lstrip('/') == wanted.lstrip('/')]
        if not chosen:
            raise SourceError(f'{path}: no image topic {wanted!r}; image topics (type, messages): {listed}')
        return _with_messages(path, chosen[0])
    candidates = [topic for topic in images if topic.count]
    names = {topic.name for topic in candidates}
    # The same pictures twice, raw and compressed: the raw ones need no decoding.
    distinct = [topic for topic in candidates if topic.name.removesuffix(_COMPRESSED) not in names - {topic.name}]
    if len(distinct) != 1:
        problem = ('several image topics, choose one: --topic, or topic of the camera node' if distinct
                   else 'no image topic with messages')
        raise SourceError(f'{path}: {problem}; image topics (type, messages): {listed}')
    return distinct[0]


def _with_messages(path: Path, topic: TopicInfo) -> TopicInfo:
    if not topic.count:
        raise SourceError(f'{path}: topic {topic.name} is empty (0 messages)')
    return topic
