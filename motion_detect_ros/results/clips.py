"""Which detections belong to which ground truth: single files, result folders of many clips, folders of truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.files import CSV_NAME
from motion_detect_ros.results.live_summary import LiveSummary, read_any_summary
from motion_detect_ros.results.summary import Summary
from motion_detect_ros.sources.opening import source_name
from motion_detect_ros.sources.part_file import part_of

AnySummary = Summary | LiveSummary
#: Where the truth of a clip may be in a folder of truth; the third as MOT Challenge lays it out.
TRUTH_PATTERNS = ('{name}.csv', '{name}.txt', '{name}/gt/gt.txt', '{name}/gt.txt')


def clips_of(path: Path) -> dict[str, Path]:
    """Name and detections.csv of each clip: of a CSV file, a result folder, or a folder of result folders.

    Raises: SourceError where there is none.
    """
    if path.is_file():
        return {path.resolve().parent.name if path.name == CSV_NAME else path.stem: path}
    if (path / CSV_NAME).is_file():
        return {path.resolve().name: path / CSV_NAME}
    found = {file.parent.name: file for file in sorted(path.glob(f'*/{CSV_NAME}'))} if path.is_dir() else {}
    if not found:
        raise SourceError(f'{path}: expected detections as CSV, a result folder or a folder of those, found none')
    return found


def unfinished_in(path: Path) -> list[str]:
    """Names of the clips in a folder of result folders whose replay is not finished: they are none of ``clips_of``."""
    found = sorted(path.glob(f'*/{part_of(Path(CSV_NAME))}')) if not (path / CSV_NAME).is_file() else []
    return [file.parent.name for file in found if not (file.parent / CSV_NAME).is_file()]


def all_clips(paths: Iterable[Path]) -> dict[str, Path]:
    """The clips of several paths. Raises: SourceError where two have the same name."""
    clips: dict[str, Path] = {}
    for path in paths:
        for name, file in clips_of(path).items():
            if name in clips:
                raise SourceError(f'{file}: expected clips of different names, got {name} twice ({clips[name]})')
            clips[name] = file
    return clips


def truth_of_clips(clips: Mapping[str, Path], truths: Sequence[Path]) -> dict[str, Path]:
    """The truth of each clip: as many files as clips, in their order, or a folder of files matched by name.

    clips: recordings by name, or detections.csv, where the name of the input that its summary tells is looked for too,
    unless it is that of several different inputs. Clips without truth are not in it.
    Raises: SourceError where numbers do not fit or nothing matches.
    """
    names = list(clips)
    if len(truths) == 1 and truths[0].is_dir():
        found = _by_name(clips, truths[0])
        if not found:
            looked = ', '.join(pattern.format(name='NAME') for pattern in TRUTH_PATTERNS)
            raise SourceError(f'{truths[0]}: expected truth of {", ".join(names)} as {looked}, found none')
        return found
    if len(truths) != len(names):
        raise SourceError(f'--truth: expected a folder, or a file for each of the {len(names)} clips '
                          f'({", ".join(names)}), got {len(truths)}')
    return dict(zip(names, truths, strict=True))


def same_clips(runs: Mapping[str, Mapping[str, Path]]) -> dict[str, dict[str, Path]]:
    """Detections by clip and run, of several runs over the same clips.

    runs: detections by clip, of each run; where each has one clip only, its name does not matter.
    Raises: SourceError for different clips, or different inputs by their summaries.
    """
    first, *others = runs
    if all(len(clips) == 1 for clips in runs.values()):
        (name,) = runs[first]
        by_clip = {name: {run: file for run, clips in runs.items() for file in clips.values()}}
    else:
        for other in others:
            if odd := set(runs[first]) ^ set(runs[other]):
                raise SourceError(f'{other}: expected the same clips as in {first}; only in one of them: '
                                  f'{", ".join(sorted(odd))}')
        by_clip = {name: {run: clips[name] for run, clips in runs.items()} for name in runs[first]}
    for files in by_clip.values():
        _check_inputs(files)
    return by_clip


def _check_inputs(files: Mapping[str, Path]) -> None:
    """Raises: SourceError where the summaries beside detections of one clip name different inputs."""
    known = [(run, name) for run, file in files.items() if (name := _input_name(_summary(file)))]
    for run, name in known[1:]:
        if name != known[0][1]:
            raise SourceError(f'{files[run]}: expected detections of the same input as in {known[0][0]}, '
                              f'{known[0][1]}, got {name}')


def _by_name(clips: Mapping[str, Path], folder: Path) -> dict[str, Path]:
    """Truth by the name of the clip, else by that of its input unless others of that truth had another input."""
    exact = {name: _in_folder(folder, name) for name in clips}
    summaries = {name: _summary(file) for name, file in clips.items()}
    near = {name: exact[name] or _in_folder(folder, _input_name(summaries[name])) for name in clips}
    return {name: truth for name, truth in near.items() if truth and (exact[name] or all(
        _of_one_input(summaries[other], summaries[name]) for other, same in near.items() if same == truth))}


def _input_name(summary: AnySummary | None) -> str:
    """The name of what was replayed, without its suffix; empty where no summary says so."""
    return source_name(summary.input) if summary else ''


def _of_one_input(one: AnySummary | None, other: AnySummary | None) -> bool:
    """Whether both were made of the same input: of its size, as it may have been moved, else of its path."""
    if one is None or other is None:
        return one is other
    if one.input_bytes is not None and other.input_bytes is not None:
        return one.input_bytes == other.input_bytes
    return Path(one.input).resolve() == Path(other.input).resolve()


def _summary(detections: Path) -> AnySummary | None:
    """That of the replay which left these detections; anything else beside a summary may be of another input."""
    if detections.name != CSV_NAME:
        return None
    try:
        return read_any_summary(detections.parent)
    except SourceError:
        return None


def _in_folder(folder: Path, name: str) -> Path | None:
    return next((file for pattern in TRUTH_PATTERNS if name and (file := folder / pattern.format(name=name)).is_file()),
                None)
