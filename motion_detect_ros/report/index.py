"""index.html over the result folders of many inputs: what each holds, and a link to its report."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.report.embedding import check_libraries, render
from motion_detect_ros.report.own_pages import check_replaceable
from motion_detect_ros.report.replayed import read_replayed
from motion_detect_ros.results.files import REPORT_NAME, SUMMARY_NAME, write_whole
from motion_detect_ros.results.summary import Summary, read_summary

INDEX_NAME = 'index.html'


@dataclass(frozen=True)
class Entry:
    """One result folder: ``summary``, None where it cannot be read, as ``trouble`` then says; ``link`` to its report,
    relative to the index, '' where it has none.
    """

    name: str
    link: str
    summary: Summary | None
    trouble: str

    @property
    def duration_s(self) -> float:
        """From the first to the last processed frame; 0 where stamps went back."""
        summary = self.summary
        return max(0, summary.last_stamp_ns - summary.first_stamp_ns) / NANOSECONDS if summary else 0.0


def make_index(folder: Path, output: Path | None = None) -> Path:
    """Write index.html over all replays in ``folder`` and below; returns where it is.

    Raises: SourceError where there is no replay, or another file than an earlier index would be replaced; BackendError
    where a library is missing; OSError.
    """
    check_libraries(['jinja2'])
    path = output or folder / INDEX_NAME
    check_replaceable(path)
    entries = sorted(_entries(folder, path.parent), key=lambda entry: entry.name)
    if not entries:
        raise SourceError(f'{folder}: expected folders of replays, found no {SUMMARY_NAME} in or below it')
    known = [entry.summary for entry in entries if entry.summary]
    cards = [(f'{len(entries):,}', 'inputs'), (f'{sum(each.frames for each in known):,}', 'frames'),
             (_minutes(sum(entry.duration_s for entry in entries)), 'recorded'),
             (f'{sum(each.objects for each in known):,}', 'moving objects'),
             (f'{sum(bool(entry.trouble) for entry in entries):,}', 'with something to look at')]
    write_whole(path, render('index.html', ('sort.js',), title=folder.resolve().name, folder=str(folder),
                             entries=entries, cards=cards))
    return path


def _entries(folder: Path, base: Path) -> Iterator[Entry]:
    for file in folder.rglob(SUMMARY_NAME):
        place, report = file.parent, file.with_name(REPORT_NAME)
        name = str(place.relative_to(folder)) if place != folder else place.resolve().name
        link = quote(os.fsencode(os.path.relpath(report, base))) if report.is_file() else ''
        try:
            summary = read_summary(place)
            if not summary.complete:
                with suppress(SourceError):  # it was killed before it wrote anything else
                    summary = read_replayed(place).summary
        except SourceError as error:
            yield Entry(name, link, None, str(error))
        else:
            yield Entry(name, link, summary, '; '.join(_trouble(summary)))


def _trouble(summary: Summary) -> Iterator[str]:
    if not summary.complete:
        yield 'interrupted'
    if summary.damaged:
        yield summary.damaged
    if summary.bad_frames:
        yield f'{summary.bad_frames} unreadable frames'
    if summary.misstamped_frames:
        yield f'{summary.misstamped_frames} frames with wrong stamps'
    if not summary.frames:
        yield 'no frames'
    yield from map(str, summary.warnings)


def _minutes(seconds: float) -> str:
    return f'{seconds:.0f} s' if seconds < 120 else f'{seconds / 60:.0f} min'
