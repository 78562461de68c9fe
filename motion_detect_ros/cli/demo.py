"""``demo``: the main job on a built-in flight. Draw it, play it through the nodes over DDS, measure what comes out.

Exit code 0 where every image got a detections message that the settings do not leave out, 3 where some did not, 1 where
none did.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from motion_detect_ros.cli.compiled_kernels import compile_missing
from motion_detect_ros.cli.demo_files import RECORD_NAME, VIDEO, begin, note
from motion_detect_ros.cli.demo_pictures import write_pictures
from motion_detect_ros.cli.demo_table import Run, table
from motion_detect_ros.cli.domains import own_domain
from motion_detect_ros.cli.output_folders import output_path
from motion_detect_ros.cli.progress import track
from motion_detect_ros.core.errors import BackendError, SourceError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.types import NANOSECONDS, RecordArray, Result
from motion_detect_ros.presets import load_preset
from motion_detect_ros.results.rows import CSV_HEADER, csv_rows
from motion_detect_ros.sources.bags import BagFrames, BagWriter
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight
from motion_detect_ros.sources.truth import write_truth

OK, NOTHING, PARTIAL = 0, 1, 3

FLIGHT_BAG, TRUTH_CSV = 'flight.mcap', 'flight.truth.csv'
DETECTIONS_BAG, DETECTIONS_CSV = 'detections.mcap', 'detections.csv'
SHEET = 'contact_sheet.png'
NAMES = FLIGHT_BAG, TRUTH_CSV, DETECTIONS_BAG, DETECTIONS_CSV, VIDEO, SHEET

#: A shorter flight has nothing to count: the first ten frames are left out.
MIN_FRAMES = 20
#: Images come at this share of what one process can do: four processes share the same cores with the transport.
LOAD_SHARE = 0.5
#: A recording may wait: a second in which something else has the processors must not cost images.
QUEUE_SIZE = 30


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    defaults = FlightConfig()
    parser.add_argument('-o', '--output', type=output_path, default=Path('out/demo'), help='folder for the outputs')
    parser.add_argument('--frames', type=int, default=defaults.frames, help='length of the flight')
    parser.add_argument('--seed', type=int, default=defaults.seed, help='another seed, another flight')
    parser.add_argument('--preset', default='default', help='settings: default, visdrone, kitti, report or a YAML file')
    parser.add_argument('--rate', type=float, help='speed of the playback against real time (default: half of what '
                        'this machine does in one process, at most 1)')
    parser.add_argument('--offline', action='store_true', help='in this process only, without ROS')


def run(arguments: argparse.Namespace) -> int:
    """Raises: MotionDetectError for wrong use, a folder that cannot be written or holds files of others by the names of
    the demo's, nodes that do not start.
    """
    if arguments.frames < MIN_FRAMES:
        raise SourceError(f'--frames: expected {MIN_FRAMES} or more, got {arguments.frames}')
    if arguments.rate is not None and not arguments.rate > 0:
        raise SourceError(f'--rate: expected a number over 0, got {arguments.rate:g}')
    _check_needs(arguments.preset, arguments.offline)
    config = FlightConfig(frames=arguments.frames, seed=arguments.seed)
    folder: Path = arguments.output
    begin(folder, NAMES)
    truth = record_flight(config, folder)
    note(folder, NAMES)
    bag = folder / FLIGHT_BAG
    compile_missing(load_preset(arguments.preset))
    answers = offline = run_in_process(bag, arguments.preset)
    rate = arguments.rate or min(1.0, LOAD_SHARE * real_time_factor(offline, config.fps))
    if not arguments.offline:
        answers = run_live(bag, offline, arguments.preset, rate)
    write_detections(folder, answers)
    note(folder, NAMES)
    write_pictures(bag, truth, answers, config.fps, folder / VIDEO, folder / SHEET)
    note(folder, NAMES)
    _print_report(config, truth, answers, None if arguments.offline else offline, rate)
    for name in (*NAMES, RECORD_NAME):
        print(folder / name)
    return exit_code(answers)


def _check_needs(preset: str, offline: bool) -> None:
    """Checks early what would fail late. Raises: ConfigError, BackendError."""
    load_preset(preset)
    if not offline and importlib.util.find_spec('rclpy') is None:
        raise BackendError('rclpy is missing: install ROS 2 Jazzy or the extra "ros", or use --offline')
    if not offline:
        own_domain()


def record_flight(config: FlightConfig, folder: Path) -> RecordArray:
    """Draw the flight into ``folder``: a bag with /image_raw and /camera_info, and the truth as CSV, returned too."""
    flight, truth = SyntheticFlight(config), []
    with BagWriter(folder / FLIGHT_BAG, compress=False) as bag:
        for frame in track(flight, len(flight), 'flight'):
            bag.write_camera_info(frame.camera, frame.stamp_ns)
            bag.write_image(frame.image, frame.stamp_ns)
            truth.append(frame.truth)
    boxes: RecordArray = np.concatenate(truth)
    write_truth(folder / TRUTH_CSV, boxes)
    return boxes


def run_in_process(bag: Path, preset: str) -> Run:
    """Every image of the bag that the settings do not leave out through ``MotionPipeline``; times are those of its
    stages.
    """
    frames, config = BagFrames(bag), load_preset(preset)
    pipeline = MotionPipeline(config, frames.camera)
    decimation = FrameDecimation.by(config.load)
    stamps_ns: list[int] = []
    results: dict[int, Result] = {}
    for index, frame in enumerate(track(frames, frames.frame_count, 'in process')):
        stamps_ns.append(frame.stamp_ns)
        if decimation.keep_next():
            results[index] = pipeline.process(frame.image, frame.stamp_ns)
    return Run(tuple(stamps_ns), {index: result.detections for index, result in results.items()}, len(results),
               tuple(result.times_ms.total for result in results.values()),
               frozenset(range(len(stamps_ns))) - results.keys())


def run_live(bag: Path, offline: Run, preset: str, rate: float) -> Run:
    """The same images through the nodes, each a process of its own; times from image to detections.

    offline: the images in one process. Raises: SourceError where a node does not come up.
    """
    from motion_detect_ros.cli.live import LiveGraph, queues
    start = perf_counter()
    with LiveGraph(preset, parameters=queues(QUEUE_SIZE)) as graph:
        print(f'nodes up after {perf_counter() - start:.0f} s, playing', file=sys.stderr)
        playback = graph.play(bag, len(offline.wanted), rate)
    frame_of = {stamp: index for index, stamp in enumerate(offline.stamps_ns)}
    known = [message for message in playback.received if message.stamp_ns in frame_of]
    return Run(offline.stamps_ns, {frame_of[message.stamp_ns]: message.records for message in known},
               len(playback.received), tuple(message.latency_ms for message in known), offline.left_out)


def real_time_factor(run: Run, fps: float) -> float:
    """How many times faster than ``fps`` images a second the stages of ``run`` were, by the median image."""
    return 1e3 / (fps * float(np.median(run.times_ms)))


def exit_code(run: Run) -> int:
    """0 only where every image got its detections message that the settings do not leave out."""
    if not run.records:
        return NOTHING
    return PARTIAL if run.unanswered else OK


def write_detections(folder: Path, run: Run) -> None:
    """The detections as a bag, one message for each processed image, and as the CSV that ``evaluate`` reads."""
    lines = [CSV_HEADER]
    with BagWriter(folder / DETECTIONS_BAG) as bag:
        for frame, records in sorted(run.records.items()):
            bag.write_detections(records, run.stamps_ns[frame])
            lines += csv_rows(frame, run.stamps_ns[frame], records)
    (folder / DETECTIONS_CSV).write_text('\n'.join(lines) + '\n', encoding='ascii')


def _print_report(config: FlightConfig, truth: RecordArray, run: Run, offline: Run | None, rate: float) -> None:
    seconds = (run.stamps_ns[-1] - run.stamps_ns[0]) / NANOSECONDS
    how = f'over DDS at {rate * config.fps:.1f} images a second' if offline else 'in one process'
    print(f'\nbuilt-in flight {config.seed}, {config.width} x {config.height}, {seconds:.1f} s, {how}\n')
    print('\n'.join(table(truth, run, offline)) + '\n')
