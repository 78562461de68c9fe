"""The inputs that the words of a command line mean: paths, patterns, folders and trees of inputs."""

from __future__ import annotations

import glob
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from motion_detect_ros.cli.batch.listing import LIST_NAME
from motion_detect_ros.cli.demo_files import RECORD_NAME, VIDEO
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.files import BAG_NAME, SUMMARY_NAME
from motion_detect_ros.sources.bag_reader import BAG_SUFFIXES
from motion_detect_ros.sources.bags import METADATA_NAME, is_bag, is_recording
from motion_detect_ros.sources.images import image_files, natural_key
from motion_detect_ros.sources.kitti import is_kitti_drive
from motion_detect_ros.sources.opening import looks_like_source
from motion_detect_ros.sources.part_file import part_of
from motion_detect_ros.tuning.study import STORAGE_NAME


@dataclass(frozen=True)
class Inputs:
    """``paths``: absolute, no two the same; ``several``: the words may mean more than one, even if it is one today;
    ``left_out``: what in the folders given is none of them though it might be, in words.
    """

    paths: tuple[str, ...]
    several: bool
    left_out: tuple[str, ...] = ()

    def tell_left_out(self) -> None:
        """On standard error, a line each."""
        for words in self.left_out:
            print(f'caution: {words}', file=sys.stderr)


def expand_inputs(words: Sequence[str], output: Path) -> Inputs:
    """Paths stay as they are; a pattern (``*``, ``?``, ``[...]``, ``**``) gives the inputs that it matches, a folder
    that is no input itself all that are in it, at any depth.

    output: where results go; nothing in there is taken for an input of a folder above it, nor are the detections that
    an earlier replay left anywhere.
    Raises: SourceError for a pattern without a match, a folder whose bags are all left out, an empty word, or a link,
    of the output too, that leads to itself.
    """
    if not all(words):  # would be the current folder
        raise SourceError('inputs: expected a path, got nothing')
    for given in (*map(Path, words), output):
        try:
            given.resolve()
        except RuntimeError:  # up to Python 3.12
            raise SourceError(f'{given}: expected a file or folder, got a link that leads to itself') from None
    found: dict[Path, None] = {}
    left_out: dict[str, None] = {}
    several = len(words) > 1
    for word in words:
        path = Path(word)
        if not path.exists() and glob.has_magic(word):
            several = True
            found |= dict.fromkeys(_matches(word, output.absolute()))
        elif path.is_dir() and not is_source_folder(path):
            inside = [*_inside(path.absolute(), _skipped(path, output.absolute()))]
            if not inside and any(each.suffix in BAG_SUFFIXES for each in path.iterdir()):
                raise SourceError(f'{path}: expected bags, videos or folders of pictures, found only what is hidden or '
                                  'a result of an earlier replay; name the file itself to replay it')
            several = several or bool(inside)
            found |= dict.fromkeys(inside or [path.absolute()])
            left_out |= dict.fromkeys(_left_out(inside, output.absolute()))
        else:
            found[path.absolute()] = None
            left_out |= dict.fromkeys(_left_out([path.absolute()] if path.is_dir() else [], output.absolute()))
    return Inputs(tuple(map(str, _distinct(found))), several, tuple(left_out))


def is_source_folder(folder: Path) -> bool:
    """Whether the folder is one input: a recorded bag, a KITTI drive, or pictures without bags and videos."""
    try:
        if (folder / METADATA_NAME).is_file() or is_kitti_drive(folder):
            return True
        if any(entry.is_file() and looks_like_source(entry) for entry in folder.iterdir() if not _is_result(entry)):
            return is_recording(folder)
        return bool(image_files(folder))
    except OSError:  # what is wrong with it is said when it is opened
        return True


def _left_out(inputs: Sequence[Path], output: Path) -> Iterator[str]:
    """In words, inputs in folders of pictures, and pictures beside recordings: neither is taken with the other."""
    for folder in dict.fromkeys(path if path.is_dir() else path.parent for path in inputs):
        try:
            pictures, taken = image_files(folder), folder in inputs
            of_demo, known = (folder / RECORD_NAME).is_file(), taken and (is_bag(folder) or is_kitti_drive(folder))
            if not pictures or of_demo or known:
                continue
            within = [each for entry in sorted(folder.iterdir()) if taken and entry.is_dir() and entry.name[0] != '.'
                      for each in _inside(entry, output)]
        except OSError:  # what is wrong with it is said when it is opened
            continue
        if within:
            more = f' and {len(within) - 1} more' if within[1:] else ''
            yield (f'{folder}: its pictures are one input, so the folders in it are not looked into; '
                   f'left out: {within[0].relative_to(folder)}{more}')
        elif not taken:
            yield f'{folder}: {len(pictures)} pictures beside recordings are left out'


def size_of(path: str) -> int | None:
    """Bytes in a file, or in all files of a folder but what replays and searches left; None where they cannot be looked
    at.
    """
    try:
        if Path(path).is_file():
            return Path(path).stat().st_size
        files = [each for each in Path(path).rglob('*') if each.is_file()]
        results = {file.parent for file in files if file.name in (SUMMARY_NAME, STORAGE_NAME, LIST_NAME)} - {Path(path)}
        sizes = [file.stat().st_size for file in files if results.isdisjoint(file.parents)]
        return sum(sizes) if sizes else None
    except OSError:
        return None


def _inside(folder: Path, skipped: Path | None, seen: set[Path] | None = None) -> Iterator[Path]:
    """The inputs in a folder at any depth, in natural order; what is hidden is left out.

    What cannot be looked at is one of them, so that it is listed with its error. seen: real folders that were searched:
    links may lead back to one.
    """
    seen, real = set() if seen is None else seen, folder.resolve()
    if folder == skipped or real in seen:
        return
    seen.add(real)
    if is_source_folder(folder):
        yield folder
        return
    for entry in sorted(folder.iterdir(), key=lambda each: natural_key(each.name)):
        if entry.name.startswith('.'):
            continue
        try:
            is_folder, is_input = entry.is_dir(), not _is_result(entry) and looks_like_source(entry)
        except OSError:
            is_folder, is_input = False, True
        if is_folder:
            yield from _inside(entry, skipped, seen)
        elif is_input:
            yield entry


def _matches(pattern: str, output: Path) -> list[Path]:
    """The inputs that a pattern means; what lies inside of one, as the files of a bag's folder, is not another."""
    matches = sorted((Path(match).absolute() for match in glob.glob(pattern, recursive=True)),  # noqa: PTH207
                     key=lambda path: [natural_key(part) for part in path.parts])
    if not matches:
        raise SourceError(f'{pattern}: no file or folder matches')
    fixed = next(parent for parent in Path(pattern).parents if not glob.has_magic(str(parent)))
    skipped = _skipped(fixed, output)
    inputs: dict[Path, None] = {}
    for match in matches:
        if skipped not in match.parents and not any(parent in inputs for parent in match.parents):
            inputs |= dict.fromkeys(_inside(match, skipped) if match.is_dir() else _single(match))
    if not inputs:
        raise SourceError(f'{pattern}: expected bags, videos or folders of pictures, got {len(matches)} other matches')
    return [*inputs]


def _single(file: Path) -> list[Path]:
    return [file] if looks_like_source(file) and not _is_result(file) else []


def _skipped(searched: Path, output: Path) -> Path | None:
    """The folder that is not looked into: that of the outputs, unless it is what is searched or contains it."""
    return output if searched.absolute() in output.parents else None


def _is_result(file: Path) -> bool:
    """Whether a replay or demo wrote this bag, a demo this film, or a search this data base; the folder around it may
    hold inputs too.
    """
    bag, of_demo = file.name in (BAG_NAME, part_of(Path(BAG_NAME)).name), file.with_name(RECORD_NAME).is_file()
    return file.name == STORAGE_NAME or (
        bag and (of_demo or file.with_name(SUMMARY_NAME).is_file())) or (file.name == VIDEO and of_demo)


def _distinct(paths: Iterable[Path]) -> list[Path]:
    """Without those that are another one by another name (links, ``a/../b``)."""
    distinct: dict[Path, Path] = {}
    for path in paths:
        distinct.setdefault(path.resolve(), path)
    return [*distinct.values()]
