"""What is to be done with one input, and how it ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.formats import DEFAULT_FORMATS
from motion_detect_ros.sources.window import Window

OK, NOTHING, UNREADABLE, PARTIAL = 0, 1, 2, 3

#: Told after each frame how many frames of the source are behind, and how many there are (None: unknown); may raise.
Watch = Callable[[int, int | None], None]


@dataclass(frozen=True)
class Job:
    """One input and where its outputs go, as absolute paths where other processes or machines do it.

    fps (1/s), topic, start_s, duration_s (s), every (frames): as the user gave them, None where not; formats: names in
    ``FORMATS``; overlay: pictures with boxes too; report: make report.html at the end; rectified: the pictures of a bag
    are, as for ``camera_of``; force: whatever the folder holds is overwritten.
    """

    path: str
    folder: Path
    config: PipelineConfig
    fps: float | None = None
    topic: str | None = None
    start_s: float | None = None
    duration_s: float | None = None
    every: int | None = None
    formats: tuple[str, ...] = DEFAULT_FORMATS
    overlay: bool = False
    report: bool = False
    rectified: bool = False
    force: bool = False

    @property
    def window(self) -> Window:
        """The part of the input that is wanted. Raises: SourceError for values out of range."""
        return Window(self.start_s or 0.0, self.duration_s, 1 if self.every is None else self.every)

    @property
    def name(self) -> str:
        """Short name, different for all jobs of one command."""
        return self.folder.name


@dataclass(frozen=True)
class Outcome:
    """How a job ended: ``exit_code`` of ``__main__`` and one ``line`` for the user; ``earlier``: in an earlier run."""

    exit_code: int
    line: str
    earlier: bool = False

    @property
    def state(self) -> str:
        """In a word or two."""
        if self.exit_code == OK:
            return 'finished earlier' if self.earlier else 'done'
        return 'partial' if self.exit_code == PARTIAL else 'failed'


class UnfinishedError(SourceError):
    """A replay ended before its input did; what it had done is kept."""


class StoppedError(Exception):
    """Raised by a ``Watch`` where nobody wants the result any more."""


#: Told of every job that ended.
Ended = Callable[[Job, Outcome], None]
