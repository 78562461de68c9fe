"""The formats that detections are written in, by name."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from motion_detect_ros.core.errors import BackendError, SourceError
from motion_detect_ros.results.detection_bag import BagDetections
from motion_detect_ros.results.detection_coco import CocoDetections
from motion_detect_ros.results.detection_parquet import ParquetDetections
from motion_detect_ros.results.detection_text import CsvDetections, MotDetections
from motion_detect_ros.results.detection_writer import DetectionWriter
from motion_detect_ros.results.files import (
    BAG_NAME,
    COCO_NAME,
    CSV_NAME,
    FRAMES_NAME,
    MOT_NAME,
    PARQUET_NAME,
    REPORT_NAME,
    SUMMARY_NAME,
    TIMES_NAME,
)
from motion_detect_ros.results.live_summary import LiveSummary, read_any_summary
from motion_detect_ros.results.summary import Summary
from motion_detect_ros.sources.part_file import part_of


@dataclass(frozen=True)
class Format:
    """``name`` of the file; ``make``: starts one in a folder, with the input's name; ``package``: what it needs."""

    name: str
    make: Callable[[Path, str], DetectionWriter]
    package: str | None = None


CSV, MCAP = 'csv', 'mcap'
FORMATS = {
    CSV: Format(CSV_NAME, CsvDetections),
    MCAP: Format(BAG_NAME, BagDetections),
    'parquet': Format(PARQUET_NAME, ParquetDetections, 'pyarrow'),
    'mot': Format(MOT_NAME, MotDetections),
    'coco': Format(COCO_NAME, CocoDetections),
}
DEFAULT_FORMATS = CSV, MCAP


def parse_formats(text: str) -> tuple[str, ...]:
    """Formats from names with commas between, in the order of ``FORMATS``; csv is always one, as others read it.

    Raises: SourceError for a name that is none, BackendError where a package is missing.
    """
    wanted = {CSV, *(word.strip() for word in text.split(','))}
    unknown = sorted(wanted - FORMATS.keys())
    if unknown:
        raise SourceError(f'--formats: expected some of {",".join(FORMATS)}, got {",".join(unknown) or "nothing"}')
    for name, package in ((name, FORMATS[name].package) for name in FORMATS if name in wanted):
        if package and importlib.util.find_spec(package) is None:
            raise BackendError(f'--formats {name}: expected the package {package}; pip install {package}')
    return tuple(name for name in FORMATS if name in wanted)


def output_names(formats: Sequence[str]) -> tuple[str, ...]:
    """Names of all files that a replay with these formats leaves in its folder."""
    return *(FORMATS[name].name for name in formats), SUMMARY_NAME, FRAMES_NAME, TIMES_NAME


def outputs_of(summary: Summary | LiveSummary) -> tuple[str, ...]:
    """Names of all files that the replay which this is the summary of left in its folder."""
    formats = DEFAULT_FORMATS if isinstance(summary, LiveSummary) else summary.formats
    return output_names([name for name in formats if name in FORMATS])


def output_files(folder: Path) -> tuple[Path, ...]:
    """Every file that a replay may write, rename or remove in its folder."""
    files = [folder / name for name in (*output_names([*FORMATS]), REPORT_NAME)]
    return *files, *map(part_of, files)


def clear(folder: Path, names: Sequence[str]) -> None:
    """Make room for the outputs ``names``: remove those of earlier replays, finished or not. Raises: OSError."""
    remove_others(folder, names)
    for file in (folder / name for name in names):
        file.unlink(missing_ok=True)
        part_of(file).unlink(missing_ok=True)


def remove_others(folder: Path, names: Sequence[str]) -> None:
    """Remove what an earlier replay left besides ``names``: its outputs, by its summary, and the report of them.

    They would be of another run. Raises: OSError where a file cannot be removed.
    """
    try:
        summary = read_any_summary(folder)
    except SourceError:
        earlier: tuple[str, ...] = ()
    else:
        earlier = outputs_of(summary)
    for path in (folder / name for name in (*earlier, REPORT_NAME) if name not in names):
        path.unlink(missing_ok=True)
        part_of(path).unlink(missing_ok=True)
