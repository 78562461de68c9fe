"""``replay --live``: a bag through the real nodes over DDS instead of in this process."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

import motion_detect_ros
from motion_detect_ros.bridge.serialized import header_stamp_ns
from motion_detect_ros.cli.batch.inputs import size_of
from motion_detect_ros.cli.batch.jobs import UNREADABLE, Job, Outcome
from motion_detect_ros.cli.batch.resume import outcome_of_live
from motion_detect_ros.cli.live import (
    CAMERA_TOPIC,
    COMPRESSED_TOPIC,
    IMAGE_TOPIC,
    IMU_TOPIC,
    LiveGraph,
    Playback,
    spread,
)
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import MessageError, MotionDetectError, SourceError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.settings import settings
from motion_detect_ros.results.detection_writer import FrameDetections
from motion_detect_ros.results.files import BAG_NAME, CSV_NAME, SUMMARY_NAME
from motion_detect_ros.results.formats import remove_others
from motion_detect_ros.results.live_summary import LATENCIES, LiveSummary, write_live_summary
from motion_detect_ros.results.outputs import DetectionOutputs
from motion_detect_ros.results.ownership import owned
from motion_detect_ros.sources.bags import BagFrames, BagReader, is_bag
from motion_detect_ros.sources.messages import COMPRESSED_IMAGE


def run_live_job(job: Job, preset: str, rate: float) -> Outcome:
    """Play one bag; whatever goes wrong becomes the outcome, so that the others are still played."""
    try:
        return outcome_of_live(job.folder, replay_live(job, preset, rate))
    except MotionDetectError as error:
        return Outcome(UNREADABLE, f'error: {error}')
    except OSError as error:
        return Outcome(UNREADABLE, f'error: {job.folder}: cannot be written: {error.strerror or error}')


def replay_live(job: Job, preset: str, rate: float) -> LiveSummary:
    """Play a bag at ``rate`` times its speed; images that ``load.decimation_keep`` and ``load.decimation_of`` leave out
    are not asked for an answer. preset: what the settings of the job were read from.

    Writes the same detections.csv and detections.mcap as the replay in process; summary.json holds counts and
    latencies from image to detections. Raises: SourceError for an input that is no bag, or none with such images.
    """
    bag, input_bytes = Path(job.path), size_of(job.path)
    if bag.exists() and not is_bag(bag):
        raise SourceError(f'{bag}: --live expects a bag; make one with the convert command')
    frames = BagFrames(bag, job.topic)
    compressed, images = frames.topic.msgtype == COMPRESSED_IMAGE, frames.frame_count
    topics = {frames.topic.name: COMPRESSED_TOPIC if compressed else IMAGE_TOPIC}
    if frames.camera_topic:
        topics[frames.camera_topic] = CAMERA_TOPIC
    if job.config.imu.use and frames.imu_topic:
        topics[frames.imu_topic] = IMU_TOPIC
    given = ('rectified:=true',) if job.rectified else ()
    with LiveGraph(preset, parameters=given, compressed=compressed) as graph:
        playback = graph.play(bag.resolve(), wanted_of(job.config, images), rate, topics)
    summary, frame_of = live_summary(job, input_bytes, images, playback), _frame_numbers(bag, frames.topic.name)
    job.folder.mkdir(parents=True, exist_ok=True)
    with owned(job.folder):
        remove_others(job.folder, (CSV_NAME, BAG_NAME))
        (job.folder / SUMMARY_NAME).unlink(missing_ok=True)
        with DetectionOutputs(job.folder, str(bag)) as outputs:
            for message in playback.received:
                if message.stamp_ns in frame_of:
                    outputs.write(FrameDetections(frame_of[message.stamp_ns], message.stamp_ns, message.records))
        write_live_summary(job.folder, summary)
    return summary


def wanted_of(config: PipelineConfig, images: int) -> int:
    """How many of so many images are to be answered."""
    decimation = FrameDecimation(config.load.decimation_keep, config.load.decimation_of)
    return sum(decimation.keep_next() for _ in range(images))


def _frame_numbers(bag: Path, topic: str) -> dict[int, int]:
    """Stamp -> number of the image in the bag: an image without answer must not shift those after it."""
    numbers: dict[int, int] = {}
    with BagReader(bag) as reader:
        for number, message in enumerate(reader.messages([topic])):
            with contextlib.suppress(MessageError):
                numbers.setdefault(header_stamp_ns(message.data), number)
    return numbers


def live_summary(job: Job, input_bytes: int | None, images: int, playback: Playback) -> LiveSummary:
    """What came of a bag of so many images."""
    latencies = spread([message.latency_ms for message in playback.received])
    detections = [message.records for message in playback.received]
    return LiveSummary(
        input=job.path, input_bytes=input_bytes, topic=job.topic, rectified=job.rectified,
        version=motion_detect_ros.__version__, frames=images, source_frames=images,
        wanted=wanted_of(job.config, images), answered=len(playback.received),
        detections=sum(len(records) for records in detections),
        objects=len({int(number) for records in detections for number in records['id']}),
        latency_ms={name: round(value, 3) if math.isfinite(value) else None  # JSON has no NaN
                    for name, value in zip(LATENCIES, latencies, strict=True)},
        settings={name: value for name, value, _ in settings(job.config)})
