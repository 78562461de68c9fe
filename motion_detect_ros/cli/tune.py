"""``tune``: searches settings on one part of the recordings and says what they are worth on the other.

In the output folder: preset.yaml, what to use (the start where no gain was shown); candidate.yaml, the best of the
search; tune.md and tune.json, the report; trials.sqlite3, with which a search that was ended goes on.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import motion_detect_ros
from motion_detect_ros.cli.batch.inputs import expand_inputs, size_of
from motion_detect_ros.cli.compiled_kernels import compile_missing
from motion_detect_ros.cli.output_folders import output_path
from motion_detect_ros.cli.progress import Board
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError, SourceError
from motion_detect_ros.core.settings import settings
from motion_detect_ros.core.threads import use
from motion_detect_ros.presets import are_rectified, load_preset, node_sections, write_preset
from motion_detect_ros.results.clips import truth_of_clips
from motion_detect_ros.results.files import write_whole
from motion_detect_ros.results.metrics import COUNTINGS
from motion_detect_ros.results.ownership import owned
from motion_detect_ros.sources.opening import check_rate_is_used, source_name
from motion_detect_ros.sources.secrets import holds_secret
from motion_detect_ros.tuning.objective import AgreementObjective, Objective, TruthObjective
from motion_detect_ros.tuning.recording import Recording
from motion_detect_ros.tuning.report import as_json, as_markdown, headline
from motion_detect_ros.tuning.space import Dimension, dimensions
from motion_detect_ros.tuning.study import STORAGE_NAME, Study, Trial
from motion_detect_ros.tuning.tuner import Tuner, Verdict

OK, NO_GAIN = 0, 1
TRIALS, FRAMES = 40, 600
REPORT, FACTS, CANDIDATE, PRESET = OUTPUT_NAMES = 'tune.md', 'tune.json', 'candidate.yaml', 'preset.yaml'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('inputs', nargs='+', metavar='IN', help='what replay takes; recordings of one kind')
    parser.add_argument('--truth', type=Path, nargs='+', default=[],
                        help='one for each input, or a folder of them, matched by name; without truth: agreement of '
                        'the flight with the same flight backwards')
    parser.add_argument('-o', '--output', type=output_path, required=True, help='folder for preset, report and trials')
    parser.add_argument('--preset', default='default', help='where to start: name or YAML file')
    parser.add_argument('--settings', nargs='+', default=[], metavar='NAME',
                        help='what to search (default: a short list)')
    parser.add_argument('--trials', type=int, default=TRIALS, help=f'settings tried, in all (default {TRIALS})')
    parser.add_argument('--time', type=float, metavar='S', help='begin no trial after so many seconds')
    parser.add_argument('--frames', type=int, default=FRAMES, metavar='N',
                        help=f'first frames of each input used; they are held in memory (default {FRAMES})')
    parser.add_argument('--iou', type=float, default=0.3, help='overlap that counts as hit')
    parser.add_argument('--counting', choices=[*COUNTINGS], default='moving',
                        help='which objects of the truth are wanted')
    parser.add_argument('--fps', type=float, help='frames/s of inputs without time stamps')
    parser.add_argument('--topic', help='image topic of a bag that has several')
    parser.add_argument('--seed', type=int, default=0, help='of the search, of what is held out and of the interval')
    parser.add_argument('--force', action='store_true', help='forget the trials that the folder holds')


def run(arguments: argparse.Namespace) -> int:
    """Search, write preset and report, return the exit code: 1 where no gain was shown.

    Raises: SourceError for unreadable inputs, wrong numbers, and a folder that another process writes; ConfigError for
    an unknown preset or setting, or one that wants angular rates; BackendError where optuna is missing.
    """
    _check(arguments)
    start, searched = load_preset(arguments.preset), dimensions(arguments.settings)
    of_nodes = _without_secrets(node_sections(arguments.preset), arguments.preset)
    if start.imu.use:
        raise ConfigError(f'{arguments.preset}: imu.use: expected false, as tune uses the pictures only, got true')
    recordings = _recordings(arguments, are_rectified(arguments.preset))
    use(start.load.threads)
    _check_outputs(arguments)
    _make_folder(arguments.output)
    task = _task(arguments, recordings, start, searched)  # before the lock, which may lie in an input
    with owned(arguments.output):
        return _tune(arguments, recordings, start, searched, of_nodes, task)


def _tune(
    arguments: argparse.Namespace, recordings: Sequence[Recording], start: PipelineConfig,
    searched: Sequence[Dimension], of_nodes: dict[str, dict[str, Any]], task: dict[str, Any],
) -> int:
    """``run`` in a folder that nobody else writes. Raises: as ``run``."""
    if arguments.force:
        (arguments.output / STORAGE_NAME).unlink(missing_ok=True)
    study = Study(arguments.output, searched, task, arguments.seed)
    objective: Objective = (TruthObjective(arguments.counting, arguments.iou) if arguments.truth
                            else AgreementObjective(arguments.iou))
    compile_missing(start)
    tuner = Tuner(recordings, objective, start, searched, arguments.seed)
    try:
        _search(tuner, study, arguments.trials, arguments.time)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f'the trials that ended are kept in {arguments.output / STORAGE_NAME}, the same '
                                'command goes on with them') from None
    best = study.best
    if best is None:
        raise SourceError('--time: expected enough for a trial; none has ended')
    verdict = tuner.judge(best)
    _write(arguments, start, of_nodes, tuner, study.trials, verdict)
    print(f'{arguments.output}: {headline(verdict)}')
    if tuner.caution:
        print(f'caution: {tuner.caution}')
    print(f'recommended: {"the tuned settings" if verdict.shown else "the start, unchanged"}, '
          f'{arguments.output / PRESET}')
    return OK if verdict.shown else NO_GAIN


def _without_secrets(of_nodes: dict[str, dict[str, Any]], preset: str) -> dict[str, dict[str, Any]]:
    """What only the nodes read, but for addresses with credentials: presets are passed on. Says what is left out."""
    kept: dict[str, dict[str, Any]] = {}
    for node, values in of_nodes.items():
        secret = {name for name, value in values.items() if holds_secret(value)}
        kept[node] = {name: value for name, value in values.items() if name not in secret}
        for name in sorted(secret):
            print(f'{preset}: {name} holds credentials and is left out of the presets', file=sys.stderr)
    return kept


def _check(arguments: argparse.Namespace) -> None:
    """Raises: SourceError for numbers outside their range."""
    if not 0 < arguments.iou <= 1:
        raise SourceError(f'--iou: expected a number over 0 up to 1, got {arguments.iou:g}')
    for name, least in (('trials', 1), ('frames', 1), ('seed', 0)):
        if getattr(arguments, name) < least:
            raise SourceError(f'--{name}: expected {least} or more, got {getattr(arguments, name)}')
    if arguments.time is not None and not arguments.time > 0:
        raise SourceError(f'--time: expected a number over 0, got {arguments.time:g}')


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Raises: SourceError where the start, or a file that tune has not written, would be replaced."""
    start, folder = Path(arguments.preset), arguments.output
    for file in filter(Path.exists, map(folder.joinpath, OUTPUT_NAMES)):
        if start.exists() and file.samefile(start):
            raise SourceError(f'{file}: expected a start that no output replaces; choose another --output')
        if not arguments.force and not (folder / STORAGE_NAME).exists():
            raise SourceError(f'{file}: exists and is not of an earlier search; --force overwrites it')


def _recordings(arguments: argparse.Namespace, rectified: bool) -> list[Recording]:
    """Raises: SourceError where inputs and truth do not fit together."""
    inputs = expand_inputs(arguments.inputs, arguments.output)
    inputs.tell_left_out()
    paths = inputs.paths
    check_rate_is_used('--fps', arguments.fps, paths)
    if arguments.output.resolve() in [Path(path).resolve() for path in paths]:
        raise SourceError(f'{arguments.output}: expected another folder for the outputs than the input itself; choose '
                          'another --output')
    names = [source_name(Path(path).resolve()) for path in paths]
    if len(set(names)) < len(names):
        raise SourceError(f'inputs: expected different names, got {", ".join(names)}')
    truths = truth_of_clips(dict(zip(names, map(Path, paths), strict=True)), arguments.truth) if arguments.truth else {}
    if arguments.truth and (missing := [name for name in names if name not in truths]):
        raise SourceError(f'--truth: expected truth of every input, found none of {", ".join(missing)}')
    return [Recording(path, truths.get(name), arguments.fps, arguments.topic, arguments.frames, rectified)
            for path, name in zip(paths, names, strict=True)]


def _task(
    arguments: argparse.Namespace, recordings: Sequence[Recording], start: PipelineConfig,
    searched: Sequence[Dimension],
) -> dict[str, Any]:
    """What makes trials comparable. Raises: SourceError where a truth cannot be read."""
    return {
        'version': motion_detect_ros.__version__, 'input_bytes': [size_of(one.path) for one in recordings],
        'truth_contents': [_digest(one.truth) for one in recordings if one.truth],
        'inputs': [str(Path(one.path).resolve()) for one in recordings],
        'truth': [str(path.resolve()) for path in arguments.truth], 'frames': arguments.frames, 'seed': arguments.seed,
        'fps': arguments.fps, 'topic': arguments.topic, 'iou': arguments.iou, 'counting': arguments.counting,
        'rectified': [one.rectified for one in recordings],
        'start': {name: value for name, value, _ in settings(start)},
        'searched': [[one.name, one.low, one.high, one.log] for one in searched]}


def _digest(truth: Path) -> str:
    try:
        return hashlib.sha256(truth.read_bytes()).hexdigest()
    except OSError as error:
        raise SourceError(f'{truth}: truth cannot be read: {error.strerror}') from None


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SourceError(f'{folder}: cannot be made a folder for the outputs: {error.strerror}') from None


def _search(tuner: Tuner, study: Study, trials: int, time_s: float | None) -> None:
    """Trials until there are enough, or the time is over; each has ended when it is counted."""
    begun = time.monotonic()
    best = 0.0  # the start's
    with Board(1) as board:
        for trial in tuner.search(study, trials):
            board.advance('trials', trial.number + 1, trials)
            if trial.gain > best:
                best = trial.gain
                board.say(f'trial {trial.number + 1} of {trials}: {best:+.3f} on what is searched', error=True)
            if time_s is not None and time.monotonic() - begun >= time_s:
                break


def _write(
    arguments: argparse.Namespace, start: PipelineConfig, of_nodes: dict[str, dict[str, Any]], tuner: Tuner,
    trials: Sequence[Trial], verdict: Verdict,
) -> None:
    facts = {
        'what': (f'F1 against truth at IoU {arguments.iou:g}, {arguments.counting}' if arguments.truth else
                 f'agreement with the flight backwards at IoU {arguments.iou:g}'),
        'inputs': ', '.join(arguments.inputs), 'start': str(arguments.preset), 'seed': str(arguments.seed),
        'held out': tuner.held_out, 'interval': tuner.meaning, **({'caution': tuner.caution} if tuner.caution else {})}
    known, folder = tuner.start_values(), arguments.output
    write_whole(folder / REPORT, as_markdown(verdict, known, trials, facts))
    write_whole(folder / FACTS, json.dumps(as_json(verdict, known, trials, facts), indent=2) + '\n')
    write_preset(folder / CANDIDATE, verdict.candidate, [
        f'Best of {len(trials)} trials from preset {arguments.preset}: {headline(verdict)}.'], of_nodes)
    write_preset(folder / PRESET, verdict.candidate if verdict.shown else start, [
        f'{"Tuned" if verdict.shown else "Unchanged"} from preset {arguments.preset}: {headline(verdict)}.'], of_nodes)
