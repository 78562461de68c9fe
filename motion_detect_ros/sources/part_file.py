"""Files that appear under their name when they are complete, and are ``.part`` until then."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType
from typing import Self

PART_SUFFIX = '.part'


def part_of(path: Path) -> Path:
    """Where a file is while it is being written."""
    return path.with_name(path.name + PART_SUFFIX)


class PartFile(ABC):
    """A file under construction; use as a context manager.

    It is written to ``part_path`` and renamed to ``path`` when complete; left by an exception, the part stays.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.part_path = path, part_of(path)

    @abstractmethod
    def finish_part(self) -> None:
        """Close the file properly under its part name."""

    def close(self) -> None:
        """Close the file and give it its name."""
        self.finish_part()
        self.part_path.replace(self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.finish_part()
