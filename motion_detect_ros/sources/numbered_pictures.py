"""Truth whose labels number pictures, as an input of pictures counts its frames.

An excerpt keeps the names of its pictures, and labels number them by these: picture 0000101.jpg of a VisDrone sequence
is 101 in its annotation, and frame 0 of a folder that begins with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.bags import is_bag
from motion_detect_ros.sources.images import image_files
from motion_detect_ros.sources.kitti import IMAGE_FOLDER, is_kitti_drive
from motion_detect_ros.sources.truth import Truth, load_truth


def truth_of_input(path: str | Path, source: str | Path | None) -> Truth:
    """The part of ``load_truth`` that has pictures in an input, with frames counted as the input counts them.

    VisDrone, MOT Challenge and KITTI labels go by the numbers that the pictures of a folder or a KITTI drive are named
    by. Frames stay as they are counted from the first label on where that says nothing: for a CSV, for an input that is
    not known, gone or something else, for names that are no numbers or begin below the labels' first, and for labels
    that were counted anew for an excerpt: some of them are of earlier pictures than the first, and all have a picture
    by their place.
    Raises: SourceError as ``load_truth``, and for labels of other pictures.
    """
    truth = load_truth(path)
    numbers = _numbers(Path(source)) if source is not None else []
    if truth.first is None or not numbers or min(numbers) < truth.first or not len(truth.boxes):
        return truth
    labelled = truth.boxes['frame']
    if labelled.min() + truth.first < min(numbers) and labelled.max() < len(numbers):
        return truth
    position = {number - truth.first: index for index, number in enumerate(numbers)}
    kept = truth.boxes[np.isin(labelled, list(position))].copy()
    if not len(kept):
        raise SourceError(
            f'{path}: expected labels of pictures {min(numbers)} to {max(numbers)} ({source}), got '
            f'{labelled.min() + truth.first} to {labelled.max() + truth.first}')
    kept['frame'] = [position[frame] for frame in kept['frame'].tolist()]
    return replace(truth, boxes=kept)


def _numbers(source: Path) -> Sequence[int]:
    """The numbers that name the pictures of an input, in their order; empty where it has none of these."""
    try:
        if not source.is_dir() or is_bag(source):
            return []
        folder = source / IMAGE_FOLDER / 'data' if is_kitti_drive(source) else source
        stems = [file.stem for file in image_files(folder)]
    except OSError:  # what is wrong with it is said where it is opened
        return []
    numbers = [int(stem) for stem in stems if stem.isdecimal()]
    return numbers if len(set(numbers)) == len(stems) else []
