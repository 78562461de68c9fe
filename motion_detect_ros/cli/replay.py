"""``replay``: every frame of recordings through the pipeline, the same answer every time.

With one input the outputs are in OUT_DIR itself, with several in OUT_DIR/<name of the input>.
"""

from __future__ import annotations

import argparse
import importlib
import math
import sys
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from motion_detect_ros.cli.batch.inputs import expand_inputs
from motion_detect_ros.cli.batch.jobs import PARTIAL, Ended, Job, Outcome
from motion_detect_ros.cli.batch.listing import conclusion, exit_code, write_list
from motion_detect_ros.cli.batch.one_input import run_job
from motion_detect_ros.cli.batch.resume import sort_out
from motion_detect_ros.cli.compiled_kernels import compile_missing
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.cli.format_options import add_format_arguments, formats_of
from motion_detect_ros.cli.output_folders import folders_of, output_path
from motion_detect_ros.cli.progress import Board
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import BackendError, SourceError
from motion_detect_ros.presets import are_rectified, load_preset
from motion_detect_ros.report.make import can_report
from motion_detect_ros.results.formats import output_files
from motion_detect_ros.sources.bags import is_bag
from motion_detect_ros.sources.frames import DEFAULT_FPS
from motion_detect_ros.sources.opening import check_rate, check_rate_is_used


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('inputs', nargs='+', metavar='IN',
                        help='bag (MCAP, db3, ROS 1), video, image folder, VisDrone sequence, KITTI drive; a pattern '
                             'or folder of these')
    parser.add_argument('-o', '--output', type=output_path, required=True, help='folder for the outputs')
    parser.add_argument('--preset', help='settings: default, visdrone, kitti, report or a YAML file')
    parser.add_argument('--config', help='YAML file with settings, instead of --preset')
    parser.add_argument('--fps', type=float, help=f'frames/s of inputs without time stamps (default {DEFAULT_FPS:g})')
    parser.add_argument('--topic', help='image topic of a bag that has several')
    parser.add_argument('--rectified', action='store_true', help='the images of bags are rectified: matrix P of '
                        'camera_info holds, not K and D')
    parser.add_argument('--start', type=float, metavar='S', help='begin S seconds after the first frame')
    parser.add_argument('--duration', type=float, metavar='S', help='end S seconds after that')
    parser.add_argument('--every', type=int, metavar='N', help='of the frames in between take each Nth only')
    add_format_arguments(parser)
    parser.add_argument('--workers', type=int, default=1, help='processes, for several inputs; they share the cores')
    parser.add_argument('--scheduler', metavar='ADDRESS', help='Dask scheduler (tcp://HOST:8786, or the file that it '
                        'wrote) whose workers do the inputs')
    parser.add_argument('--force', action='store_true', help='do anew, and overwrite, what an earlier replay left')
    parser.add_argument('--no-report', action='store_true', help='leave out report.html')
    parser.add_argument('--live', action='store_true', help='play through the ROS nodes instead; bags only')
    parser.add_argument('--rate', type=float, help='with --live: speed against the recording (default 1)')


def run(arguments: argparse.Namespace) -> int:
    """Replay all inputs; the exit code is that of ``__main__`` that all ended with, 3 where they differ.

    Raises: SourceError for options that contradict each other, folders with results of something else, a cluster that
    cannot be used; ConfigError for an unknown preset or a wrong value; BackendError where ``--live`` finds no ROS 2 or
    ``--scheduler`` no Dask.
    """
    _check(arguments)
    if arguments.live:
        _check_live(arguments)
    config = load_preset(preset_of(arguments))
    jobs = make_jobs(arguments, config)
    if not arguments.live and not arguments.no_report and can_report():
        jobs = [replace(job, report=True) for job in jobs]
    finished, lines = sort_out(jobs, arguments.live)
    if not arguments.live and not arguments.scheduler and len(finished) < len(jobs):
        compile_missing(config)
    several, outcomes = jobs[0].folder != arguments.output.absolute(), dict(finished)
    try:
        _run(arguments, jobs, outcomes, lines)
    except KeyboardInterrupt:
        if several:
            stopped = {job: Outcome(PARTIAL, f'{job.folder}: interrupted') for job in jobs}
            with suppress(OSError):
                write_list(arguments.output, stopped | outcomes)
        raise
    outcomes = {job: outcomes[job] for job in jobs}
    if several:
        print('\n'.join(conclusion(outcomes)))
        write_list(arguments.output, outcomes)
    return exit_code(outcomes)


def make_jobs(arguments: argparse.Namespace, config: PipelineConfig) -> list[Job]:
    """A job for each input; inputs of the same name get a number behind it.

    Raises: SourceError as ``Window``, where outputs would go into or over an input, for a topic of no bag,
    a rate where all inputs have stamps; ConfigError where the settings do not say ``rectified`` in true or false.
    """
    formats, inputs = formats_of(arguments), expand_inputs(arguments.inputs, arguments.output)
    inputs.tell_left_out()
    rectified = are_rectified(preset_of(arguments)) or arguments.rectified
    folders = folders_of(inputs.paths, arguments.output.absolute(), inputs.several)
    jobs = [Job(path, folder, config, arguments.fps, arguments.topic, arguments.start, arguments.duration,
                arguments.every, formats, arguments.overlay, rectified=rectified, force=arguments.force)
            for path, folder in zip(inputs.paths, folders, strict=True)]
    for job in jobs:
        if job.folder.resolve() == Path(job.path).resolve():
            raise SourceError(f'{job.folder}: expected another folder for the outputs than the input itself; '
                              'choose another --output')
    if arguments.topic is not None and not any(_may_have_topics(Path(path)) for path in inputs.paths):
        raise SourceError(f'--topic: expected a bag among the inputs, got {arguments.topic}')
    check_rate_is_used('--fps', arguments.fps, inputs.paths)
    outputs = {file.resolve() for job in jobs for file in output_files(job.folder)}
    for path in inputs.paths:
        if Path(path).resolve() in outputs:
            raise SourceError(f'{path}: expected an input that no output replaces; choose another --output')
    _ = jobs[0].window  # says at once what is wrong with it
    return jobs


def _may_have_topics(path: Path) -> bool:
    """Whether it is a bag, or what it is will be said when it is opened."""
    try:
        return not path.exists() or is_bag(path)
    except OSError:
        return True


def _run(arguments: argparse.Namespace, jobs: list[Job], outcomes: dict[Job, Outcome], lines: list[str]) -> None:
    """Do all jobs that have no outcome yet, and add theirs as they end."""
    finished = dict(outcomes)
    with Board(len(jobs)) as board:

        def ended(job: Job, outcome: Outcome) -> None:
            outcomes[job] = outcome
            board.end(job.name)
            board.say(outcome.line, error=outcome.line.startswith('error'))

        for job, outcome in finished.items():
            ended(job, outcome)
        for line in lines:
            board.say(line)
        _do([job for job in jobs if job not in finished], arguments, board, ended)


def _do(jobs: list[Job], arguments: argparse.Namespace, board: Board, ended: Ended) -> None:
    """Here, in processes, on a cluster, or through the nodes."""
    if not jobs:
        return
    if arguments.live:
        from motion_detect_ros.cli.live_replay import run_live_job
        for job in jobs:
            ended(job, run_live_job(job, preset_of(arguments), arguments.rate or 1.0))
    elif arguments.scheduler:
        from motion_detect_ros.cli.batch.cluster import run_on_cluster
        run_on_cluster(jobs, arguments.scheduler, arguments.output.absolute(), board, ended)
    elif arguments.workers > 1 and len(jobs) > 1:
        from motion_detect_ros.cli.batch.processes import run_in_processes
        run_in_processes(jobs, min(arguments.workers, len(jobs)), board, ended)
    else:
        for job in jobs:
            ended(job, run_job(job, partial(board.advance, job.name)))


def preset_of(arguments: argparse.Namespace) -> str:
    """Name or file of the settings."""
    return arguments.config or arguments.preset or 'default'


def _check(arguments: argparse.Namespace) -> None:
    """Raises: SourceError for numbers outside their range and options that contradict each other."""
    if arguments.rate is not None:
        if not 0 < arguments.rate < math.inf:
            raise SourceError(f'--rate: expected a number over 0, got {arguments.rate:g}')
        if not arguments.live:
            raise SourceError(f'--rate: expected --live beside it, which plays in time, got {arguments.rate:g}')
    if arguments.config and arguments.preset:
        print(f'--preset {arguments.preset}: not used, as --config {arguments.config} replaces it', file=sys.stderr)
    if arguments.workers < 1:
        raise SourceError(f'--workers: expected 1 or more, got {arguments.workers}')
    if arguments.workers > 1 and arguments.scheduler:
        raise SourceError('--scheduler: expected no --workers, as the cluster has its own')
    check_rate('--fps', arguments.fps)


def _check_live(arguments: argparse.Namespace) -> None:
    """Raises: SourceError for an option that says nothing to nodes; ConfigError for a ROS_DOMAIN_ID that is none;
    BackendError without ROS 2.
    """
    if arguments.workers > 1:
        raise SourceError(
            f'--live: expected no --workers, as one graph plays one bag at a time, got {arguments.workers}')
    if arguments.fps is not None:
        raise SourceError(f'--live: expected no --fps, as a bag has stamps of its own, got {arguments.fps:g}')
    for name in ('scheduler', 'start', 'duration', 'every'):
        if getattr(arguments, name) is not None:
            raise SourceError(f'--live: expected no --{name}, got {getattr(arguments, name)}')
    own_domain()
    try:
        importlib.import_module('motion_detect_ros.cli.live_replay')
    except ModuleNotFoundError as error:
        raise BackendError(f'--live: expected an installation of ROS 2, but {error.name} is missing') from None
