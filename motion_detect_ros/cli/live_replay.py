"""``replay --live``: a bag through the real nodes over DDS instead of in this process."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import motion_detect_ros
from motion_detect_ros.bridge.bag_publishers import is_name
from motion_detect_ros.bridge.serialized import header_stamp_ns
from motion_detect_ros.cli.batch.earlier import look
from motion_detect_ros.cli.batch.inputs import size_of
from motion_detect_ros.cli.batch.jobs import PARTIAL, UNREADABLE, Job, Outcome, UnfinishedError
from motion_detect_ros.cli.batch.resume import outcome_of_live
from motion_detect_ros.cli.live import (
    CAMERA_TOPIC,
    COMPRESSED_TOPIC,
    IMAGE_TOPIC,
    IMU_TOPIC,
    LiveGraph,
    Playback,
    queues,
    spread,
)
from motion_detect_ros.cli.planner import Received
from motion_detect_ros.cli.refused import RefusedImages
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import MessageError, MotionDetectError, SourceError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.settings import settings
from motion_detect_ros.core.stamp_order import StampOrder
from motion_detect_ros.presets import node_sections
from motion_detect_ros.results.detection_writer import FrameDetections
from motion_detect_ros.results.files import BAG_NAME, CSV_NAME, SUMMARY_NAME
from motion_detect_ros.results.formats import clear
from motion_detect_ros.results.live_summary import LATENCIES, LOAD, LiveSummary, write_live_summary
from motion_detect_ros.results.outputs import DetectionOutputs
from motion_detect_ros.results.ownership import owned
from motion_detect_ros.sources.bags import BagFrames, BagReader, is_bag
from motion_detect_ros.sources.messages import COMPRESSED_IMAGE
from motion_detect_ros.sources.raw import LOST, TopicInfo, printable

#: So many images may wait in each node: what is still played until the player has heard that it shall wait.
QUEUE_SIZE = 100


@dataclass(frozen=True)
class Recorded:
    """An image topic of a bag.

    ``images``: that were recorded; ``stamps_ns``: of those that can be played, and whose stamps are in order, else the
    nodes leave them out; ``unreadable``: that are lost, or too short for a stamp; ``frame_of``: stamp, ns -> number of
    the image in the bag, as one without an answer must not shift those after it; ``damaged``: what is wrong with the
    bag.
    """

    images: int
    stamps_ns: Sequence[int]
    frame_of: Mapping[int, int]
    unreadable: int = 0
    damaged: str | None = None


def run_live_job(job: Job, preset: str, rate: float) -> Outcome:
    """Play one bag; whatever goes wrong becomes the outcome, so that the others are still played."""
    try:
        return outcome_of_live(job.folder, replay_live(job, preset, rate))
    except UnfinishedError as error:
        return Outcome(PARTIAL, f'error: {error}')
    except MotionDetectError as error:
        return Outcome(UNREADABLE, f'error: {error}')
    except OSError as error:
        return Outcome(UNREADABLE, f'error: {job.folder}: cannot be written: {error.strerror or error}')


def replay_live(job: Job, preset: str, rate: float) -> LiveSummary:
    """Play a bag at ``rate`` times its speed; images that ``load.decimation_keep`` leaves out, or whose stamps are
    not in order, are not asked for an answer. preset: what the settings of the job were read from.

    Where the stages are behind the player waits for them, so that every image is answered: unless the settings say
    how many may wait, or have ``load.adapt``.

    Writes the same detections.csv and detections.mcap as the replay in process; summary.json holds counts and
    latencies from image to detections. Raises: SourceError for an input that is no bag, or none with such images, for a
    topic whose name ROS refuses, and where a node does not start; UnfinishedError where one ends later, and
    KeyboardInterrupt, after what was answered until then is in the ``.part`` files.
    """
    bag, input_bytes = Path(job.path), size_of(job.path)
    if bag.exists() and not is_bag(bag):
        raise SourceError(f'{bag}: --live expects a bag; make one with the convert command')
    frames = BagFrames(bag, job.topic)
    recorded, compressed = read_through(bag, frames.topic), frames.topic.msgtype == COMPRESSED_IMAGE
    topics = {frames.topic.name: COMPRESSED_TOPIC if compressed else IMAGE_TOPIC}
    if frames.camera_topic:
        topics[frames.camera_topic] = CAMERA_TOPIC
    if job.config.imu.use and frames.imu_topic:
        topics[frames.imu_topic] = IMU_TOPIC
    _check_names(bag, topics)
    given = ('rectified:=true',) if job.rectified else ()
    waits = not job.config.load.adapt and not _sets_queues(preset)
    wanted = wanted_of(job.config, recorded.stamps_ns)
    refused = RefusedImages(bag, frames.topic, job.config.preprocessing)
    heard: tuple[Received, ...] = ()
    playback: Playback | None = None
    stopped: BaseException | None = None
    try:
        with LiveGraph(preset, parameters=(*given, *queues(QUEUE_SIZE)) if waits else given,
                       compressed=compressed) as graph:
            try:
                playback = graph.play(bag.resolve(), len(wanted), rate, topics, wanted, waits, refused.among)
            finally:
                heard = graph.heard
    except KeyboardInterrupt:
        if not heard:
            raise KeyboardInterrupt(f'{job.folder}: no image was answered yet, nothing was written') from None
        stopped = KeyboardInterrupt()
    except SourceError as error:
        if not heard:
            raise
        stopped = UnfinishedError(f'{error}; {len(heard)} answers are kept in the .part files')
    bad = refused.among(wanted - {message.stamp_ns for message in heard}) if playback else frozenset()
    summary = live_summary(job, input_bytes, recorded, heard, playback, len(bad))
    _write(job, summary, recorded.frame_of, heard, stopped)
    return summary


def _check_names(bag: Path, topics: Iterable[str]) -> None:
    """Raises: SourceError for a recorded topic that no node can publish."""
    for name in topics:
        if not is_name(name):
            raise SourceError(printable(
                f'{bag}: --live expected topics with names of letters, digits and _, their parts joined by / and none '
                f'beginning with a digit, got {name}'))


def _write(
    job: Job, summary: LiveSummary, frame_of: Mapping[int, int], heard: Sequence[Received],
    stopped: BaseException | None,
) -> None:
    """Summary and detections. Raises: SourceError where the folder holds something else by now; ``stopped``, what ended
    the playback early; the detections stay in ``.part`` files then, by which the next run knows that it is to be done
    anew.
    """
    try:
        job.folder.mkdir(parents=True, exist_ok=True)
        with owned(job.folder):
            look(job, live=True)
            clear(job.folder, (CSV_NAME, BAG_NAME, SUMMARY_NAME))
            write_live_summary(job.folder, summary)
            with DetectionOutputs(job.folder, job.path) as outputs:
                for message in heard:
                    if message.stamp_ns in frame_of:
                        outputs.write(FrameDetections(frame_of[message.stamp_ns], message.stamp_ns, message.records,
                                                      frame_id=message.frame_id))
                if stopped:
                    raise stopped
    except (MotionDetectError, OSError) as error:
        if isinstance(stopped, KeyboardInterrupt):  # the other inputs are not to be played all the same
            raise KeyboardInterrupt(str(error)) from None
        raise


def wanted_of(config: PipelineConfig, stamps_ns: Iterable[int]) -> frozenset[int]:
    """Which images, of those whose stamps the nodes take, are to be answered."""
    decimation = FrameDecimation.by(config.load)
    return frozenset(stamp_ns for stamp_ns in stamps_ns if decimation.keep_next())


def _sets_queues(preset: str) -> bool:
    """Whether the user says in it how many images may wait: more are then left out, as from a camera."""
    return any(name == 'queue_size' or name.startswith('qos_overrides.')
               for section in node_sections(preset).values() for name in section)


def read_through(bag: Path, topic: TopicInfo) -> Recorded:
    """What a bag holds of an image topic: damage inside it shows only once it is read.

    Raises: SourceError where not one image can be read, or none has a stamp that nodes take.
    """
    readable, unreadable, order, stamps_ns, frame_of = 0, 0, StampOrder(), list[int](), dict[int, int]()
    with BagReader(bag) as reader:
        for number, message in enumerate(filter(topic.holds, reader.messages([topic.name]))):
            readable += message.data != LOST
            try:
                stamp_ns = header_stamp_ns(message.data)
            except MessageError:
                unreadable += 1
                continue
            if order.judge(stamp_ns).usable:
                stamps_ns.append(stamp_ns)
            frame_of.setdefault(stamp_ns, number)
        if not stamps_ns:
            fault = 'whose stamp can be used' if readable else 'that can be read'
            raise SourceError(f'{bag}: expected images on {topic.name}, found none {fault}'
                              + (f'; {reader.damaged}' if reader.damaged else ''))
        return Recorded(topic.count, stamps_ns, frame_of, unreadable, reader.damaged)


def live_summary(
    job: Job, input_bytes: int | None, recorded: Recorded, heard: Sequence[Received], playback: Playback | None = None,
    refused: int = 0,
) -> LiveSummary:
    """What came of a bag. heard: its answers; playback: None where it was stopped; refused: images that no node can
    use, of those without an answer.
    """
    latencies = spread([message.latency_ms for message in heard])
    detections = [message.records for message in heard]
    asked = len(wanted_of(job.config, recorded.stamps_ns))
    return LiveSummary(
        input=job.path, input_bytes=input_bytes, topic=job.topic, rectified=job.rectified,
        version=motion_detect_ros.__version__, damaged=recorded.damaged, frames=recorded.images,
        source_frames=recorded.images, bad_frames=recorded.unreadable + refused, wanted=asked - refused,
        answered=len(heard),
        left_out=_left_out(playback, len(recorded.stamps_ns) - asked, asked - refused, len(heard)) if playback else {},
        held_s=round(playback.held_s, 3) if playback else 0.0,
        detections=sum(len(records) for records in detections),
        objects=len({int(number) for records in detections for number in records['id']}),
        latency_ms={name: round(value, 3) if math.isfinite(value) else None  # JSON has no NaN
                    for name, value in zip(LATENCIES, latencies, strict=True)},
        settings={name: value for name, value, _ in settings(job.config)})


def _left_out(playback: Playback, decimated: int, wanted: int, answered: int) -> dict[str, int]:
    """The images that were wanted and not answered, by what left them out. decimated: left out by the settings."""
    by_load = max(0, min(playback.left_out - decimated, wanted - answered))
    return ({LOAD: by_load} if by_load else {}) | left_out_by(playback.processed, wanted - by_load, answered)


def left_out_by(processed: Mapping[str, int], wanted: int, answered: int) -> dict[str, int]:
    """Which nodes left out how many of the images that were wanted and not answered.

    processed: what each node answered, in the order of the graph; what none of them lacks was lost after the last.
    """
    found, left = dict[str, int](), wanted
    for node, count in (*processed.items(), ('transport', answered)):
        reached = max(answered, min(left, count))
        if reached < left:
            found[node] = left - reached
        left = reached
    return found
