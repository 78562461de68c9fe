"""``convert``: data sets, image folders and videos to a bag (MCAP) that plays like a camera's recording."""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_detect_ros.cli.output_folders import output_path, refuse_existing
from motion_detect_ros.cli.progress import track
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import CameraModel, RecordArray
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bags import BagWriter, is_bag
from motion_detect_ros.sources.frames import DEFAULT_FPS, FrameSource, SourceFrame
from motion_detect_ros.sources.images import ImageSequence, image_folder
from motion_detect_ros.sources.kitti import KittiDrive, OxtsSample
from motion_detect_ros.sources.numbered_pictures import truth_of_input
from motion_detect_ros.sources.opening import check_name, check_rate
from motion_detect_ros.sources.part_file import PART_SUFFIX, part_of
from motion_detect_ros.sources.truth import Truth, write_truth
from motion_detect_ros.sources.video import VideoFile
from motion_detect_ros.sources.visdrone import visdrone_sequence

IMU_TOPIC, IMU_FRAME = '/imu', 'imu'
FIX_TOPIC = '/gps/fix'

OK, NOTHING, PARTIAL = 0, 1, 3

_STATUS_FIX = 0               # sensor_msgs/NavSatStatus.STATUS_FIX
_SERVICE_GPS = 1              # sensor_msgs/NavSatStatus.SERVICE_GPS
_COVARIANCE_APPROXIMATED = 1  # sensor_msgs/NavSatFix.COVARIANCE_TYPE_APPROXIMATED

#: Of the truth beside a bag.
TRUTH_SUFFIX = '.truth.csv'
_FORMATS = {'.jpg': 'jpeg', '.jpeg': 'jpeg', '.png': 'png'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    kinds = parser.add_subparsers(dest='kind', required=True, parser_class=type(parser))
    for kind, what in (('visdrone', 'VisDrone sequence folder'), ('kitti', 'KITTI raw drive folder'),
                       ('images', 'folder of pictures'), ('video', 'video file')):
        sub = kinds.add_parser(kind, help=f'{what} to MCAP')
        sub.add_argument('input', type=Path, help=what)
        sub.add_argument('-o', '--output', type=output_path, required=True, help='MCAP file to write')
        sub.add_argument('--force', action='store_true', help='overwrite an existing bag')
        if kind != 'video':
            sub.add_argument('--compressed', action='store_true',
                             help='keep the JPEG/PNG bytes, as CompressedImage on image_raw/compressed')
        if kind in ('visdrone', 'kitti'):
            sub.add_argument('--annotations', type=Path, help='truth file; goes to OUT.truth.csv beside the bag')
        if kind != 'kitti':
            sub.add_argument('--fps', type=float, required=kind == 'images', help='frames a second')


def run(arguments: argparse.Namespace) -> int:
    """Convert; the exit code is 3 where frames were unreadable. Raises: SourceError for an unusable input."""
    kind = arguments.kind
    fps = getattr(arguments, 'fps', None)
    check_rate('--fps', fps)
    annotations = getattr(arguments, 'annotations', None)
    written = [arguments.output, truth_path(arguments.output)] if annotations else [arguments.output]
    _check_outputs(written, [arguments.input, *filter(None, (annotations,))])
    refuse_existing(written, arguments.force)
    if not annotations and arguments.output.exists() and (stale := truth_path(arguments.output)).exists():
        hint = ', or give --annotations' if hasattr(arguments, 'annotations') else ''
        raise SourceError(
            f'{stale}: expected no truth, as that of the earlier {arguments.output} would stay; move it away{hint}')
    check_name(arguments.input)
    source = _open(kind, arguments.input, fps)
    truth = truth_of_input(annotations, arguments.input) if annotations else None
    count = convert(source, arguments.output, getattr(arguments, 'compressed', False), truth)
    bad = (f', {source.bad_frames} unreadable frames left out, the first one, {source.bad_reason}' if source.bad_frames
           else '')
    print('; '.join([f'{arguments.output}: {count} frames{bad}', *filter(None, (source.damaged,)), *source.complaints]))
    if not count:
        return NOTHING
    return PARTIAL if source.bad_frames or source.damaged else OK


def convert(source: FrameSource, output: Path, compressed: bool = False, truth: Truth | None = None) -> int:
    """Write a source to an MCAP file, and its truth to ``<output without suffix>.truth.csv``.

    truth: with the frame numbers of the source; the file counts as the bag does, without the unreadable ones.

    Topics: /image_raw (or /image_raw/compressed), /camera_info for every picture (K = 0 where uncalibrated), for
    KITTI /imu and /gps/fix. Returns the number of pictures written. If interrupted, ``<output>.part`` stays, a
    readable bag. Raises: SourceError where ``compressed`` is wanted of files that are neither JPEG nor PNG.
    """
    files = _compressed_files(source) if compressed else ()
    inertial = deque(source.oxts() if isinstance(source, KittiDrive) else ())
    written = list[int]()
    with BagWriter(output, compress=False) as bag:
        for frame in track(source, source.frame_count, source.name):
            while inertial and inertial[0].stamp_ns <= frame.stamp_ns:
                _write_oxts(bag, inertial.popleft())
            _write_camera_info(bag, frame, source)
            if compressed:
                file = files[frame.index]
                bag.write_compressed(file.read_bytes(), _FORMATS[file.suffix.lower()], frame.stamp_ns)
            else:
                bag.write_image(frame.image, frame.stamp_ns)
            written.append(frame.index)
        for sample in inertial:
            _write_oxts(bag, sample)
    if truth is not None:
        write_truth(truth_path(output), _renumbered(truth.boxes, written), truth.says_what_moves)
    return len(written)


def _check_outputs(written: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Raises: SourceError where what is to be written would replace an input, a file in one, or a folder."""
    if written[0].is_dir():
        raise SourceError(f'{written[0]}: expected an MCAP file to write, got a folder')
    for file in (each for path in written for each in (path, part_of(path)) if each.exists()):
        if any(given.exists() and (file.samefile(given) or _is_part_of(given, file)) for given in inputs):
            raise SourceError(f'{file}: expected an output that replaces no input; choose another --output')


def _is_part_of(folder: Path, file: Path) -> bool:
    """Whether a file belongs to a data set; bags, and their truth, may lie beside its pictures."""
    inside = folder.resolve() in file.resolve().parents
    return inside and not is_bag(file) and not file.name.endswith((TRUTH_SUFFIX, PART_SUFFIX))


def truth_path(output: Path) -> Path:
    """Where the truth of a converted bag goes."""
    return output.with_suffix(TRUTH_SUFFIX)


def _renumbered(truth: RecordArray, frames: list[int]) -> RecordArray:
    """What is true of these frames, which are 0, 1, ... now."""
    position = {frame: index for index, frame in enumerate(frames)}
    kept = truth[np.isin(truth['frame'], frames)].copy()
    kept['frame'] = [position[frame] for frame in kept['frame'].tolist()]
    return kept


def _open(kind: str, path: Path, fps: float | None) -> FrameSource:
    if kind == 'kitti':
        return KittiDrive(path)
    if kind == 'visdrone':
        return visdrone_sequence(path, fps or DEFAULT_FPS)
    if kind == 'images':
        return image_folder(path, fps or DEFAULT_FPS)
    if not path.is_file():
        raise SourceError(f'{path}: no such video file')
    return VideoFile(path, fps)


def _compressed_files(source: FrameSource) -> tuple[Path, ...]:
    """The files behind the frames of a source, by frame index."""
    sequence = source.images if isinstance(source, KittiDrive) else source
    if not isinstance(sequence, ImageSequence):
        raise SourceError(f'{source.name}: its frames are no JPEG or PNG files')
    odd = [file for file in sequence.files if file.suffix.lower() not in _FORMATS]
    if odd:
        raise SourceError(f'{odd[0]}: --compressed keeps JPEG and PNG files only')
    return sequence.files


def _write_camera_info(bag: BagWriter, frame: SourceFrame, source: FrameSource) -> None:
    """Of the picture's own size; all zero where it has no calibration."""
    height, width = frame.image.shape[:2]
    if frame.camera is None:
        bag.write_camera_info(CameraModel(width, height, 0.0, 0.0, 0.0, 0.0), frame.stamp_ns)
    elif isinstance(source, KittiDrive) and source.calibration:
        calibration = source.calibration.resized(width, height)
        bag.write_camera_info(calibration.camera, frame.stamp_ns, projection=calibration.projection)
    else:
        bag.write_camera_info(frame.camera.resized(width, height), frame.stamp_ns)


def _write_oxts(bag: BagWriter, sample: OxtsSample) -> None:
    """One GPS/IMU packet as sensor_msgs/Imu (covariances 0 = unknown) and sensor_msgs/NavSatFix."""
    header = messages.header(sample.stamp_ns, IMU_FRAME)
    bag.write(IMU_TOPIC, messages.make(
        messages.IMU, header=header,
        orientation=_xyz('geometry_msgs/msg/Quaternion', *sample.quaternion),
        angular_velocity=_xyz('geometry_msgs/msg/Vector3', *sample.angular_velocity),
        linear_acceleration=_xyz('geometry_msgs/msg/Vector3', *sample.acceleration)), sample.stamp_ns)
    status = messages.make('sensor_msgs/msg/NavSatStatus', status=_STATUS_FIX, service=_SERVICE_GPS)
    bag.write(FIX_TOPIC, messages.make(
        messages.NAV_SAT_FIX, header=header, status=status, latitude=sample.latitude_deg,
        longitude=sample.longitude_deg, altitude=sample.altitude_m,
        position_covariance=np.diag([sample.position_accuracy_m ** 2] * 3).reshape(-1),
        position_covariance_type=_COVARIANCE_APPROXIMATED), sample.stamp_ns)


def _xyz(msgtype: str, *values: float) -> Any:
    return messages.make(msgtype, **dict(zip('xyzw', values, strict=False)))
