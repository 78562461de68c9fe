"""A result folder written by hand, and the pictures it is of: every picture tells its own number."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.settings import settings
from motion_detect_ros.core.types import ByteArray
from motion_detect_ros.results.rows import CSV_HEADER, FRAMES_HEADER, TIMES_HEADER
from motion_detect_ros.results.summary import STAGES, Percentiles, Summary, write_summary
from motion_detect_ros.sources.frames import FIRST_STAMP_NS

FRAMES, FPS, WIDTH, HEIGHT = 40, 10.0, 320, 240
#: Object -> frames, and the left edge in its first one; each is 40 x 30 px and drives right at 4 px a frame.
OBJECTS = {7: (range(5, 30), 20), 12: (range(12, 39), 60), 3: (range(20, 24), 150)}
STEP_PX, BOX_W, BOX_H = 4, 40, 30
#: Top edge of each object's way.
ROWS_PX = {7: 40, 12: 100, 3: 160}
#: Patches at the bottom that tell the number of a picture in binary, lowest bit first: white is 1.
BITS, PATCH_PX = 6, 24
BIT_CENTRES = [(PATCH_PX * (bit + 1), HEIGHT - PATCH_PX) for bit in range(BITS)]


def picture(frame: int) -> ByteArray:
    """Grey, with the objects in white, and its number."""
    image = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    for identity in OBJECTS:
        if frame in OBJECTS[identity][0]:
            x, y, w, h = box_of(identity, frame)
            cv2.rectangle(image, (x, y), (x + w - 1, y + h - 1), (255, 255, 255), -1)
    for bit, (x, y) in enumerate(BIT_CENTRES):
        half, gray = PATCH_PX // 2 - 2, 255 if frame >> bit & 1 else 0
        cv2.rectangle(image, (x - half, y - half), (x + half, y + half), (gray, gray, gray), -1)
    return image


def number_of(grays: Sequence[float]) -> int:
    """Which picture has these grey levels at ``BIT_CENTRES``."""
    return sum(1 << bit for bit, gray in enumerate(grays) if gray > 128)


def box_of(identity: int, frame: int) -> tuple[int, int, int, int]:
    """x, y, w, h of an object, px."""
    frames, left = OBJECTS[identity]
    return left + STEP_PX * (frame - frames.start), ROWS_PX[identity], BOX_W, BOX_H


def stamp_ns(frame: int) -> int:
    """As an image folder gives it."""
    return FIRST_STAMP_NS + round(frame * 1e9 / FPS)


def write_pictures(folder: Path) -> Path:
    """The input: an image folder."""
    folder.mkdir(parents=True)
    for frame in range(FRAMES):
        assert cv2.imwrite(str(folder / f'{frame:04d}.png'), picture(frame))
    return folder


def write_results(folder: Path, source: str, objects: dict[int, range] | None = None, **changes: object) -> Path:
    """A result folder. objects: id -> frames with a detection; changes: other fields of the summary."""
    folder.mkdir(parents=True)
    objects = {identity: frames for identity, (frames, _) in OBJECTS.items()} if objects is None else objects
    rows = [(frame, identity) for frame in range(FRAMES) for identity, frames in objects.items() if frame in frames]
    lines = [f'{frame},{stamp_ns(frame)},{identity},{",".join(map(str, box_of(identity, frame)))},0.{80 + identity},'
             f'40.0,30.0,{"2.5" if identity == 7 else "nan"}' for frame, identity in rows]
    (folder / 'detections.csv').write_text('\n'.join([CSV_HEADER, *lines, '']))
    ego = [f'{frame},{stamp_ns(frame)},' + ('ok,1,0,2,0,1,-1' if frame else 'first_frame,,,,,,') + ',0'
           for frame in range(FRAMES)]
    (folder / 'frames.csv').write_text('\n'.join([FRAMES_HEADER, *ego, '']))
    times = [f'{frame},1,2,3,4,5,14' for frame in range(FRAMES)]
    (folder / 'times.csv').write_text('\n'.join([TIMES_HEADER, *times, '']))
    content = {
        'input': source, 'fps': FPS, 'version': '0.1.0', 'complete': True, 'damaged': None, 'announced_frames': FRAMES,
        'frames': FRAMES, 'bad_frames': 0, 'misstamped_frames': 0, 'source_frames': FRAMES, 'detections': len(rows),
        'objects': len(objects), 'ego_status': {'first_frame': 1, 'ok': FRAMES - 1}, 'image_size': (WIDTH, HEIGHT),
        'calibrated': False, 'first_stamp_ns': stamp_ns(0), 'last_stamp_ns': stamp_ns(FRAMES - 1),
        'stage_ms': {stage: Percentiles(14.0, 15.0) for stage in STAGES}, 'decode_ms': Percentiles(1.0, 1.0),
        'settings': {name: value for name, value, _ in settings(PipelineConfig())}} | changes
    write_summary(folder, Summary(**content))  # type: ignore[arg-type]
    return folder


def write_truth(path: Path) -> Path:
    """Truth: 7 and 12 as detected, 3 is nothing; 50 is never detected."""
    rows = [f'{frame},{identity},{",".join(map(str, box_of(identity, frame)))},1'
            for identity in (7, 12) for frame in OBJECTS[identity][0]]
    rows += [f'{frame},50,200,200,20,20,1' for frame in range(FRAMES)]
    path.write_text('\n'.join(['frame,id,x,y,w,h,moving', *rows, '']))
    return path
