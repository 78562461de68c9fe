"""What is tuned on: pictures in memory, and the detector run over them forwards or backwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import FrameError, SourceError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.stamp_order import StampOrder
from motion_detect_ros.core.types import ByteArray, CameraModel
from motion_detect_ros.results.found import Found
from motion_detect_ros.results.metrics import boxes_of
from motion_detect_ros.sources.opening import open_source


@dataclass(frozen=True)
class Recording:
    """An input as ``open_source`` takes it, and its truth, where there is some. ``limit``: first frames used;
    ``rectified``: the pictures of a bag are, as for ``camera_of``.
    """

    path: str
    truth: Path | None = None
    fps: float | None = None
    topic: str | None = None
    limit: int | None = None
    rectified: bool = False


@dataclass(frozen=True)
class Picture:
    """``index``: of the source; ``image``: (H, W[, 3]) uint8; ``stamp_ns``: nanoseconds; ``camera``: None = unknown."""

    index: int
    image: ByteArray
    stamp_ns: int
    camera: CameraModel | None


@dataclass(frozen=True)
class Clip:
    """The pictures of a recording that are processed, in order of time."""

    pictures: Sequence[Picture]

    def reversed(self) -> Clip:
        """The same flight backwards; the first stamp becomes the last."""
        ends = self.pictures[0].stamp_ns + self.pictures[-1].stamp_ns
        return Clip([replace(one, stamp_ns=ends - one.stamp_ns) for one in reversed(self.pictures)])


def load(recording: Recording, config: PipelineConfig) -> Clip:
    """Read and decode a recording, without pictures that have no usable stamp and those that ``load.decimation_keep``
    of ``load.decimation_of`` leave out.

    Raises: SourceError for one that cannot be read or holds no pictures.
    """
    source, order = open_source(
        recording.path, recording.fps, recording.topic, rectified=recording.rectified), StampOrder()
    decimation = FrameDecimation.by(config.load)
    pictures = [Picture(frame.index, frame.image, frame.stamp_ns, frame.camera)
                for frame in islice(source, recording.limit)
                if order.judge(frame.stamp_ns).usable and decimation.keep_next()]
    if not pictures:
        raise SourceError(f'{recording.path}: expected pictures, found none')
    return Clip(pictures)


def detect(clip: Clip, config: PipelineConfig) -> Found:
    """Every picture through a fresh pipeline; one that the core refuses has no detections."""
    pipeline, boxes, ids = MotionPipeline(config), {}, {}
    for picture in clip.pictures:
        pipeline.use_camera(picture.camera)
        try:
            records = pipeline.process(picture.image, picture.stamp_ns).detections
        except FrameError:
            continue
        boxes[picture.index], ids[picture.index] = boxes_of(records), records['id'].tolist()
    return Found(boxes, ids)
