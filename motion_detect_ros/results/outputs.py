"""What a replay writes as it goes: the detections of every frame, its ego-motion and its times."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

from motion_detect_ros.core.types import ByteArray, Result
from motion_detect_ros.results.detection_writer import FrameDetections
from motion_detect_ros.results.files import FRAMES_NAME, TIMES_NAME, TextFile
from motion_detect_ros.results.formats import DEFAULT_FORMATS, FORMATS
from motion_detect_ros.results.rows import FRAMES_HEADER, TIMES_HEADER, frames_row, times_row
from motion_detect_ros.sources.frames import CAMERA_FRAME


class _Outputs:
    """Files under construction that are finished together, ``_files``; use as a context manager."""

    _files: ExitStack

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        self._files.__exit__(kind, error, trace)


class DetectionOutputs(_Outputs):
    """The detections of one replay in every wanted format; use as a context manager.

    Each file is written as ``.part`` and renamed when complete; left by an exception, the parts stay as they are,
    readable, with everything written so far.
    """

    def __init__(self, folder: Path, source: str, formats: Sequence[str] = DEFAULT_FORMATS) -> None:
        """source: absolute path of what the detections are of; formats: names in ``FORMATS``.

        Raises: SourceError where the folder cannot be written, BackendError where a format's package is missing.
        """
        with ExitStack() as files:
            self._writers = [files.enter_context(FORMATS[name].make(folder, source)) for name in formats]
            self._files = files.pop_all()

    def write(self, found: FrameDetections) -> None:
        """Add the detections of one frame."""
        for writer in self._writers:
            writer.write(found)


class ReplayOutputs(_Outputs):
    """The detections, frames.csv and times.csv of one replay in process; use as a context manager, as those."""

    def __init__(self, folder: Path, source: str, formats: Sequence[str] = DEFAULT_FORMATS) -> None:
        """As ``DetectionOutputs``."""
        with ExitStack() as files:
            self._frames = files.enter_context(TextFile(folder / FRAMES_NAME, FRAMES_HEADER))
            self._times = files.enter_context(TextFile(folder / TIMES_NAME, TIMES_HEADER))
            self._detections = files.enter_context(DetectionOutputs(folder, source, formats))
            self._files = files.pop_all()

    def write(
        self, frame: int, decode_ms: float, result: Result, image: ByteArray | None = None,
        frame_id: str = CAMERA_FRAME,
    ) -> None:
        """Add one processed frame; decode_ms: what reading and decoding it took; image: (H, W[, 3]) uint8, where the
        results are to hold it with its boxes; frame_id: of its optical axis.
        """
        size = result.flow.width, result.flow.height
        self._detections.write(FrameDetections(frame, result.stamp_ns, result.detections, size, image, frame_id))
        self._frames.add(frames_row(frame, result))
        self._times.add(times_row(frame, decode_ms, result))
