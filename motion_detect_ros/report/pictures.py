"""The pictures of a report, from one more pass over the input: the film, a background, and what is cut out."""

from __future__ import annotations

import base64
from collections import defaultdict
from collections.abc import Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain

import cv2
import numpy as np

from motion_detect_ros.core.errors import MotionDetectError
from motion_detect_ros.core.types import ByteArray
from motion_detect_ros.report.film import Film, film_size
from motion_detect_ros.report.replayed import Replayed
from motion_detect_ros.sources.ahead import Ahead
from motion_detect_ros.sources.frames import SourceFrame
from motion_detect_ros.sources.opening import open_source
from motion_detect_ros.sources.window import Window

#: A film has at most this many pictures; of a longer input every Nth is taken.
MAX_FILM_PICTURES = 3000
#: A thinned film plays at this rate or faster, however few pictures of a second it has, pictures/s.
MIN_FPS, MAX_FPS = 10.0, 60.0
BACKGROUND_WIDTH_PX = 640
_JPEG_QUALITY = 75


@dataclass(frozen=True)
class Cutout:
    """A piece of one frame around a box (x, y, w, h in px), ``margin`` box sizes wider on each side, shown in at most
    ``size_px`` (width, height); ``color`` (BGR) of the box drawn on it, None for none; ``key``: to find it by.
    """

    key: Hashable
    frame: int
    box: tuple[float, float, float, float]
    margin: float
    size_px: tuple[int, int]
    color: tuple[int, int, int] | None = None


@dataclass(frozen=True)
class FilmPlan:
    """Which frames a film shows: ``frames``, numbers in the source; ``fps``: the rate at which it plays."""

    frames: tuple[int, ...]
    fps: float


@dataclass
class Pictures:
    """What was made of the input's pictures. ``image_size``: width and height of the input's pictures,
    px, None where not known; ``cutouts``: data URLs by key; ``missing``: why there are none.
    """

    film: bytes = b''
    film_frames: tuple[int, ...] = ()
    image_size: tuple[int, int] | None = None
    background: str = ''
    cutouts: dict[Hashable, str] = field(default_factory=dict)
    missing: str = ''


def plan_film(replayed: Replayed) -> FilmPlan:
    """Every processed frame, or every Nth of many."""
    frames = replayed.frames['frame']
    step = -(-len(frames) // MAX_FILM_PICTURES) or 1
    real = 1.0 / (replayed.interval_s * step) if replayed.interval_s else MIN_FPS
    return FilmPlan(tuple(frames[::step].tolist()), min(MAX_FPS, max(real, MIN_FPS if step > 1 else 1.0)))


def take_pictures(replayed: Replayed, plan: FilmPlan, cutouts: Iterable[Cutout], path: str | None = None) -> Pictures:
    """Read the input again and take what is wanted of it; where that cannot be done, ``missing`` says why.

    path: where the input is now, by default where it was.
    """
    pictures = Pictures()
    if not len(replayed.frames):
        return pictures
    wanted: defaultdict[int, list[Cutout]] = defaultdict(list)
    for cutout in cutouts:
        wanted[cutout.frame].append(cutout)
    try:
        with Ahead(_frames(replayed, path, {*plan.frames, *wanted})) as frames:
            trouble = _take(replayed, plan, wanted, iter(frames), pictures)
    except MotionDetectError as error:
        trouble = str(error)
    if not pictures.film_frames:
        return Pictures(missing=trouble or f'{path or replayed.summary.input}: holds none of the replayed pictures')
    return pictures


def _frames(replayed: Replayed, path: str | None, wanted: set[int]) -> Iterator[SourceFrame]:
    """The frames of those numbers, where their stamps are those of the replay."""
    summary = replayed.summary
    stamps = dict(zip(replayed.frames['frame'].tolist(), replayed.frames['stamp_ns'].tolist(), strict=True))
    last = max(wanted, default=-1)
    window = Window(summary.start_s or 0.0, summary.duration_s, summary.every or 1)
    for frame in open_source(path or summary.input, summary.fps, summary.topic, window):
        if frame.index > last:
            return
        if frame.index in wanted and stamps.get(frame.index) == frame.stamp_ns:
            yield frame


def _take(
    replayed: Replayed, plan: FilmPlan, wanted: dict[int, list[Cutout]], frames: Iterator[SourceFrame],
    pictures: Pictures,
) -> str:
    """Fill ``pictures``; a source that breaks in the middle leaves a shorter film, and what it said is returned."""
    shown, middle, done, trouble = set(plan.frames), plan.frames[len(plan.frames) // 2], [], ''
    try:
        first = next(frames, None)
    except OSError as error:
        return str(error)
    if first is None:
        return trouble
    pictures.image_size = replayed.summary.image_size
    if not all(pictures.image_size):  # the summary of a replay that was killed at its beginning does not know it
        pictures.image_size = first.image.shape[1], first.image.shape[0]
    with Film(film_size(*pictures.image_size), plan.fps, len(plan.frames)) as film:
        try:
            for frame in chain((first,), frames):
                if frame.index in shown:
                    film.add(frame.image)
                    done.append(frame.index)
                if frame.index == middle:
                    pictures.background = data_url(_narrow(frame.image, BACKGROUND_WIDTH_PX))
                for cutout in wanted.get(frame.index, ()):
                    pictures.cutouts[cutout.key] = data_url(cut_out(frame.image, cutout))
        except (MotionDetectError, OSError) as error:
            trouble = str(error)
    pictures.film, pictures.film_frames = film.content, tuple(done)
    return trouble


def cut_out(image: ByteArray, cutout: Cutout) -> ByteArray:
    """The piece of a picture, (h, w, 3) uint8 BGR, at most of ``size_px``, enlarged up to four times."""
    bgr = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
    (x, y, w, h), (width, height) = cutout.box, cutout.size_px
    half_w = max(w * (0.5 + cutout.margin), 12.0, h * (0.5 + cutout.margin) * 0.6)
    half_h = max(half_w * height / width, h * (0.5 + cutout.margin))
    half_w = max(half_w, half_h * width / height)
    left, right = _span(x + w / 2, half_w, bgr.shape[1])
    top, bottom = _span(y + h / 2, half_h, bgr.shape[0])
    piece = bgr[top:bottom, left:right]
    scale = min(4.0, width / piece.shape[1], height / piece.shape[0])
    size = max(1, round(piece.shape[1] * scale)), max(1, round(piece.shape[0] * scale))
    piece = cv2.resize(piece, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    if cutout.color is not None:
        corner = round((x - left) * scale), round((y - top) * scale)
        other = round((x + w - left) * scale), round((y + h - top) * scale)
        cv2.rectangle(piece, corner, other, cutout.color, 2)
    return piece


def data_url(image: ByteArray) -> str:
    """A picture as a JPEG in a data URL."""
    _, encoded = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return 'data:image/jpeg;base64,' + base64.b64encode(encoded.tobytes()).decode('ascii')


def _span(centre: float, half: float, length: int) -> tuple[int, int]:
    """From and to of a piece of 2 * half around a centre, moved and cut to lie in 0..length, at least 1 long."""
    half = min(max(half, 1.0), length / 2)
    centre = float(np.clip(np.nan_to_num(centre), half, length - half))
    low = int(max(0, np.floor(centre - half)))
    return low, int(min(length, max(low + 1, np.ceil(centre + half))))


def _narrow(image: ByteArray, width_px: int) -> ByteArray:
    height = max(1, round(image.shape[0] * width_px / image.shape[1]))
    return cv2.resize(image, (width_px, height), interpolation=cv2.INTER_AREA) if image.shape[1] > width_px else image
