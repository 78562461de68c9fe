"""The worst frames of a clip as pictures, read again from the input that its summary.json names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2

from motion_detect_ros.cli.contact_sheet import Tile, contact_sheet
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.error_pictures import caption, draw_verdict, worst_frames
from motion_detect_ros.results.evaluation import ClipEvaluation
from motion_detect_ros.results.live_summary import LiveSummary, read_any_summary
from motion_detect_ros.results.metrics import NO_BOXES
from motion_detect_ros.sources.opening import open_source

#: Bad frames come in runs; those chosen are at least this share of the counted ones apart.
APART_SHARE = 1 / 15


def write_worst(clip: ClipEvaluation, counting: str, iou: float, wanted: int, folder: Path) -> Iterator[Path]:
    """Write ``<clip>_<frame>.png`` for the ``wanted`` frames with most errors of a clip's only run; yields each path.

    Raises: SourceError where the input is not there any more, the pictures cannot be written, or would be among it.
    """
    (run, file), = clip.files.items()
    verdicts = {frame: clip.verdict(run, counting, iou, frame) for frame in clip.frames}
    apart = max(1, round(APART_SHARE * len(verdicts)))
    chosen = worst_frames({frame: verdict.errors for frame, verdict in verdicts.items()}, wanted, apart)
    if not chosen:
        return
    summary = read_any_summary(file.parent)
    fps = None if isinstance(summary, LiveSummary) else summary.fps
    source = Path(summary.input).resolve()
    if source.is_dir() and source in (folder.resolve(), *folder.resolve().parents):
        raise SourceError(f'{folder}: expected another folder for the pictures than the input itself; choose another '
                          '--output')
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SourceError(f'{folder}: cannot be made a folder for the pictures: {error.strerror}') from None
    for frame in open_source(summary.input, fps, summary.topic):
        if frame.index in chosen:
            verdict = verdicts[frame.index]
            picture = draw_verdict(frame.image, clip.found[run].boxes.get(frame.index, NO_BOXES), verdict)
            path = folder / f'{clip.name}_{frame.index:06d}.png'
            tile = Tile(picture, f'{clip.name}, {caption(frame.index, verdict)}')
            if not cv2.imwrite(str(path), contact_sheet([tile], 1, picture.shape[1])):
                raise SourceError(f'{path}: the picture cannot be written')
            yield path
        if frame.index >= chosen[-1]:
            return
