"""Read bags: an MCAP, db3 or ROS 1 file, or the folder that ``ros2 bag record`` makes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import yaml

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.frames import describe_folder, describe_special
from motion_detect_ros.sources.images import natural_key
from motion_detect_ros.sources.mcap_file import MAGIC as MCAP_MAGIC
from motion_detect_ros.sources.mcap_file import McapFile
from motion_detect_ros.sources.missing_part import MissingPart
from motion_detect_ros.sources.raw import BagStorage, RawMessage, TopicInfo, merged, printable
from motion_detect_ros.sources.rosbag1_storage import ROSBAG1_MAGIC, Rosbag1Storage
from motion_detect_ros.sources.rosbag_storage import SQLITE_MAGIC, RosbagStorage

METADATA_NAME = 'metadata.yaml'
#: Of the files of bags.
BAG_SUFFIXES = ('.mcap', '.db3', '.bag')


def is_bag(path: Path) -> bool:
    """True for what looks like a bag by its content (or, where damaged or empty, by its name)."""
    if path.is_dir():
        return (path / METADATA_NAME).is_file() or bool(_storage_files(path))
    try:
        if path.suffix in BAG_SUFFIXES:
            return True
        return path.is_file() and _magic(path).startswith((MCAP_MAGIC, SQLITE_MAGIC, ROSBAG1_MAGIC))
    except OSError:  # nobody can say
        return False


def is_recording(folder: Path) -> bool:
    """True for a folder that is one bag, not one that holds several: it has metadata.yaml, or, where the recording was
    cut off before that, files named as a recorder does, after the folder and numbered.
    """
    files = _storage_files(folder)
    named = re.compile(rf'{re.escape(folder.resolve().name)}(_\d+)?')
    return (folder / METADATA_NAME).is_file() or bool(files and all(named.fullmatch(file.stem) for file in files))


class BagReader:
    """The messages of a bag, in order of time.

    A bag of several files is read file after file. Damage costs what is damaged: an MCAP file that was cut off
    gives every intact chunk, and ``damaged`` says what is missing, whole files of the recording too.
    """

    def __init__(self, path: str | Path) -> None:
        """Raises: SourceError where the path is missing or no bag."""
        self.path = Path(path)
        try:
            self._parts = _open_parts(self.path)
        except OSError as error:  # no permission, a link to nothing
            raise SourceError(f'{error.filename or path}: cannot be read: {error.strerror or error}') from None

    @property
    def topics(self) -> tuple[TopicInfo, ...]:
        """All topics with their type and count, in the order they were recorded first; one of two types is two."""
        return merged(topic for part in self._parts for topic in part.topics)

    @property
    def damaged(self) -> str | None:
        """What is wrong with the bag, None for nothing known so far (a bad chunk shows only once it is read)."""
        faults = [part.damaged for part in self._parts if part.damaged]
        return '; '.join(faults) or None

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[RawMessage]:
        """Messages of the named topics (names as recorded; None = all)."""
        wanted = None if topics is None else frozenset(topics)
        for part in self._parts:
            yield from part.messages(wanted)

    def close(self) -> None:
        """Close all files."""
        for part in self._parts:
            part.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        self.close()


def _open_parts(path: Path) -> list[BagStorage]:
    if path.is_file():
        return [_open_file(path)]
    if kind := describe_special(path):
        raise SourceError(f'{path}: expected a bag, got {kind}')
    if not path.is_dir():
        raise SourceError(f'{path}: no such bag')
    if _is_compressed(path):
        return [RosbagStorage(path)]
    listed = _listed_files(path)
    files = listed if any(file.is_file() for file in listed) else _storage_files(path)
    if not files:
        raise SourceError(
            f'{path}: found {describe_folder(path)}; expected a bag ({METADATA_NAME}, *.mcap, *.db3, *.bag)')
    if len(files) > 1 and not is_recording(path):
        part = f'{path.resolve().name}_0{files[0].suffix}'
        raise SourceError(f'{path}: {len(files)} bags ({files[0].name}, {files[1].name}, ...) that are not parts of '
                          f'one recording ({METADATA_NAME}, {part}, ...); name one of them')
    return _open_files(files)


def _open_files(files: list[Path]) -> list[BagStorage]:
    """The parts of a recording. Raises: SourceError where not one of them can be opened."""
    parts: list[BagStorage] = []
    errors: list[SourceError] = []
    for file in files:
        later = ', numbers of the frames after it are too small' if file != files[-1] else ''
        try:
            parts.append(_open_file(file) if file.exists() or len(files) == 1 else MissingPart(
                f'{file.name}: missing part of the recording{later}'))
        except SourceError as error:
            errors.append(error)
            parts.append(MissingPart(f'{error}{later}'))
    if len(errors) == len(files):
        raise errors[0]
    return parts


def _open_file(path: Path) -> BagStorage:
    magic = _magic(path)
    if magic.startswith(MCAP_MAGIC):
        return McapFile(path)
    if magic.startswith(SQLITE_MAGIC) and path.suffix == '.db3':
        return RosbagStorage(path)
    if magic.startswith(ROSBAG1_MAGIC):
        return Rosbag1Storage(path)
    size = path.stat().st_size
    raise SourceError(
        f'{path}: {size} bytes that are no bag; expected an MCAP file, a db3 file of ros2 bag or a bag of ROS 1')


def _magic(path: Path) -> bytes:
    with path.open('rb') as stream:
        return stream.read(len(SQLITE_MAGIC))


def _storage_files(folder: Path) -> list[Path]:
    """Without hidden ones, as file systems of other computers leave beside every file."""
    files = [file for file in folder.iterdir() if file.suffix in BAG_SUFFIXES and not file.name.startswith('.')]
    return sorted(files, key=lambda file: natural_key(file.name))


def _listed_files(folder: Path) -> list[Path]:
    """The files that metadata.yaml names, in its order."""
    listed = _metadata(folder).get('relative_file_paths')
    return [folder / Path(str(name)).name for name in listed] if isinstance(listed, list) else []


def _is_compressed(folder: Path) -> bool:
    """True where ros2 bag compressed messages or files itself: only rosbags knows how to undo that."""
    return bool(_metadata(folder).get('compression_mode'))


def _metadata(folder: Path) -> dict[str, Any]:
    """The bag's own description, empty where it is missing or damaged (the recording was cut off)."""
    try:
        content = yaml.safe_load((folder / METADATA_NAME).read_text(encoding='utf-8'))
        information = content['rosbag2_bagfile_information']
    except (OSError, ValueError, KeyError, TypeError, RecursionError, yaml.YAMLError):
        return {}
    return information if isinstance(information, dict) else {}


def chosen_topics(bag: str, topics: tuple[TopicInfo, ...], wanted: str) -> tuple[TopicInfo, ...]:
    """Those whose names are in ``wanted``, separated by commas, or all where it is empty.

    Raises: SourceError for a name that is not there, or where there is no message.
    """
    names = {name.strip().lstrip('/') for name in wanted.split(',')} - {''}
    missing = names - {topic.name.lstrip('/') for topic in topics}
    if missing:
        listed = ', '.join(f'{topic.name} ({topic.count})' for topic in topics) or 'none'
        raise SourceError(f'{bag}: no topic {", ".join(sorted(missing))}; topics (messages): {printable(listed)}')
    chosen = tuple(topic for topic in topics if topic.name.lstrip('/') in names) if names else topics
    if not sum(topic.count for topic in chosen):
        raise SourceError(f'{bag}: expected messages to play, found none in {len(chosen)} topics')
    return chosen
