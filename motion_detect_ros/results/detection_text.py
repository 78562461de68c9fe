"""Detections as lines of text: detections.csv, and the format of the MOT Challenge."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from motion_detect_ros.results.detection_writer import FrameDetections, finite
from motion_detect_ros.results.files import CSV_NAME, MOT_NAME, TextFile
from motion_detect_ros.results.metrics import boxes_of
from motion_detect_ros.results.rows import CSV_HEADER, csv_rows, with_commas


class CsvDetections(TextFile):
    """detections.csv: a row for each detection."""

    def __init__(self, folder: Path, source: str) -> None:
        """Raises: SourceError where the file cannot be written. source: not used."""
        super().__init__(folder / CSV_NAME, CSV_HEADER)

    def write(self, found: FrameDetections) -> None:
        """Add the rows of one frame."""
        self.add(*csv_rows(found.frame, found.stamp_ns, found.records))


#: Where that format has the top left corner of a picture: x, y; sizes are the same.
FIRST_PIXEL = np.array([1.0, 1.0, 0.0, 0.0])


class MotDetections(TextFile):
    """mot.txt: a line for each detection as trackers hand them in; without a third dimension, which is -1.

    Format: https://motchallenge.net/instructions. Frames and pixels count from 1 there: the top left corner of a
    picture is (1, 1), (0, 0) with us.
    """

    def __init__(self, folder: Path, source: str) -> None:
        """Raises: SourceError where the file cannot be written. source: not used."""
        super().__init__(folder / MOT_NAME)

    def write(self, found: FrameDetections) -> None:
        """Add the lines of one frame."""
        records = finite(found.records)
        figures = np.column_stack([boxes_of(records) + FIRST_PIXEL, records['score']])
        self.add(*(f'{found.frame + 1},{identity},{numbers},-1,-1,-1'
                   for identity, numbers in zip(records['id'].tolist(), with_commas(figures), strict=True)))
