"""``docs/performance.md``: the figures of ``bench`` as markdown, and what they mean."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterable, Mapping
from typing import Any

import cv2

from motion_detect_ros.benchmarks.bench_tried import TRIED

#: What a 2-core companion computer should reach: whole pipeline by image size, ms, and shares and sums of the rest.
GOALS_MS = {'640x360': 12.0, '960x540': 20.0, '1280x720': 35.0}
FLOOR_GOAL, SPACE_GOAL = 1.5, 1.6
BEYOND_GOALS_MS = {'pipeline': 6.0, 'four nodes': 25.0, 'pipeline, load.adapt': 6.0}
WARM_GOAL_S, COLD_GOAL_S, MEMORY_GOAL_MB = 3.0, 15.0, 400.0

HEAD = '''# Performance

Written by `python -m motion_detect_ros bench --markdown docs/performance.md --json docs/performance.json`;
`make bench` prints it only, `--parts stages,floor` some of its tables. Input is the built-in flight. Times of
one run on a shared machine vary by a quarter and more; where two things are compared they take turns frame by frame,
and the figure is the median of the ratios. `test/benchmarks/test_bench_guard.py` fails where the ratio of the pipeline
to the OpenCV floor, processor time over a town with thirty movers, grows by over a quarter. *goal*: what a
companion computer of two cores should reach.
'''
ABOUT = {
    'stages': '''Compute time of every stage, decoded frame to detections; processor: time of all threads together,
which other load on the machine hardly changes. Median / 95th percentile, ms. Here, and in the tables below that name
a size, images are worked on as they are (`preprocessing.min_width_px: 0`): `visdrone` and `kitti` enlarge 640x360 to
960x540, and take as long as for that.''',
    'clips': '''The presets of the families on real clips, decoded frame to detections, beside two plain methods
(`benchmarks.plain_methods`; KLT + DBSCAN needs scikit-learn) that take turns with them frame by frame. Times to the
answer, ms; not all frames cost the same, so means count. Until ready: with the preset `visdrone` flow is computed and
objects are looked for behind the answer, for the next frame, in other threads; here every frame is waited for until
that is done too, which at 25 Hz it is long before the next one. Frames that follow each other without a pause
overlap; such a stream takes between the two. Processor: of all threads, all included. Widths: the steps of
`load.adapt`. Needs `MOTION_DETECT_DATA`.''',
    'reported': '''The two tables of the report this project implements (its figures: with a graphics card) and ours,
CPU only, on flights of the same image size with the preset of that name. Medians, ms; that of `visdrone` has the flow
behind the answer (section Real clips), in processor only.''',
    'floor': '''The whole pipeline against the OpenCV calls it cannot do without, at the same settings, called plainly,
one after the other: grey and working size, corners at full resolution, Lucas-Kanade over the whole pyramid forward and
backward, warp, DIS forward and backward. The pipeline saves on corners and tracking and runs both directions of
the flow in parallel, so the ratio may come near 1.''',
    'background': '''The same pipeline with a background in three dimensions (`background.model: epipolar`) and a planar
one.''',
    'one_thread': '''For reading the figures of this page on another computer: 960x540 of the built-in flight with one
thread (`load.threads: 1`, OpenCV too), median of each stage, ms, and the OpenCV calls of the section above alone.

Best is to run `python -m motion_detect_ros bench --no-nodes --parts one_thread` there. Without the computer at hand,
multiply by the ratio of its single-core speed to that of this machine, and expect to be wrong by a third: published
comparisons use other programs. One that can be repeated anywhere is `sysbench cpu --threads=1 --time=60 run`: 4050
events a second here (AMD EPYC, virtual machine), published 2737 for a Raspberry Pi 5 and 1478 for a Pi 4
(https://leoncode.co.uk/articles/raspberry-pi-benchmarks), so ratios of 1.5 and 2.7. It counts prime numbers by
division and neither reads memory nor uses vector instructions, which is most of what a detector does: an Intel Xeon
with 3064 took about as long as this. Of further cores a second one helps most: with two threads the preset `visdrone`
answers in a little over a third of the time that one takes (section Real clips). No other computer has been
measured.''',
    'curves': '''What a frame costs as its content grows. `x^b`: least squares of log time on log x. Objects: cars of
43 pixels on 1600x900, found: those of the first ten frames (plain cars, of which the preset `default` sees two edges
each at first: 43 candidates for 25 cars). Neurons: ART2 alone on 30000 vectors. Cells: `grid_px` 16
to 2 on the built-in flight. Processor: all threads together, which other load hardly changes.''',
    'codec': '''A 1280x720 bgr8 image to a message and back. Reading is a view of the bytes; other encodings are
converted, which takes longer.''',
    'transport': '''From the stamp of a 960x540 picture, taken just before it is published, to its detections in the
process that published it. Compute: sum of the medians that the nodes report themselves; beyond: what is left of the
median latency, waiting for a busy stage included. All processes share the cores. Fast DDS profile and allocator
settings as shipped (`bridge/transport.py`, `allocator.py`).''',
    'transport_clip': '''The same with the pictures and the preset of the first of the real clips above, at 20 Hz. With
`load.adapt` the nodes lower the working width while images come faster than they work (the steps: section Real
clips).''',
    'start': '''From the start of the process `pipeline` to its first message, while pictures come, and its memory
then: 2.2 to 3.7 s in twelve starts, 1.5 in another hour, by when Fast DDS's announcements meet. Where
`colcon build` has not compiled the kernels, other processes do at the first start, one for each core up to four.''',
    'memory': '''Resident memory of `pipeline`, fed with 960x540 at 20 Hz. Most of it is libraries. Of the size of an
image it holds (preset `visdrone`, 25 Hz, `tracemalloc`) the grey images of the last second and their halves, 32 of each
at most (26: 17 MB), the paths of the points (2.7 MB), three masks and a buffer of the flow (1.8 MB): 23 MB, as many
after 50 frames as after 110; without points 17 grey images at most. Within a frame come at most 10 MB on top, 19 grey
images (`test/core/test_memory.py` bounds what is held, and lets a frame make 30).''',
    'soak': '''`python -m motion_detect_ros.benchmarks.soak --minutes 30 -o out/soak` and the same with `--real --preset
visdrone -o out/soak_real` (beside calculations of idle priority), put here by `bench --soak
out/soak/summary.json out/soak_real/summary.json`: `pipeline` under a steady stream of 960x540 at 20 Hz, of a real clip
in a loop of 120 pictures. Memory after the first quarter and at the end; dropped: by the node, as its diagnostics
count; lost: in transport.''',
}


def machine() -> dict[str, Any]:
    """What the figures were taken on."""
    return {'cores': os.cpu_count(), 'architecture': platform.machine(), 'python': platform.python_version(),
            'opencv': cv2.__version__, 'opencv_threads': cv2.getNumThreads()}


def markdown(figures: Mapping[str, Any]) -> str:
    """The document; sections of parts that were not measured are left out."""
    on = figures['machine']
    lines = [HEAD, f'{on["cores"]} cores of {on["architecture"]}, Python {on["python"]}, OpenCV {on["opencv"]} with '
                   f'{on["opencv_threads"]} threads.', '']
    for name, (title, table) in SECTIONS.items():
        if name in figures:
            lines += [f'## {title}', '', ABOUT[name], '', *table(figures[name]), '']
    return '\n'.join([*lines, TRIED])


def _stages(stages: Mapping[str, list[dict[str, Any]]]) -> list[str]:
    names = [row['name'] for row in next(iter(stages.values()))]
    return _table(('image', *names, 'goal'), ((
        size, *(f'{row["p50"]:.1f} / {row["p95"]:.1f}' for row in rows), f'{GOALS_MS.get(size, math.nan):.0f}')
        for size, rows in stages.items()))


def _clips(clips: list[dict[str, Any]]) -> list[str]:
    if not clips:
        return ['Not measured: no clips.']
    return _table(('clip', '', 'mean, ms', 'median', 'p95', 'p95 / median', 'until ready, mean', 'processor, mean'), (
        (f'`{clip["clip"]}`, {clip["size"]}' if not place else '', row['name'],
         *(f'{row[name]:.1f}' for name in ('mean', 'p50', 'p95')), f'{row["p95"] / row["p50"]:.2f}',
         *(f'{row[name]:.1f}' for name in ('ready', 'processor')))
        for clip in clips for place, row in enumerate(clip['rows'])))


def _reported(tables: list[dict[str, Any]]) -> list[str]:
    names = [row['name'] for row in tables[0]['ours_ms']]
    rows = []
    for table in tables:
        published = [*(f'{value:.0f}' for value in table['published_ms']), '']
        rows.append((f'{table["name"]}, published', *published))
        rows.append((f'{table["name"]}, ours, {table["size"]}', *(f'{row["p50"]:.1f}' for row in table['ours_ms'])))
    return _table(('', *names), rows)


def _one_thread(rows: list[dict[str, Any]]) -> list[str]:
    names = [row['name'] for row in rows[0]['ours_ms'][:-1]]
    return _table(('preset', *names, 'OpenCV calls'), (
        (row['preset'], *(f'{each["p50"]:.1f}' for each in row['ours_ms'][:-1]), f'{row["floor_ms"]:.1f}')
        for row in rows))


def _ratios(of: str, to: str, goal: float) -> Any:
    return lambda rows: _table(('image', f'{of}, ms', f'{to}, ms', 'ratio', 'goal'), (
        (row['name'], f'{row["ms"]:.1f}', f'{row["base_ms"]:.1f}', f'{row["ratio"]:.2f}', f'{goal:g}') for row in rows))


def _codec(rows: list[dict[str, Any]]) -> list[str]:
    return _table(('', 'median, ms', 'p95, ms'), (
        (row['name'], f'{row["p50"]:.2f}', f'{row["p95"]:.2f}') for row in rows))


def _curves(curves: list[dict[str, Any]]) -> list[str]:
    lines: list[str] = []
    for curve in curves:
        series = list(curve['slopes'])
        lines += [f'### {curve["name"].capitalize()}', '',
                  f'![time against {curve["unit"]}](images/cost_{curve["name"]}.png)', '',
                  ', '.join(f'{name} ~ x^{exponent:.2f}' for name, exponent in curve['slopes'].items()) + '.', '']
        lines += _table((curve['unit'], *(f'{name}, ms' for name in series), f'{curve["counted"]} found'), (
            (f'{point["x"]:.3g}' if point['x'] < 1000 else f'{point["x"]:.0f}',
             *(f'{point["ms"][name]:.1f}' for name in series), str(point['note'])) for point in curve['points']))
        lines.append('')
    return lines[:-1]


def _transport(rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return ['Not measured: no clips.']
    return _table(('graph', 'Hz', 'median, ms', 'p95', 'p99', 'compute', 'beyond', 'goal', 'lost'), ((
        row['timing']['name'], f'{row["rate_hz"]:.0f}',
        *(f'{row["timing"][name]:.1f}' for name in ('p50', 'p95', 'p99')),
        f'{row["compute_ms"]:.1f}', f'{row["beyond_ms"]:.1f}', f'{BEYOND_GOALS_MS[row["timing"]["name"]]:.0f}',
        f'{row["lost"]} of {row["images"]}') for row in rows))


def _start(row: dict[str, Any]) -> list[str]:
    return _table(('kernels', 'seconds', 'goal', 'MB'), (
        ('in the cache of numba', f'{row["warm_s"]:.1f}', f'{WARM_GOAL_S:.0f}', f'{row["warm_mb"]:.0f}'),
        ('compiled first', f'{row["cold_s"]:.1f}', f'{COLD_GOAL_S:.0f}', f'{row["cold_mb"]:.0f}')))


def _memory(row: dict[str, Any]) -> list[str]:
    return _table(('after pictures', 'MB', 'goal'), (
        (str(row[count]), f'{row[size]:.0f}', f'{MEMORY_GOAL_MB:.0f}')
        for count, size in (('early_frames', 'early_mb'), ('frames', 'mb'))))


def _soak(rows: list[dict[str, Any]]) -> list[str]:
    names = ('pictures from', 'preset', 'minutes', 'pictures', 'answered', 'dropped', 'lost', 'memory, MB',
             'growth, MB/h', 'median, ms', 'p95')
    return _table(names, [(
        row['pictures'], row['preset'], f'{row["minutes"]:.0f}', str(row['sent']), str(row['answered']),
        str(row['dropped']), str(row['lost']), f'{row["memory_first_mb"]:.1f} to {row["memory_last_mb"]:.1f}',
        f'{row["growth_mb_per_hour"]:.1f}', f'{row["latency_p50_ms"]:.1f}', f'{row["latency_p95_ms"]:.1f}')
        for row in rows])


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    cells = [list(head), *(list(row) for row in rows)]
    return [f'| {" | ".join(cells[0])} |', '|---' * len(cells[0]) + '|',
            *(f'| {" | ".join(row)} |' for row in cells[1:])]


#: Part -> title and what makes its table.
SECTIONS: dict[str, tuple[str, Any]] = {
    'stages': ('Stages', _stages),
    'clips': ('Real clips', _clips),
    'reported': ('The report\'s tables', _reported),
    'floor': ('Against the floor', _ratios('pipeline', 'OpenCV calls', FLOOR_GOAL)),
    'one_thread': ('Other computers', _one_thread),
    'background': ('Planar and three-dimensional background', _ratios('3-D', 'planar', SPACE_GOAL)),
    'curves': ('How it grows', _curves),
    'codec': ('Codec', _codec),
    'transport': ('From image to detections', _transport),
    'transport_clip': ('From image to detections, real pictures', _transport),
    'start': ('Start', _start),
    'memory': ('Memory', _memory),
    'soak': ('For long', _soak),
}
