"""Objects: what the detections of one track add up to."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.drawing import HUE_STEP
from motion_detect_ros.core.types import RecordArray
from motion_detect_ros.report.replayed import Replayed

#: More objects than this are not listed one by one: those seen in the most frames are.
MAX_LISTED = 300
#: A gap of more than so many frames parts the life of an object in two on the timeline.
MAX_GAP_FRAMES = 3


@dataclass(frozen=True)
class TrackedObject:
    """One track. Times in s since the first frame, speeds in px/s without the camera's motion, sizes in px.

    ``best_frame``: where it shows best; ``parts``: from and to of each stretch without gaps; ``ttc_s``: the least time
    to contact, NaN where never known.
    """

    identity: int
    first_s: float
    last_s: float
    frames: int
    speed: float
    top_speed: float
    width: float
    height: float
    score: float
    ttc_s: float
    best_frame: int
    best_s: float
    parts: tuple[tuple[float, float], ...]

    @property
    def life_s(self) -> float:
        """From the first to the last detection."""
        return self.last_s - self.first_s

    @property
    def color(self) -> str:
        """The colour of its boxes and bars: as strong as that of the drawn boxes, but dark enough for white paper."""
        red, green, blue = colorsys.hls_to_rgb(self.identity * HUE_STEP % 1.0, 0.45, 0.75)
        return f'#{round(255 * red):02x}{round(255 * green):02x}{round(255 * blue):02x}'


def tracked_objects(replayed: Replayed) -> list[TrackedObject]:
    """Every object of a replay, in the order of their first detection."""
    boxes = replayed.boxes[np.argsort(replayed.boxes['id'], kind='stable')]
    starts = np.flatnonzero(np.r_[True, np.diff(boxes['id']) != 0]) if len(boxes) else np.empty(0, np.int64)
    found = [_object(replayed, track) for track in np.split(boxes, starts[1:]) if len(track)]
    return sorted(found, key=lambda each: (each.first_s, each.identity))


def listed(objects: list[TrackedObject]) -> list[TrackedObject]:
    """At most ``MAX_LISTED`` of them, those seen in the most frames, in the same order."""
    kept = sorted(objects, key=lambda each: -each.frames)[:MAX_LISTED]
    return sorted(kept, key=lambda each: (each.first_s, each.identity))


def _object(replayed: Replayed, track: RecordArray) -> TrackedObject:
    seconds = replayed.seconds(track['frame'])
    speed = np.hypot(track['vel_u'], track['vel_v'])
    best = int(np.argmax(np.nan_to_num(track['score'] * np.sqrt(track['w'] * track['h']))))
    ttc = track['ttc'][np.isfinite(track['ttc'])]
    order = np.searchsorted(replayed.frames['frame'], track['frame'])
    breaks = np.flatnonzero(np.diff(order) > MAX_GAP_FRAMES) + 1
    parts = tuple((float(part[0]), float(part[-1]) + replayed.interval_s) for part in np.split(seconds, breaks))
    return TrackedObject(
        identity=int(track['id'][0]), first_s=float(seconds[0]), last_s=float(seconds[-1]), frames=len(track),
        speed=_median(speed), top_speed=_top(speed), width=_median(track['w']), height=_median(track['h']),
        score=_median(track['score']), ttc_s=float(ttc.min()) if len(ttc) else float('nan'),
        best_frame=int(track['frame'][best]), best_s=float(seconds[best]), parts=parts)


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float('nan')


def _top(values: np.ndarray) -> float:
    """The 95th percentile: one jump is no speed."""
    known = values[np.isfinite(values)]
    return float(np.percentile(known, 95)) if len(known) else float('nan')
