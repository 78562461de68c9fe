"""Files that appear under their name when they are complete, and are ``.part`` until then."""

from __future__ import annotations

import fcntl
import os
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

PART_SUFFIX = '.part'


def part_of(path: Path) -> Path:
    """Where a file is while it is being written."""
    return path.with_name(path.name + PART_SUFFIX)


def locked_file(path: Path, flags: int = 0) -> int:
    """Descriptor of a file, made where it is not there, with a lock (``flock``) that ends with it: no other process has
    it, nor has it given the file another name meanwhile. Without one where the file system has no locks.

    flags: of ``os.open``, besides. Raises: BlockingIOError where another process has locked it, OSError.
    """
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT | flags, 0o666)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(file)
            raise
        except OSError:  # a file system without locks
            return file
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file), path.stat()):
                return file
        os.close(file)  # the one before has just taken it away


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
