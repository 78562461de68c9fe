"""``replay --live``: a bag through the real nodes over DDS instead of in this process."""

from __future__ import annotations

import contextlib
import json
import math
from pathlib import Path

import motion_detect_ros
from motion_detect_ros.bridge.serialized import header_stamp_ns
from motion_detect_ros.cli.live import (
    CAMERA_TOPIC,
    COMPRESSED_TOPIC,
    IMAGE_TOPIC,
    IMU_TOPIC,
    LiveGraph,
    Playback,
    spread,
)
from motion_detect_ros.core.errors import MessageError, SourceError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.detection_writer import FrameDetections
from motion_detect_ros.results.files import BAG_NAME, CSV_NAME, SUMMARY_NAME, write_whole
from motion_detect_ros.results.formats import remove_others
from motion_detect_ros.results.outputs import DetectionOutputs
from motion_detect_ros.sources.bags import BagFrames, BagReader, is_bag
from motion_detect_ros.sources.messages import COMPRESSED_IMAGE


def replay_live(
    bag: Path, folder: Path, preset: str, rate: float, wanted: str | None = None,
) -> tuple[int, str]:
    """Plays ``bag`` at ``rate`` times its speed; returns how many images got no answer, and a line for
    the user; those that ``load.decimation_keep`` and ``load.decimation_of`` leave out are not asked for one.

    wanted: image topic of a bag that has several.

    Writes the same detections.csv and detections.mcap as the replay in process; summary.json holds counts and
    latencies from image to detections. Raises: SourceError for an input that is no bag, or none with such images.
    """
    if not is_bag(bag):
        raise SourceError(f'{bag}: --live expects a bag; make one with the convert command')
    frames = BagFrames(bag, wanted)
    compressed, images = frames.topic.msgtype == COMPRESSED_IMAGE, frames.frame_count
    topics = {frames.topic.name: COMPRESSED_TOPIC if compressed else IMAGE_TOPIC}
    if frames.camera_topic:
        topics[frames.camera_topic] = CAMERA_TOPIC
    config = load_preset(preset)
    decimation = FrameDecimation(config.load.decimation_keep, config.load.decimation_of)
    wanted_images = sum(decimation.keep_next() for _ in range(images))
    if config.imu.use and frames.imu_topic:
        topics[frames.imu_topic] = IMU_TOPIC
    with LiveGraph(preset, compressed=compressed) as graph:
        playback = graph.play(bag.resolve(), wanted_images, rate, topics)
    folder.mkdir(parents=True, exist_ok=True)
    remove_others(folder, (CSV_NAME, BAG_NAME, SUMMARY_NAME))
    frame_of = _frame_numbers(bag, frames.topic.name)
    with DetectionOutputs(folder, str(bag)) as outputs:
        for message in playback.received:
            if message.stamp_ns in frame_of:
                outputs.write(FrameDetections(frame_of[message.stamp_ns], message.stamp_ns, message.records))
    write_live_summary(folder, bag, images, playback)
    unanswered = wanted_images - len(playback.received)
    median, p95, _ = spread([message.latency_ms for message in playback.received])
    return unanswered, (f'{folder}: {images} images, {len(playback.received)} answers, latency {median:.0f} ms median, '
                        f'{p95:.0f} ms p95')


def _frame_numbers(bag: Path, topic: str) -> dict[int, int]:
    """Stamp -> number of the image in the bag: an image without answer must not shift those after it."""
    numbers: dict[int, int] = {}
    with BagReader(bag) as reader:
        for number, message in enumerate(reader.messages([topic])):
            with contextlib.suppress(MessageError):
                numbers.setdefault(header_stamp_ns(message.data), number)
    return numbers


def write_live_summary(folder: Path, bag: Path, images: int, playback: Playback) -> None:
    """Write summary.json of a bag of so many images, whole or not at all."""
    latencies = spread([message.latency_ms for message in playback.received])
    detections = [message.records for message in playback.received]
    summary = {
        'input': str(bag), 'version': motion_detect_ros.__version__, 'live': True, 'frames': images,
        'source_frames': images, 'answered': len(playback.received),
        'detections': sum(len(records) for records in detections),
        'objects': len({int(number) for records in detections for number in records['id']}),
        'latency_ms': {name: round(value, 3) if math.isfinite(value) else None  # JSON has no NaN
                       for name, value in zip(('p50', 'p95', 'p99'), latencies, strict=True)}}
    write_whole(folder / SUMMARY_NAME, json.dumps(summary, indent=2) + '\n')
