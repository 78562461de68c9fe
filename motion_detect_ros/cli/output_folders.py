"""Where results go: folders named after the inputs, inside of the one the user gives, never over what is there."""

from __future__ import annotations

import argparse
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import count
from pathlib import Path

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.live_summary import read_any_summary
from motion_detect_ros.sources.images import natural_key
from motion_detect_ros.sources.opening import source_name
from motion_detect_ros.sources.part_file import part_of

#: Name of an input whose own name holds nothing to make one from.
NAMELESS = 'input'
#: What does not belong into the name of a folder: control characters, and what shells and other systems take specially.
_ODD = re.compile(r'[^\w .,+=@-]')
_NUMBERED = re.compile(r'(.+)-([2-9]|[1-9]\d+)')


def output_path(text: str) -> Path:
    """The ``type`` of ``--output``: an empty name is a variable that is not set, not the folder one is in.

    Raises: ArgumentTypeError for it.
    """
    if not text.strip():
        raise argparse.ArgumentTypeError(f'expected a name, got {text!r}')
    return Path(text)


def folder_name(path: str) -> str:
    """The name of an input, fit for a folder: no separators, no dots at the start."""
    return _ODD.sub('_', source_name(Path(path).resolve())).strip(' .') or NAMELESS


def folders_of(inputs: Sequence[str], output: Path, several: bool = True) -> list[Path]:
    """One folder for each input, directly in ``output``, no two the same; without ``several``, ``output`` itself.

    An input keeps the folder of an earlier run, whatever inputs of the same name came before it then or do now.
    """
    if not several:
        return [output]
    present = _present(output)
    folders: dict[str, Path] = {}
    for path in inputs:
        earlier = next((folder for folder in present[folder_name(path)] if _holds(folder, path)), None)
        if earlier:
            folders[path] = earlier
    taken = set(folders.values())
    for path in inputs:
        if path not in folders:
            folders[path] = next(folder for folder in _numbered(output, path) if folder not in taken)
            taken.add(folders[path])
    return [folders[path] for path in inputs]


def _numbered(output: Path, path: str) -> Iterator[Path]:
    """The folders that an input may have: its name, and the same with numbers."""
    name = folder_name(path)
    yield output / name
    for number in count(2):
        yield output / f'{name}-{number}'


def _present(output: Path) -> defaultdict[str, list[Path]]:
    """Name of an input -> what there is in ``output`` that it may have had, the lowest number first."""
    found: defaultdict[str, list[Path]] = defaultdict(list)
    try:
        entries = sorted(output.iterdir(), key=lambda entry: natural_key(entry.name))
    except OSError:  # not there yet; else whoever writes there says so
        return found
    for entry in entries:
        found[entry.name].append(entry)
        if numbered := _NUMBERED.fullmatch(entry.name):
            found[numbered[1]].append(entry)
    return found


def _holds(folder: Path, path: str) -> bool:
    """Whether the results in a folder are of an input."""
    try:
        return Path(read_any_summary(folder).input).resolve() == Path(path).resolve()
    except SourceError:
        return False


def refuse_existing(files: Iterable[Path], force: bool) -> None:
    """Raises: SourceError where one of the files, or what an interrupted run left of it, exists, unless ``force``."""
    for file in () if force else files:
        for each in (file, part_of(file)):
            if each.exists():
                raise SourceError(f'{each}: exists; --force overwrites it')
