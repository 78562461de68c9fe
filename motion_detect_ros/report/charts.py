"""The charts of a report, as Plotly figures. Time runs in seconds since the first frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.types import DoubleArray, EgoStatus, RecordArray
from motion_detect_ros.report.judged import Judged
from motion_detect_ros.report.objects import TrackedObject
from motion_detect_ros.report.replayed import Replayed
from motion_detect_ros.results.rows import TIMES_HEADER

#: More points than this are averaged in groups before they are drawn.
MAX_POINTS = 1500
#: Cells of the heat map across the picture.
HEAT_COLUMNS = 96
ROW_PX, MIN_ROWS = 17, 4
STAGE_COLORS = {'preprocessing': '#9db4c8', 'ego_motion': '#2a7de1', 'optical_flow': '#12a594', 'clustering': '#f0a202'}
_INK, _GRID, _ALERT, _SECOND = '#1f2a37', '#e6eaf0', '#d6336c', '#f0a202'
_FONT = 'system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif'
_TIME_TITLE = 'time in s'
#: Status of frames that later motions start from, though they have none themselves.
_ANEW = [status.name.lower() for status in (EgoStatus.FIRST_FRAME, EgoStatus.TIME_JUMP, EgoStatus.SIZE_CHANGE)]


def timeline(objects: Sequence[TrackedObject], duration_s: float) -> go.Figure:
    """A row for each object, bars where it was seen; ``customdata``: id, from, to, speed, top speed, score, frames."""
    bars = [(row, each, part) for row, each in enumerate(objects) for part in each.parts]
    figure = go.Figure(go.Bar(
        orientation='h', y=[row for row, _, _ in bars], base=[part[0] for _, _, part in bars],
        x=[part[1] - part[0] for _, _, part in bars], width=0.72, marker_color=[each.color for _, each, _ in bars],
        customdata=[[each.identity, *part, each.speed, each.top_speed, each.score, each.frames]
                    for _, each, part in bars],
        hovertemplate='<b>object %{customdata[0]}</b><br>%{customdata[1]:.2f} to %{customdata[2]:.2f} s'
                      '<br>speed %{customdata[3]:.0f} px/s, up to %{customdata[4]:.0f}'
                      '<br>score %{customdata[5]:.2f}, in %{customdata[6]} frames<extra></extra>'))
    _style(figure, 62 + ROW_PX * max(MIN_ROWS, len(objects)), duration_s)
    figure.update_layout(barmode='overlay', bargap=0, hovermode='closest', margin={'l': 64, 't': 34, 'b': 12})
    figure.update_xaxes(side='top')
    figure.update_yaxes(
        range=[max(MIN_ROWS, len(objects)) - 0.4, -0.6], tickvals=list(range(len(objects))), fixedrange=True,
        ticktext=[str(each.identity) for each in objects], showgrid=False)
    return figure


def heat_map(boxes: RecordArray, size: tuple[int, int], interval_s: float, background: str) -> go.Figure:
    """How long moving objects covered each part of the picture, s; background: the data URL of a picture."""
    width, height = size
    heat = coverage(boxes, width, height, HEAT_COLUMNS) * interval_s
    cell = width / heat.shape[1]
    centres = np.arange(max(heat.shape)) * cell + cell / 2
    figure = go.Figure(go.Heatmap(
        z=np.where(heat > 0, heat.round(3), np.nan), x=centres[:heat.shape[1]], y=centres[:heat.shape[0]],
        colorscale=[[0, 'rgba(255,214,0,0.45)'], [0.5, 'rgba(244,81,30,0.75)'], [1, 'rgba(142,0,82,0.9)']],
        colorbar={'title': {'text': 's', 'side': 'right'}, 'thickness': 12, 'outlinewidth': 0}, hoverongaps=False,
        zmin=0, hovertemplate='covered for %{z:.2f} s<extra></extra>'))
    _style(figure, 360)
    figure.update_xaxes(range=[0, width], visible=False, constrain='domain')
    figure.update_yaxes(range=[height, 0], visible=False, scaleanchor='x', constrain='domain')
    figure.update_layout(margin={'l': 4, 'r': 4, 't': 8, 'b': 8}, plot_bgcolor='#eef1f5', hovermode='closest')
    if background:
        figure.add_layout_image(source=background, xref='x', yref='y', x=0, y=0, sizex=width, sizey=height,
                                sizing='stretch', layer='below', opacity=0.75)
    return figure


def coverage(boxes: RecordArray, width: int, height: int, columns: int) -> DoubleArray:
    """(rows, columns) counts of boxes (x, y, w, h, px) over each cell of a grid of square cells on the picture."""
    cell = max(width, 1) / columns
    rows = max(1, round(height / cell))
    known = boxes[np.isfinite(boxes['x'] + boxes['y'] + boxes['w'] + boxes['h'])]
    left, right = (np.clip(edge / cell + 0.5, 0, columns).astype(int)
                   for edge in (known['x'], known['x'] + known['w']))
    top, bottom = (np.clip(edge / cell + 0.5, 0, rows).astype(int) for edge in (known['y'], known['y'] + known['h']))
    left, top = np.minimum(left, columns - 1), np.minimum(top, rows - 1)
    right, bottom = np.maximum(right, left + 1), np.maximum(bottom, top + 1)
    steps = np.zeros((rows + 1, columns + 1))
    for row, column, sign in ((top, left, 1), (top, right, -1), (bottom, left, -1), (bottom, right, 1)):
        np.add.at(steps, (row, column), sign)
    return steps.cumsum(0).cumsum(1)[:-1, :-1]


def ego_motion(replayed: Replayed) -> go.Figure:
    """Shift of the picture, turn about the optical axis, approach; marks where they are unknown."""
    seconds, (shift_x, shift_y, turn, zoom) = replayed.seconds(replayed.frames['frame']), camera_motion(replayed)
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    lines = ((1, 'right', shift_x, '#2a7de1', 'px/s'), (1, 'down', shift_y, '#12a594', 'px/s'),
             (2, 'turn', turn, '#7c4dff', 'degrees/s'), (3, 'zoom', zoom, _SECOND, '%/s'))
    for row, name, values, color, unit in lines:
        x, y = thinned(seconds, values)
        figure.add_scatter(x=x, y=y, name=name, line={'color': color, 'width': 1.4}, row=row, col=1, mode='lines',
                           hovertemplate=f'{name} %{{y:.2f}} {unit}<extra></extra>', showlegend=row == 1)
    lost = ~replayed.usable() & (replayed.frames['ego_status'] != 'first_frame')
    if lost.any():
        figure.add_scatter(
            x=seconds[lost], y=np.zeros(int(lost.sum())), mode='markers', name='no estimate', row=1, col=1,
            marker={'symbol': 'x', 'color': _ALERT, 'size': 7}, text=replayed.frames['ego_status'][lost],
            hovertemplate='no estimate: %{text}<extra></extra>')
    _style(figure, 360, replayed.duration_s)
    for row, title in enumerate(('shift<br>px/s', 'turn<br>°/s', 'zoom<br>%/s'), 1):
        figure.update_yaxes(title_text=title, row=row, col=1, nticks=5)
    figure.update_xaxes(title_text=_TIME_TITLE, row=3, col=1)
    return figure


def camera_motion(replayed: Replayed) -> tuple[DoubleArray, DoubleArray, DoubleArray, DoubleArray]:
    """How the picture moves: its centre right and down, px/s, clockwise turn, degrees/s, enlargement, %/s; each (N,),
    NaN where unknown.
    """
    frames, step = replayed.frames, motion_steps_s(replayed)
    x, y = ((length - 1) / 2 for length in replayed.summary.image_size)
    shift_x = frames['m00'] * x + frames['m01'] * y + frames['m02'] - x
    shift_y = frames['m10'] * x + frames['m11'] * y + frames['m12'] - y
    turn = np.degrees(np.arctan2(frames['m10'] - frames['m01'], frames['m00'] + frames['m11']))
    zoom = np.sqrt(np.abs(frames['m00'] * frames['m11'] - frames['m01'] * frames['m10'])) - 1
    return shift_x / step, shift_y / step, turn / step, 100 * zoom / step


def motion_steps_s(replayed: Replayed) -> DoubleArray:
    """(N,) seconds that the ego-motion of each processed frame spans, NaN where unknown.

    It starts at the last frame with a motion, or at a later one where everything began anew; where that is longer ago
    than a motion may span, at the frame before.
    """
    seconds, usable = replayed.seconds(replayed.frames['frame']), replayed.usable()
    limit_s = replayed.summary.settings.get('ego_motion.max_gap_s')
    limit_s = limit_s if isinstance(limit_s, int | float) else PipelineConfig().ego_motion.max_gap_s
    begins_anew = np.isin(replayed.frames['ego_status'], _ANEW)
    steps, start_s = np.full(len(seconds), np.nan), np.nan
    for row, now_s in enumerate(seconds):
        if now_s - start_s > limit_s:
            start_s = seconds[row - 1]
        if usable[row] and now_s > start_s:
            steps[row] = now_s - start_s
        if usable[row] or begins_anew[row]:
            start_s = now_s
    return steps


def stage_times(replayed: Replayed) -> go.Figure:
    """What each stage took, one above the other, ms; a line where the next frame came."""
    times, figure = replayed.times, go.Figure()
    rows = np.isin(replayed.frames['frame'], times['frame'])
    seconds = replayed.seconds(replayed.frames['frame'][rows])
    for name in TIMES_HEADER.split(',')[2:-1]:
        x, y = thinned(seconds, times[name][:len(seconds)])
        figure.add_scatter(x=x, y=y, name=name.replace('_', '-' if name == 'ego_motion' else ' '), mode='lines',
                           stackgroup='stages', line={'width': 0}, fillcolor=STAGE_COLORS.get(name),
                           hovertemplate='%{y:.1f} ms')
    _style(figure, 300, replayed.duration_s)
    total = times['total'][np.isfinite(times['total'])]
    interval_ms = 1e3 * replayed.interval_s
    if interval_ms:
        figure.add_scatter(
            x=[0, replayed.duration_s], y=[interval_ms, interval_ms], mode='lines', hoverinfo='skip',
            line={'color': _ALERT, 'width': 1.5, 'dash': 'dash'}, name=f'next frame ({interval_ms:.0f} ms)')
    top = max(float(np.percentile(total, 97)) * 1.3 if len(total) else 1.0, 1.0)
    figure.update_yaxes(title_text='processor time, ms a frame', range=[0, max(top, min(1.15 * interval_ms, 3 * top))])
    figure.update_xaxes(title_text=_TIME_TITLE)
    figure.update_layout(hovermode='x unified')
    return figure


def mistakes(replayed: Replayed, judged: Judged) -> go.Figure:
    """Missed objects (down) and false boxes (up) of each frame; ``customdata``: the time."""
    seconds = replayed.seconds(replayed.frames['frame'])
    figure = go.Figure()
    for name, values, color in (('false boxes', judged.false_boxes, _SECOND), ('missed', -judged.misses, _ALERT)):
        x, y = thinned(seconds, values)
        figure.add_bar(x=x, y=y, name=name, marker_color=color, customdata=np.abs(y).round(2), marker_line_width=0,
                       hovertemplate=f'{name}: %{{customdata}} at %{{x:.2f}} s<extra></extra>')
    _style(figure, 240, replayed.duration_s)
    figure.update_layout(barmode='relative', bargap=0, hovermode='closest')
    down, up = int(judged.misses.max(initial=0)), int(judged.false_boxes.max(initial=0))
    step = max(1, -(-(down + up) // 5))
    ticks = [*range(-(down // step) * step, up + 1, step)]
    figure.update_yaxes(title_text='missed | false', zerolinecolor=_INK, tickvals=ticks,
                        ticktext=[str(abs(tick)) for tick in ticks])
    figure.update_xaxes(title_text=_TIME_TITLE)
    return figure


def thinned(x: DoubleArray, y: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """Two (N,) arrays, or the means of groups of neighbours where N is over ``MAX_POINTS``; unknown ones left out."""
    group = -(-len(x) // MAX_POINTS) or 1
    if group == 1:
        return x, y
    whole = len(x) // group * group
    known = np.isfinite(y[:whole]).reshape(-1, group)
    total = np.where(known, y[:whole].reshape(-1, group), 0.0).sum(1)
    mean = np.divide(total, known.sum(1), out=np.full(len(total), np.nan), where=known.any(1))
    return x[:whole].reshape(-1, group).mean(1), mean


def _style(figure: go.Figure, height_px: int, duration_s: float | None = None) -> None:
    """The look that all charts share; duration_s: how far time runs."""
    axis: dict[str, Any] = {'gridcolor': _GRID, 'zerolinecolor': _GRID, 'linecolor': _GRID, 'automargin': False}
    figure.update_layout(
        template='none', height=height_px, font={'family': _FONT, 'size': 12, 'color': _INK}, paper_bgcolor='#fff',
        plot_bgcolor='#fff', margin={'l': 64, 'r': 16, 't': 30, 'b': 40}, dragmode='zoom', hovermode='x',
        legend={'orientation': 'h', 'x': 0, 'y': 1.0, 'yanchor': 'bottom', 'traceorder': 'normal'},
        hoverlabel={'font': {'family': _FONT}})
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis)
    if duration_s is not None:
        figure.update_xaxes(range=[0, max(duration_s, 1e-3)])
