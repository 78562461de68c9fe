"""VisDrone MOT sequences: a folder of pictures 0000001.jpg, 0000002.jpg, ... without time stamps.

Source: Zhu et al., "Detection and Tracking Meet Drones Challenge", IEEE TPAMI 2021.
"""

from __future__ import annotations

from pathlib import Path

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.frames import DEFAULT_FPS, describe_folder
from motion_detect_ros.sources.images import ImageSequence, image_files, image_folder

LAYOUT = 'a sequence folder with pictures 0000001.jpg, 0000002.jpg, ...'


def visdrone_sequence(folder: str | Path, fps: float = DEFAULT_FPS) -> ImageSequence:
    """The pictures of a sequence at ``fps`` frames/s. Raises: SourceError where the folder is something else."""
    folder = Path(folder)
    if not folder.is_dir():
        raise SourceError(f'{folder}: no such folder')
    files = image_files(folder)
    if not files or not all(file.stem.isdecimal() for file in files):
        raise SourceError(f'{folder}: found {describe_folder(folder)}; expected {LAYOUT}')
    return image_folder(folder, fps)
