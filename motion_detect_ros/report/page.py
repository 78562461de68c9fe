"""report.html of one replay: film, objects, timeline, camera, times, settings, and errors against truth."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.settings import settings
from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.report import charts
from motion_detect_ros.report.embedding import as_json, packed, packed_plotly, plotly_source, render
from motion_detect_ros.report.judged import PICTURE_IOU, Judged, Mistake
from motion_detect_ros.report.objects import TrackedObject
from motion_detect_ros.report.pictures import Cutout, FilmPlan, Pictures
from motion_detect_ros.report.replayed import Replayed
from motion_detect_ros.results.evaluation import WARM_UP_FRAMES
from motion_detect_ros.results.summary import STAGES

#: A stamp before this is no time of day, s since 1970.
_EARLIEST_DATE_S = 1_000_000_000
_THUMBNAIL_PX, _MISTAKE_PX = (136, 92), (320, 240)
_MISSED_BGR, _FALSE_BGR = (107, 59, 255), (2, 162, 240)
_SCALE = 'Viridis'


@dataclass(frozen=True)
class Parts:
    """What a page is made of; ``all_objects`` includes those that are not listed."""

    replayed: Replayed
    all_objects: Sequence[TrackedObject]
    objects: Sequence[TrackedObject]
    plan: FilmPlan
    pictures: Pictures
    judged: Judged | None


def cutouts(objects: Sequence[TrackedObject], replayed: Replayed, judged: Judged | None) -> Iterator[Cutout]:
    """The pieces of pictures that a page shows: one of each object, one of each mistake."""
    for each in objects:
        boxes = replayed.of_frame(each.best_frame)
        box = boxes[boxes['id'] == each.identity][0]
        yield Cutout(_key(each), each.best_frame, (box['x'], box['y'], box['w'], box['h']), 0.35, _THUMBNAIL_PX)
    for mistake in judged.mistakes if judged else ():
        color = _MISSED_BGR if mistake.missed else _FALSE_BGR
        yield Cutout(_key(mistake), mistake.frame, mistake.box, 1.0, _MISTAKE_PX, color)


def page(parts: Parts) -> str:
    """The whole page as HTML."""
    replayed, summary = parts.replayed, parts.replayed.summary
    figures = _figures(parts)
    default = {name: (value, metadata) for name, value, metadata in settings(PipelineConfig())}
    rows = [_setting(name, value, *default.get(name, ('', {}))) for name, value in summary.settings.items()]
    data = {
        'film': {'fps': parts.plan.fps, 'size': list(summary.image_size), 'frames': list(parts.pictures.film_frames),
                 'seconds': _film_seconds(parts)},
        'boxes': _boxes(parts), 'truth': _truth_boxes(parts), 'markers': _markers(parts.objects),
        'colors': {each.identity: each.color for each in parts.all_objects}}
    body = as_json(data)[:-1] + ',"charts":{' + ','.join(
        f'"{name}":{figure.to_json()}' for name, figure in figures.items()) + '}}'
    return render(
        'page.html', ('sort.js', 'page.js'), (plotly_source(),),
        name=Path(summary.input).name or summary.input, input=summary.input, version=summary.version,
        facts=list(_facts(replayed)), cards=list(_cards(parts)), notes=list(_notes(parts)),
        film=_film(parts.pictures), objects=[_row(each, parts.pictures) for each in parts.objects],
        frames=summary.frames, charts=figures, markers=list(_markers(())), truth=_truth(parts),
        counts=list(_counts(replayed)), stages=list(_stages(replayed)),
        changed=[row for row in rows if row['changed']], unchanged=[row for row in rows if not row['changed']],
        data=packed(body), plotly=packed_plotly())


def _figures(parts: Parts) -> dict[str, Any]:
    replayed = parts.replayed
    figures: dict[str, Any] = {}
    if parts.objects:
        figures['timeline'] = charts.timeline(parts.objects, replayed.duration_s)
        figures['heat'] = charts.heat_map(
            replayed.boxes, replayed.summary.image_size, replayed.interval_s, parts.pictures.background)
    if len(replayed.frames) > 1:
        figures['ego'] = charts.ego_motion(replayed)
        if len(replayed.times):
            figures['times'] = charts.stage_times(replayed)
        if parts.judged:
            figures['errors'] = charts.mistakes(replayed, parts.judged)
    return figures


def _facts(replayed: Replayed) -> Iterator[str]:
    summary = replayed.summary
    began = summary.first_stamp_ns / NANOSECONDS
    if began > _EARLIEST_DATE_S:
        yield f'{datetime.fromtimestamp(began, UTC):%Y-%m-%d %H:%M:%S} UTC'
    yield f'{replayed.duration_s:.1f} s'
    if replayed.interval_s:
        yield f'{1 / replayed.interval_s:.3g} frames/s'
    if all(summary.image_size):
        yield '{} x {} px'.format(*summary.image_size)
    if summary.topic:
        yield f'topic {summary.topic}'
    if summary.start_s is not None or summary.duration_s is not None:
        yield f'from {summary.start_s or 0:g} s' + (f' for {summary.duration_s:g} s' if summary.duration_s else '')
    if summary.every not in (None, 1):
        yield f'one of {summary.every} frames'


def _cards(parts: Parts) -> Iterator[tuple[str, str]]:
    summary = parts.replayed.summary
    yield f'{summary.objects:,}', 'moving objects'
    yield f'{summary.detections:,}', f'boxes in {summary.frames:,} frames'
    total = summary.stage_ms['total'].p50
    if total:
        next_ms = 1e3 * parts.replayed.interval_s
        yield f'{total:.0f} ms', 'of processor time a frame' + (
            f', the next one comes after {next_ms:.0f} ms' if next_ms else '')
    lost = summary.bad_frames + summary.misstamped_frames
    yield f'{lost:,}', 'frames lost'
    estimated = int(parts.replayed.usable().sum())
    if summary.frames > 1:
        yield f'{100 * estimated / (summary.frames - 1):.0f} %', 'frames with the camera\'s motion known'
    if parts.judged and (score := parts.judged.main).frames:
        yield f'{score.f1:.2f}', f'F1 (precision {score.precision:.2f}, recall {score.recall:.2f})'


def _notes(parts: Parts) -> Iterator[str]:
    summary = parts.replayed.summary
    if not summary.complete:
        yield 'The replay was interrupted: this page shows what was done until then.'
    if summary.damaged:
        yield f'The input is damaged: {summary.damaged}'
    yield from (f'Warning: {words}' for words in summary.warnings)
    if not len(parts.replayed.frames):
        yield 'No frame was processed.'
    if parts.pictures.missing:
        yield f'No pictures here, as the input could not be read again: {parts.pictures.missing}'
    elif len(parts.pictures.film_frames) < len(parts.plan.frames):
        yield (f'The input could be read again only in part: the film shows {len(parts.pictures.film_frames)} of '
               f'{len(parts.plan.frames)} frames.')
    if len(parts.plan.frames) < len(parts.replayed.frames):
        step = round(len(parts.replayed.frames) / len(parts.plan.frames))
        yield f'A long recording: the film shows one of {step} frames.'
    if len(parts.objects) < len(parts.all_objects):
        yield f'Of {len(parts.all_objects):,} objects the {len(parts.objects)} seen in the most frames are listed.'


def _film(pictures: Pictures) -> dict[str, Any] | None:
    if not pictures.film_frames:
        return None
    return {'pictures': len(pictures.film_frames), 'content': base64.b64encode(pictures.film).decode('ascii')}


def _row(each: TrackedObject, pictures: Pictures) -> dict[str, Any]:
    return {**asdict(each), 'life_s': each.life_s, 'color': each.color, 'picture': pictures.cutouts.get(_key(each))}


def _film_seconds(parts: Parts) -> list[float]:
    rows = np.searchsorted(parts.replayed.frames['frame'], parts.pictures.film_frames)
    # the page takes moments within a microsecond for the same
    return [round(value, 6) for value in parts.replayed.seconds(parts.replayed.frames['frame'][rows]).tolist()]


def _boxes(parts: Parts) -> list[list[list[float]]]:
    """Of each picture of the film the boxes: id, x, y, w, h, velocity."""
    return [[[int(box['id']), *(_rounded(box[name]) for name in ('x', 'y', 'w', 'h', 'vel_u', 'vel_v'))]
             for box in parts.replayed.of_frame(frame)] for frame in parts.pictures.film_frames]


def _truth_boxes(parts: Parts) -> list[list[list[float]]] | None:
    """Of each picture of the film the truth: x, y, w, h, whether it counts, found."""
    if not parts.judged:
        return None
    boxes, counts, found = parts.judged.truth.boxes, parts.judged.counts, parts.judged.found
    here = {frame: np.flatnonzero(boxes['frame'] == frame) for frame in parts.pictures.film_frames}
    return [[[*(_rounded(boxes[row][name]) for name in ('x', 'y', 'w', 'h')), int(counts[row]),
              int(found[row])] for row in here[frame]] for frame in parts.pictures.film_frames]


def _markers(objects: Sequence[TrackedObject]) -> dict[str, Any]:
    """The colours of the timeline's bars, by what they can tell."""
    bars = [each for each in objects for _ in each.parts]
    return {'object': {'color': [each.color for each in bars]},
            'speed': _scaled('speed in px/s', [each.speed for each in bars]),
            'score': _scaled('score', [each.score for each in bars])}


def _scaled(title: str, values: list[float]) -> dict[str, Any]:
    return {'color': [None if math.isnan(value) else round(value, 3) for value in values], 'colorscale': _SCALE,
            'showscale': True, 'colorbar': {'title': {'text': title, 'side': 'right'}, 'thickness': 12, 'len': 1,
                                            'lenmode': 'fraction', 'outlinewidth': 0}}


def _truth(parts: Parts) -> dict[str, Any] | None:
    judged = parts.judged
    if not judged:
        return None
    wanted = ('Moving: only what is labelled as moving is wanted. All: standing objects too.'
              if judged.truth.says_what_moves else
              'These labels do not say what moves: every labelled object is wanted.')
    scores = [{'counting': name, 'iou': f'{iou:g}', 'score': score} for (name, iou), score in judged.scores.items()
              if score.frames]
    skipped = (f'The first {WARM_UP_FRAMES} frames are not counted.' if scores else
               f'No frame is counted: the first {WARM_UP_FRAMES} never are, and there are no more.')
    galleries = [('Missed most often', 'Nothing was missed.', True), ('False most often', 'No box was false.', False)]
    return {
        'path': str(judged.path), 'form': judged.truth.form, 'scores': scores,
        'counting': f'{wanted} {skipped} Chart and pictures: overlap (IoU) of {PICTURE_IOU:g}.',
        'galleries': [(title, none, [_mistake(each, parts) for each in judged.mistakes if each.missed is missed])
                      for title, none, missed in galleries]}


def _mistake(each: Mistake, parts: Parts) -> dict[str, Any]:
    row = np.searchsorted(parts.replayed.frames['frame'], each.frame)
    seconds = float(parts.replayed.seconds(parts.replayed.frames['frame'][row]))
    kind = 'truth' if each.missed else 'object'
    return {'title': f'{kind} {each.identity}', 'seconds': seconds, 'picture': parts.pictures.cutouts.get(_key(each)),
            'text': f'in {each.count} of {each.frames} frames, here at {seconds:.1f} s'}


def _counts(replayed: Replayed) -> Iterator[tuple[str, int]]:
    summary = replayed.summary
    lost = summary.bad_frames + summary.misstamped_frames
    yield 'frames of the input', summary.source_frames
    yield 'processed', summary.frames
    yield 'unreadable or unusable', summary.bad_frames
    yield 'left out, stamp seen already, late or out of range', summary.misstamped_frames
    left_out = 'left out on request' + ('' if summary.complete else ', or read ahead when it was interrupted')
    yield left_out, max(0, summary.source_frames - summary.frames - lost)
    for status, count in summary.ego_status.items():
        if status not in ('ok', 'first_frame'):
            yield f'camera\'s motion unknown: {status.replace("_", " ")}', count


def _stages(replayed: Replayed) -> Iterator[tuple[str, Any]]:
    yield 'read and decode (elapsed time)', replayed.summary.decode_ms
    for stage in STAGES:
        yield stage.replace('ego_', 'ego-').replace('_', ' '), replayed.summary.stage_ms[stage]


def _setting(name: str, value: Any, default: Any, metadata: Any) -> dict[str, Any]:
    unit = f' ({metadata["unit"]})' if metadata.get('unit') else ''
    return {'name': name, 'value': _told(value), 'default': _told(default), 'changed': value != default,
            'doc': metadata.get('doc', '') + unit}


def _told(value: Any) -> str:
    return json.dumps(value) if isinstance(value, bool) or value == '' else str(value)


def _rounded(value: float) -> float:
    return round(float(value), 1) if np.isfinite(value) else 0.0


def _key(each: TrackedObject | Mistake) -> Hashable:
    return ('object', each.identity) if isinstance(each, TrackedObject) else ('mistake', each.missed, each.identity)
