"""The files of a result folder: their names, and how they come to be, whole or as ``.part``."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.part_file import PartFile, part_of

CSV_NAME, BAG_NAME, SUMMARY_NAME = 'detections.csv', 'detections.mcap', 'summary.json'
FRAMES_NAME, TIMES_NAME = 'frames.csv', 'times.csv'
PARQUET_NAME, MOT_NAME, COCO_NAME = 'detections.parquet', 'mot.txt', 'coco.json'
REPORT_NAME = 'report.html'
#: What a replay writes unless told otherwise.
OUTPUT_NAMES = CSV_NAME, BAG_NAME, SUMMARY_NAME, FRAMES_NAME, TIMES_NAME


class TextFile(PartFile):
    """A text file under construction, line by line; use as a context manager.

    It is written to ``<path>.part`` and renamed when complete; left by an exception, the part stays with every line
    that was added. Lines reach the disk at once, and whole: those added together that find no room are taken back.
    """

    def __init__(self, path: Path, header: str = '') -> None:
        """Raises: SourceError where the file cannot be written."""
        super().__init__(path)
        try:
            self._stream = self.part_path.open('wb', buffering=0)
        except OSError as error:
            raise SourceError(f'{self.part_path}: cannot be written: {error.strerror}') from None
        if header:
            self.add(header)

    def add(self, *lines: str) -> None:
        """Add lines. Raises: OSError where the disk is full."""
        data, start = ''.join([f'{line}\n' for line in lines]).encode(), self._stream.tell()
        try:
            while data:
                data = data[self._stream.write(data):]
        except OSError:
            self._stream.truncate(start)
            self._stream.seek(start)
            raise

    def finish_part(self) -> None:
        """Close the file under its part name."""
        self._stream.close()


def write_whole(path: Path, text: str) -> None:
    """Write a small file, whole or not at all. Raises: OSError."""
    part = part_of(path)
    try:
        part.write_text(text, encoding='utf-8', errors='backslashreplace')  # names may be no UTF-8
        part.replace(path)
    except OSError as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        error.filename = str(path)  # not a name that nobody gave
        raise
