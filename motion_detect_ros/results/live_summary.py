"""summary.json of a replay through the nodes: counts and latencies, and what it was of."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from types import NoneType
from typing import Any

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.files import SUMMARY_NAME, write_whole
from motion_detect_ros.results.summary import Summary, known_fields, read_as, read_summary

LATENCIES = 'p50', 'p95', 'p99'
#: What leaves images out on purpose while the machine is too slow, by its setting.
LOAD = 'load.adapt'
#: The player is not said to have waited where that is less, seconds.
SHOWN_S = 0.1


@dataclass(frozen=True, kw_only=True)
class LiveSummary:
    """The fields are those of summary.json, those of ``Summary`` where they have the same name.

    ``damaged``: what is wrong with the bag; ``frames``: images of the bag; ``bad_frames``: those of them that cannot be
    read or used; ``wanted``: those that were to be answered, without bad ones, those that decimation leaves out and
    those whose stamps are not in order, None for all; ``answered``: those that were; ``left_out``: how many of the
    others by which node, ``LOAD`` or ``transport``, in playbacks that came to their end; ``held_s``: how long the
    player waited for the nodes, seconds; ``latency_ms``: from image to detections, None without answers.
    """

    input: str
    input_bytes: int | None = None
    topic: str | None = None
    rectified: bool = False
    version: str
    live: bool = True
    damaged: str | None = None
    frames: int
    source_frames: int
    bad_frames: int = 0
    wanted: int | None = None
    answered: int
    left_out: dict[str, int] = field(default_factory=dict)
    held_s: float = 0.0
    detections: int
    objects: int
    latency_ms: dict[str, float | None]
    settings: dict[str, bool | int | float | str] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether every image was answered that was to be, but for those that ``LOAD`` leaves out."""
        wanted = self.frames if self.wanted is None else self.wanted
        return self.answered + self.left_out.get(LOAD, 0) >= wanted

    @property
    def line(self) -> str:
        """It in a few words, for the user."""
        median, p95 = (self.latency_ms[name] for name in LATENCIES[:2])
        latency = '' if median is None else f', latency {median:.0f} ms median, {p95:.0f} ms p95'
        by_node = ', '.join(f'{count} by {node}' for node, count in self.left_out.items())
        left_out = f', {sum(self.left_out.values())} left out ({by_node})' if by_node else ''
        held = f', held back for {self.held_s:.1f} s' if self.held_s >= SHOWN_S else ''
        bad = f', {self.bad_frames} bad frames left out' if self.bad_frames else ''
        damage = f'; {self.damaged}' if self.damaged else ''
        return f'{self.frames} images, {self.answered} answers{left_out}{latency}{held}{bad}{damage}'


_TYPES: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(('input', 'version'), (str,)), **dict.fromkeys(('topic', 'damaged'), (str, NoneType)),
    **dict.fromkeys(('live', 'rectified'), (bool,)),
    **dict.fromkeys(('frames', 'source_frames', 'bad_frames', 'answered', 'detections', 'objects'), (int,)),
    **dict.fromkeys(('input_bytes', 'wanted'), (int, NoneType)),
    **dict.fromkeys(('latency_ms', 'left_out', 'settings'), (dict,)), 'held_s': (int, float)}


def write_live_summary(folder: Path, summary: LiveSummary) -> None:
    """Write summary.json, whole or not at all."""
    write_whole(folder / SUMMARY_NAME, json.dumps(asdict(summary), indent=2) + '\n')


def read_live_summary(folder: Path) -> LiveSummary:
    """The summary of a live replay. Raises: SourceError where there is none, or what there is is of something else."""
    return read_as(folder / SUMMARY_NAME, 'replay --live', _summary_of)


def read_any_summary(folder: Path) -> Summary | LiveSummary:
    """The summary of a replay, in process or live. Raises: SourceError where it is neither."""
    try:
        return read_live_summary(folder)
    except SourceError:
        return read_summary(folder)


def _summary_of(content: dict[str, Any]) -> LiveSummary:
    """Raises: TypeError, KeyError, ValueError, AttributeError for what is no such summary."""
    if content.get('live') is not True:
        raise ValueError('that of another kind')
    known = known_fields(content, (each.name for each in fields(LiveSummary)), _TYPES)
    latencies = {name: known['latency_ms'][name] for name in LATENCIES}
    return LiveSummary(**{**known, 'latency_ms': {
        name: None if value is None else float(value) for name, value in latencies.items()}})
