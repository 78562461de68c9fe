"""Detections and summaries made by hand, and files written from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from motion_detect_ros.core.types import RecordArray, empty_detections
from motion_detect_ros.results.detection_writer import FrameDetections
from motion_detect_ros.results.outputs import DetectionOutputs
from motion_detect_ros.results.summary import STAGES, Percentiles, Summary

SIZE = 640, 480


def detections(*rows: tuple[int, float, float, float, float, float]) -> RecordArray:
    """Records from (id, u, v, width, height, score)."""
    records = empty_detections(len(rows))
    for name, column in zip(('id', 'u', 'v', 'width', 'height', 'score'), zip(*rows, strict=True), strict=False):
        records[name] = column
    return records


#: Frame 2 was unreadable; nothing was found in frame 3. All numbers are exact in float32.
FOUND = [
    FrameDetections(0, 10**9, detections((7, 50.5, 20.0, 11.0, 4.0, 0.25)), SIZE),
    FrameDetections(1, 1050 * 10**6, detections(
        (7, 52.5, 20.0, 11.0, 4.0, 0.5), (9, 300.0, 200.25, 32.0, 16.5, 0.75)), SIZE),
    FrameDetections(3, 1150 * 10**6, detections(), SIZE),
]
#: A box that is none: only formats that know NaN may hold it.
UNKNOWN = FrameDetections(4, 2 * 10**9, detections((11, np.nan, 20.0, 11.0, 4.0, 0.5)), SIZE)


def summary(**changed: object) -> Summary:
    """Some input's, changed in some fields."""
    values: dict[str, object] = {
        'input': 'a.mcap', 'topic': '/image_raw', 'formats': ['csv'], 'version': '0.1.0', 'complete': True,
        'damaged': None, 'announced_frames': 3, 'frames': 2, 'bad_frames': 1, 'misstamped_frames': 0,
        'source_frames': 3, 'detections': 5, 'objects': 2, 'ego_status': {'ok': 1, 'first_frame': 1},
        'image_size': (320, 240), 'calibrated': False, 'first_stamp_ns': 10, 'last_stamp_ns': 30,
        'stage_ms': {stage: Percentiles(1.0, 2.0) for stage in STAGES}, 'decode_ms': Percentiles(),
        'settings': {'load.threads': 0}}
    return Summary(**{**values, **changed})


def write(folder: Path, *formats: str, found: list[FrameDetections] | None = None) -> None:
    """The files of some formats, complete."""
    with DetectionOutputs(folder, 'flight.mcap', formats) as outputs:
        for frame in FOUND if found is None else found:
            outputs.write(frame)


def interrupted(folder: Path, *formats: str) -> None:
    """The files of some formats, left by an exception."""
    try:
        with DetectionOutputs(folder, 'flight.mcap', formats) as outputs:
            for frame in FOUND:
                outputs.write(frame)
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        return
