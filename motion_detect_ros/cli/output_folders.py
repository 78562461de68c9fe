"""Where results go: folders named after the inputs, inside of the one the user gives, never over what is there."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.bags import PART_SUFFIX

#: Name of an input whose own name holds nothing to make one from.
NAMELESS = 'input'
#: What does not belong into the name of a folder: control characters, and what shells and other systems take specially.
_ODD = re.compile(r'[^\w .,+=@-]')


def folder_name(path: str) -> str:
    """The name of an input without its suffix, fit for a folder: no separators, no dots at the start."""
    return _ODD.sub('_', Path(path).resolve().stem).strip(' .') or NAMELESS


def folders_of(inputs: Sequence[str], output: Path, several: bool = True) -> list[Path]:
    """One folder for each input, directly in ``output``, no two the same; without ``several``, ``output`` itself."""
    if not several:
        return [output]
    folders: list[Path] = []
    for path in inputs:
        name = folder_name(path)
        number, folder = 1, output / name
        while folder in folders:
            number += 1
            folder = output / f'{name}-{number}'
        folders.append(folder)
    return folders


def refuse_existing(files: Iterable[Path], force: bool) -> None:
    """Raises: SourceError where one of the files, or what an interrupted run left of it, exists, unless ``force``."""
    for file in () if force else files:
        for each in (file, file.with_name(file.name + PART_SUFFIX)):
            if each.exists():
                raise SourceError(f'{each}: exists; --force overwrites it')
