"""The guard against losing accuracy: a fast part of the clips, and the F1 each may not fall under.

A floors file names clips, how many of their first frames are used, and F1 at IoU 0.3 and 0.5 (moving objects) that was
measured, less ``SLACK``.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from motion_detect_ros.benchmarks.accuracy_clips import Clip, ClipRun, read_clips
from motion_detect_ros.benchmarks.accuracy_record import Figures
from motion_detect_ros.core.errors import SourceError

#: Measured F1 less this is the floor: other machines and OpenCV versions round otherwise.
SLACK = 0.03


@dataclass(frozen=True)
class Floor:
    """``frames``: how many of the clip's first frames; the F1 they must reach."""

    clip: str
    frames: int
    f1_30: float
    f1_50: float

    def failures(self, found: Figures) -> list[str]:
        """One line for each F1 under its floor."""
        pairs = (('0.3', found.f1_30, self.f1_30), ('0.5', found.f1_50, self.f1_50))
        return [f'{self.clip}, first {self.frames} frames: F1 at IoU {iou} is {f1:.3f}, floor {floor:.3f}'
                for iou, f1, floor in pairs if f1 < floor]


def read_floors(path: Path) -> list[Floor]:
    """Raises: SourceError for a file that is missing, unreadable or empty."""
    try:
        floors = [Floor(**entry) for entry in json.loads(path.read_text(encoding='utf-8'))['floors']]
    except OSError as error:
        raise SourceError(f'{path}: floors cannot be read: {error.strerror}') from None
    except (ValueError, KeyError, TypeError) as error:
        raise SourceError(f'{path}: expected floors (clip, frames, f1_30, f1_50), got {error}') from None
    if not floors:
        raise SourceError(f'{path}: expected at least one floor, got none')
    return floors


def floor_clips(data: Path, floors: Sequence[Floor]) -> list[Clip]:
    """The part of the clips that the floors name, in their order."""
    return [dataclasses.replace(read_clips(data, [floor.clip])[0], limit=floor.frames) for floor in floors]


def renewed(floors: Sequence[Floor], runs: Sequence[ClipRun]) -> list[Floor]:
    """The floors that the runs allow: measured less ``SLACK``."""
    measured = [Figures.of(run, 'moving') for run in runs]
    return [Floor(floor.clip, floor.frames, round(max(0.0, found.f1_30 - SLACK), 3),
                  round(max(0.0, found.f1_50 - SLACK), 3))
            for floor, found in zip(floors, measured, strict=True)]


def write_floors(path: Path, floors: Sequence[Floor]) -> None:
    """As ``read_floors`` reads them."""
    content = {'floors': [dataclasses.asdict(floor) for floor in floors]}
    path.write_text(json.dumps(content, indent=1) + '\n', encoding='utf-8')
