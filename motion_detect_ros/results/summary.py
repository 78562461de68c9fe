"""summary.json: one input's replay in numbers, and what it takes to open the input again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from types import NoneType
from typing import Any, Self, TypeVar

import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.files import SUMMARY_NAME, write_whole

#: Fields that say, where they are given, that only part of the source is wanted.
WINDOW_FIELDS = ('start_s', 'duration_s', 'every')
STAGES = ('preprocessing', 'ego_motion', 'optical_flow', 'clustering', 'total')
_Read = TypeVar('_Read')


@dataclass(frozen=True)
class Percentiles:
    """Median and 95th percentile of a time, ms; NaN would be no JSON, so nothing measured is 0."""

    p50: float = 0.0
    p95: float = 0.0

    @classmethod
    def of(cls, times_ms: Sequence[float]) -> Self:
        """Of times in ms."""
        if not len(times_ms):
            return cls()
        p50, p95 = np.percentile(np.asarray(times_ms, np.float64), (50, 95))
        return cls(round(float(p50), 3), round(float(p95), 3))


@dataclass(frozen=True, kw_only=True)
class Summary:
    """One input's replay in numbers; the fields are those of summary.json.

    ``frames``: processed; ``misstamped_frames``: left out, as their stamps were seen already, late or out of range;
    ``source_frames``: of the source, those left out and unreadable ones included. ``fps`` (1/s), ``topic``, ``start_s``
    and ``duration_s`` (s), ``every`` (frames): as the user gave them, None where not; ``rectified``: the pictures of a
    bag are; ``input_bytes``: None where the size is not known. ``formats``: of the detections, names in
    ``results.formats.FORMATS``; ``overlay``: whether detections.mcap holds the pictures with boxes; ``tuned``: at the
    end, the settings that may follow the scene (``core.self_tuning.Tuned``); ``warnings``: what was not used, and why.
    """

    input: str
    input_bytes: int | None = None
    fps: float | None = None
    topic: str | None = None
    start_s: float | None = None
    duration_s: float | None = None
    every: int | None = None
    rectified: bool = False
    formats: list[str] = field(default_factory=list)
    overlay: bool = False
    version: str
    complete: bool
    damaged: str | None
    announced_frames: int | None
    frames: int
    bad_frames: int
    misstamped_frames: int
    source_frames: int
    detections: int
    objects: int
    ego_status: dict[str, int]
    image_size: tuple[int, int]
    calibrated: bool
    first_stamp_ns: int
    last_stamp_ns: int
    stage_ms: dict[str, Percentiles]
    decode_ms: Percentiles
    settings: dict[str, bool | int | float | str]
    tuned: dict[str, int | float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)


#: What values of summary.json are, by name of the field.
_NUMBER: tuple[type, ...] = (int, float)
_TYPES: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(('input', 'version'), (str,)), **dict.fromkeys(('topic', 'damaged'), (str, NoneType)),
    **dict.fromkeys(('frames', 'bad_frames', 'misstamped_frames', 'source_frames', 'detections', 'objects',
                     'first_stamp_ns', 'last_stamp_ns'), (int,)),
    **dict.fromkeys(('input_bytes', 'announced_frames', 'every'), (int, NoneType)),
    **dict.fromkeys(('fps', 'start_s', 'duration_s'), (*_NUMBER, NoneType)),
    **dict.fromkeys(('complete', 'overlay', 'calibrated', 'rectified'), (bool,)),
    **dict.fromkeys(('ego_status', 'settings', 'tuned', 'stage_ms', 'decode_ms'), (dict,)),
    **dict.fromkeys(('formats', 'warnings'), (list,))}


def takes_part(content: Mapping[str, Any]) -> bool:
    """Whether only part of the source was wanted: by its window, or as the settings process the first ``keep`` of every
    ``of`` frames. content: fields of a summary, some or all.
    """
    settings = content.get('settings')
    keep, of = ([settings.get(f'load.decimation_{name}') for name in ('keep', 'of')]
                if isinstance(settings, Mapping) else (None, None))
    decimated = isinstance(keep, int) and isinstance(of, int) and keep < of
    return decimated or any(content.get(name) is not None for name in WINDOW_FIELDS)


def write_summary(folder: Path, summary: Summary) -> None:
    """Write summary.json, whole or not at all."""
    write_whole(folder / SUMMARY_NAME, json.dumps(asdict(summary), indent=2) + '\n')


def read_summary(folder: Path) -> Summary:
    """The summary of a result folder; a field that this version does not know is ignored.

    Raises: SourceError where there is none, or what there is is not of a replay in process.
    """
    return read_as(folder / SUMMARY_NAME, 'a replay', _summary_of)


def read_as(path: Path, kind: str, made_of: Callable[[dict[str, Any]], _Read]) -> _Read:
    """What is made of a summary.json. kind: of what it should be one, in words. Raises: SourceError."""
    try:
        return made_of(json.loads(path.read_text(encoding='utf-8')))
    except OSError as error:
        raise SourceError(f'{path}: expected the summary of {kind}: {error.strerror}') from None
    except SourceError as error:
        raise SourceError(f'{path}: {error}') from None
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise SourceError(f'{path}: expected the summary of {kind}, got {type(error).__name__}: {error}') from None


def known_fields(
    content: dict[str, Any], names: Iterable[str], types: Mapping[str, tuple[type, ...]],
) -> dict[str, Any]:
    """Those of a summary that have these names. Raises: TypeError where one is of other types than expected."""
    known = {name: content[name] for name in names if name in content}
    for name, expected in types.items():
        if name in known and not isinstance(known[name], expected):
            raise TypeError(f'{name} {known[name]!r}')
    return known


def _summary_of(content: dict[str, Any]) -> Summary:
    """Raises: TypeError, KeyError, ValueError, AttributeError for what is no summary; SourceError for a live one."""
    if isinstance(content, dict) and content.get('live') is True:
        raise SourceError('expected the summary of a replay in process, got that of replay --live, which has neither '
                          'ego-motion nor times')
    known = known_fields(content, (each.name for each in fields(Summary)), _TYPES)
    width, height = known['image_size']
    times = {stage: _percentiles(values) for stage, values in known['stage_ms'].items()}
    return Summary(**{
        **known, 'image_size': (int(width), int(height)), 'decode_ms': _percentiles(known['decode_ms']),
        'stage_ms': {stage: times[stage] for stage in STAGES}})


def _percentiles(content: dict[str, Any]) -> Percentiles:
    """Raises: TypeError, ValueError."""
    return Percentiles(**{name: float(value) for name, value in content.items()})
