"""Video files, with the time stamps of the container."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.sources.frames import FIRST_STAMP_NS, SourceFrame
from motion_detect_ros.sources.secrets import masked
from motion_detect_ros.sources.video_end import cut_off, more_follows
from motion_detect_ros.sources.window import WHOLE, Choice, Selection, Window

#: FFmpeg guesses by content too and would take a text file for terminal art; only these names are tried.
VIDEO_SUFFIXES = frozenset({
    '.mp4', '.m4v', '.mov', '.avi', '.mkv', '.webm', '.mpg', '.mpeg', '.ts', '.m2ts', '.wmv', '.flv', '.ogv', '.3gp',
    '.mjpg', '.mjpeg', '.h264', '.h265', '.hevc', '.y4m'})

NANOSECONDS_PER_MS = 1_000_000
#: A video is steady where this share of its pictures follow each other at the usual time: gaps mean something there.
STEADY_SHARE = 0.7
_LOG_LEVEL_SILENT = 0  # of OpenCV; its name exists in newer versions only
_QUIET = '-8'  # AV_LOG_QUIET: FFmpeg prints to stderr what we say ourselves in one line


def silence_opencv() -> None:
    """Switch OpenCV's log off: ``cv2.setLogLevel`` up to 4.6, ``cv2.utils.logging`` from then on."""
    log = getattr(cv2.utils, 'logging', cv2)
    log.setLogLevel(_LOG_LEVEL_SILENT)


def open_capture(
    address: Path | str | int, timeout_ms: int | None = None, open_timeout_ms: int | None = None,
) -> cv2.VideoCapture:
    """An opened OpenCV capture of a file, address or camera number.

    timeout_ms: how long a device or stream may take to open and to give a picture (a Video4Linux device takes whole
    seconds, those of the first that is opened); open_timeout_ms: to open, if that is another one. Raises: SourceError
    where it does not open.
    """
    os.environ.setdefault('OPENCV_FFMPEG_LOGLEVEL', _QUIET)
    silence_opencv()
    if timeout_ms is not None:
        os.environ.setdefault('OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT', str(max(1, timeout_ms // 1000)))
    if isinstance(address, int):
        capture = cv2.VideoCapture(address)
    else:
        limits = [] if timeout_ms is None else [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, open_timeout_ms or timeout_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, timeout_ms]
        place = str(address.absolute()) if isinstance(address, Path) else address  # relative, 12:00.mkv is a protocol
        capture = cv2.VideoCapture(place, cv2.CAP_FFMPEG if timeout_ms is not None else cv2.CAP_ANY, limits)
    if not capture.isOpened():
        capture.release()
        kind = 'camera' if isinstance(address, int) else 'video'
        raise SourceError(f'{masked(str(address))}: cannot be opened as a {kind}')
    return capture


class VideoFile:
    """A video file as a frame source.

    Stamps are FIRST_STAMP_NS and the container's presentation times (variable frame rate stays variable), or even
    steps where the caller gives a rate or the container has no times. ``frame_count`` is a guess of OpenCV's where the
    container does not count.
    """

    camera = None
    bad_frames = frames_passed = 0
    bad_reason = ''
    complaints: tuple[str, ...] = ()

    def __init__(self, path: Path, fps: float | None = None, window: Window = WHOLE) -> None:
        """fps: frames/s to use instead of the container's times. Raises: SourceError for no readable video."""
        if path.suffix.lower() not in VIDEO_SUFFIXES:
            raise SourceError(f'{path}: neither a bag (MCAP, db3) nor a video by its name (.mp4, .avi, .mkv, ...)')
        capture = open_capture(path)
        try:
            readable = capture.grab()
            self._container_fps = capture.get(cv2.CAP_PROP_FPS)
            frames = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        finally:
            capture.release()
        if not readable:
            raise SourceError(f'{path}: a video without a readable frame')
        self.path = path
        self.name = path.stem
        self.frame_count = frames if frames > 0 else None
        self.damaged = cut_off(path)
        self._fps = fps
        self._window = window

    def __iter__(self) -> Iterator[SourceFrame]:
        """Frames from the first; sets ``damaged`` where later ones than the last readable one follow, ``complaints``
        where some between are missing.
        """
        capture, selection, steps_ms = open_capture(self.path), Selection(self._window), Counter[float]()
        index, previous_ns, last_ms, self.frames_passed = 0, FIRST_STAMP_NS - 1, 0.0, 0
        try:
            while capture.grab():
                stamp_ns = self._stamp(capture, index, previous_ns)
                choice = selection.judge(index, stamp_ns)
                if choice is Choice.END:
                    return
                self.frames_passed = index + 1
                if choice is Choice.TAKE:
                    ok, image = capture.retrieve()
                    if not ok:
                        break
                    yield SourceFrame(index, image.astype(np.uint8, copy=False), stamp_ns)
                index, previous_ns = index + 1, stamp_ns
                now_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
                if index > 1:
                    steps_ms[round(now_ms - last_ms, 1)] += 1
                last_ms = max(last_ms, now_ms)
            if more_follows(capture, last_ms):
                self.damaged = self.damaged or f'unreadable after {index} frames'
        finally:
            self.complaints = tuple(_missing(steps_ms))
            capture.release()

    def _stamp(self, capture: cv2.VideoCapture, index: int, previous_ns: int) -> int:
        """Time of the frame just read, ns."""
        if self._fps is not None:
            return FIRST_STAMP_NS + round(index * NANOSECONDS / self._fps)
        stamp_ns = FIRST_STAMP_NS + round(capture.get(cv2.CAP_PROP_POS_MSEC) * NANOSECONDS_PER_MS)
        if stamp_ns > previous_ns:
            return stamp_ns
        if not self._container_fps > 0:
            raise SourceError(f'{self.path}: no time stamps and no frame rate; give --fps')
        return previous_ns + round(NANOSECONDS / self._container_fps)


def _missing(steps_ms: Mapping[float, int]) -> Iterator[str]:
    """A complaint where an otherwise steady video lacks pictures. steps_ms: time between two -> how often."""
    usual_ms = max(steps_ms, key=lambda step_ms: steps_ms[step_ms], default=0.0)
    if usual_ms <= 0.0:
        return
    times = {step_ms: round(step_ms / usual_ms) for step_ms in steps_ms}
    steady = sum(count for step_ms, count in steps_ms.items() if times[step_ms] == 1)
    places = sum(count for step_ms, count in steps_ms.items() if times[step_ms] > 1)
    if places and steady >= STEADY_SHARE * sum(steps_ms.values()):
        missing = sum(count * (times[step_ms] - 1) for step_ms, count in steps_ms.items() if times[step_ms] > 1)
        yield (f'{missing} pictures are missing in {places} place(s) by the times of the container, '
               'numbers of the frames after them are too small')
