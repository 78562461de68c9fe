"""open_source: what it takes for what, and what it says where it takes nothing."""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
import threading
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.bags import BagFrames, BagReader, BagWriter, is_bag
from motion_detect_ros.sources.images import ImageSequence, decode_image, image_files, image_folder
from motion_detect_ros.sources.opening import open_source, source_name
from motion_detect_ros.sources.video import VideoFile, _missing
from motion_detect_ros.sources.visdrone import visdrone_sequence

#: tf2 takes stamp 0 for the latest there is: sources that tell no time begin a second later.
START_NS = 1_000_000_000


def make_pictures(folder: Path, names: list[str]) -> Path:
    folder.mkdir(exist_ok=True)
    for index, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full((32, 48, 3), 10 * index % 256, np.uint8))
    return folder


def make_video(path: Path, frames: int = 12, fps: float = 10.0) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*'mp4v'), fps, (64, 48))
    for index in range(frames):
        writer.write(np.full((48, 64, 3), 20 * index, np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize(('path', 'name'), [
    ('a/flight.mcap', 'flight'), ('a/FLIGHT.MP4', 'FLIGHT'), ('a/2024.05.01.bag', '2024.05.01'),
    ('a/2024.05.01', '2024.05.01'), ('a/run.v2.db3', 'run.v2'), ('a/run.v2', 'run.v2'),
])
def test_only_the_suffixes_of_bags_and_videos_are_none_of_the_name(path: str, name: str, tmp_path: Path) -> None:
    assert source_name(path) == name, 'of one that has gone, too'
    (tmp_path / path).mkdir(parents=True)
    assert source_name(tmp_path / path) == Path(path).name, 'a folder has no suffix'


@pytest.mark.parametrize(('path', 'name'), [
    ('data/MOT17-02/img1', 'MOT17-02'), ('img1', 'img1'), ('/img1', 'img1'), ('data/img1.mcap', 'img1')])
def test_a_mot_sequence_gives_its_name(path: str, name: str) -> None:
    assert source_name(path) == name


def test_pictures_come_in_natural_order(tmp_path: Path) -> None:
    folder = make_pictures(tmp_path / 'p', ['f1.png', 'f2.png', 'f10.png'])
    assert [file.name for file in image_files(folder)] == ['f1.png', 'f2.png', 'f10.png']
    assert [int(frame.image[0, 0, 0]) for frame in open_source(folder)] == [0, 10, 20]


def test_hidden_files_are_no_pictures(tmp_path: Path) -> None:
    """macOS puts one beside each file on drives that are not its own."""
    folder = make_pictures(tmp_path / 'p', ['1.jpg', '2.jpg'])
    for name in ('._1.jpg', '._2.jpg'):
        (folder / name).write_bytes(b'\0\5\x16\7' + bytes(100))
    source = open_source(folder)
    assert [(frame.index, frame.stamp_ns - START_NS) for frame in source] == [(0, 0), (1, 40_000_000)]
    assert source.bad_frames == 0


def test_folder_stamps_do_not_drift(tmp_path: Path) -> None:
    folder = make_pictures(tmp_path / 'p', [f'{n}.png' for n in range(31)])
    stamps = [frame.stamp_ns for frame in open_source(folder, fps=30)]
    assert stamps[:3] == [START_NS, START_NS + 33_333_333, START_NS + 66_666_667]
    assert stamps[30] == START_NS + 1_000_000_000


def test_default_rate_of_a_folder_is_25(tmp_path: Path) -> None:
    folder = make_pictures(tmp_path / 'p', ['0000001.png', '0000002.png'])
    assert [frame.stamp_ns for frame in open_source(folder)] == [START_NS, START_NS + 40_000_000]


def test_an_unreadable_picture_costs_itself_and_keeps_its_index(tmp_path: Path) -> None:
    folder = make_pictures(tmp_path / 'p', ['0.jpg', '1.jpg', '2.jpg', '3.jpg'])
    (folder / '1.jpg').write_bytes((folder / '1.jpg').read_bytes()[:-30])
    (folder / '2.jpg').write_bytes(b'')
    source = open_source(folder)
    assert [frame.index for frame in source] == [0, 3]
    assert source.bad_frames == 2


def test_grey_stays_grey_and_16_bit_becomes_8(tmp_path: Path) -> None:
    grey = np.arange(256, dtype=np.uint8).reshape(16, 16)
    assert np.array_equal(decode_image(cv2.imencode('.png', grey)[1].tobytes(), 'grey'), grey)
    deep = decode_image(cv2.imencode('.png', grey.astype(np.uint16) * 256)[1].tobytes(), 'deep')
    assert deep.dtype == np.uint8
    assert np.array_equal(deep, grey)


@pytest.mark.parametrize('bits', [10, 12, 14])
@pytest.mark.parametrize('suffix', ['.png', '.tiff'])
def test_pictures_of_sensors_with_fewer_bits_keep_their_contrast(tmp_path: Path, suffix: str, bits: int) -> None:
    """A bright picture, then a dark one, as mono16 of a topic: the brightness does not follow what is in them."""
    bright = np.linspace(0, 2 ** bits - 1, 32 * 48).astype(np.uint16).reshape(32, 48)
    for index, samples in enumerate((bright, bright // 8)):
        cv2.imwrite(str(tmp_path / f'{index}{suffix}'), samples)
    images = [frame.image for frame in open_source(tmp_path)]
    for image, samples in zip(images, (bright, bright // 8), strict=True):
        np.testing.assert_array_equal(image, np.floor(samples / 2.0 ** bits * 256.0))


def test_video_stamps_are_those_of_the_container(tmp_path: Path) -> None:
    source = open_source(make_video(tmp_path / 'v.mp4'))
    frames = list(source)
    assert isinstance(source, VideoFile)
    assert source.frame_count == len(frames) == 12
    assert [frame.stamp_ns for frame in frames] == [START_NS + index * 100_000_000 for index in range(12)]
    # Lossy coding: the grey level within a few steps.
    assert all(abs(int(frame.image[24, 32, 1]) - 20 * frame.index) < 8 for frame in frames)


def test_pictures_that_a_hole_in_a_video_took_are_told(tmp_path: Path) -> None:
    """FFmpeg goes on behind the hole; each picture is a key frame here, as in what many drones record."""
    path, random = tmp_path / 'v.mkv', np.random.default_rng(0)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*'MJPG'), 25.0, (160, 120))
    for _ in range(40):
        writer.write(random.integers(0, 256, (120, 160, 3), np.uint8))
    writer.release()
    whole = open_source(path)
    assert len(list(whole)) == 40 and isinstance(whole, VideoFile) and whole.complaints == ()
    content = path.read_bytes()
    middle, hole = len(content) // 2, len(content) // 10
    path.write_bytes(content[:middle] + bytes(hole) + content[middle + hole:])
    holey = open_source(path)
    count = len(list(holey))
    assert isinstance(holey, VideoFile) and 30 < count < 40
    assert holey.complaints == (f'{40 - count} pictures are missing in 1 place(s) by the times of the container, '
                                'numbers of the frames after them are too small',)


@pytest.mark.parametrize('steps_ms', [
    {40.0: 100}, {}, {33.3: 20, 33.4: 9}, {33.0: 10, 40.0: 9, 90.0: 8, 120.0: 3}, {0.0: 5}, {40.0: 50, 59.0: 3}])
def test_nothing_is_missing_from_videos_that_are_whole_or_unsteady(steps_ms: dict[float, int]) -> None:
    assert not list(_missing(steps_ms))


@pytest.mark.parametrize('name', ['2024-05-01T12:00:00.mp4', 'http:a.mp4', 'file:a.mp4', 'clip%03d.mp4'])
def test_a_relative_name_is_a_file_and_no_protocol(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str,
) -> None:
    make_video(tmp_path / 'v.mp4').rename(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    source = open_source(name)
    assert (len(list(source)), source.name) == (12, name.removesuffix('.mp4'))


def test_fps_overrides_the_container(tmp_path: Path) -> None:
    source = open_source(make_video(tmp_path / 'v.avi'), fps=50)
    assert [frame.stamp_ns for frame in source][:3] == [START_NS + ns for ns in (0, 20_000_000, 40_000_000)]


def test_a_source_can_be_read_twice(tmp_path: Path) -> None:
    source = open_source(make_video(tmp_path / 'v.mp4', frames=3))
    assert [frame.stamp_ns for frame in source] == [frame.stamp_ns for frame in source]


def test_a_bag_is_known_by_its_content(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_image(np.zeros((20, 30, 3), np.uint8), 5)
    (tmp_path / 'a.mcap').rename(tmp_path / 'recording')
    assert isinstance(open_source(tmp_path / 'recording'), BagFrames)


def test_visdrone_folder_wants_numbered_pictures(tmp_path: Path) -> None:
    assert isinstance(visdrone_sequence(make_pictures(tmp_path / 'a', ['0000001.jpg'])), ImageSequence)
    with pytest.raises(SourceError, match=r'found holiday.jpg; expected a sequence folder with pictures 0000001.jpg'):
        visdrone_sequence(make_pictures(tmp_path / 'b', ['holiday.jpg']))


def test_missing_path(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match='nothing.mp4: no such file or folder'):
        open_source(tmp_path / 'nothing.mp4')


def test_wrong_folder_lists_what_is_there(tmp_path: Path) -> None:
    for name in ('sequences', 'annotations'):
        (tmp_path / name).mkdir()
    with pytest.raises(SourceError, match=r'found annotations/, sequences/; expected pictures .* image_02/data'):
        open_source(tmp_path)


def test_a_text_file_is_no_video(tmp_path: Path) -> None:
    (tmp_path / 'notes.txt').write_text('no video\n' * 100)
    with pytest.raises(SourceError, match='notes.txt: neither a bag'):
        open_source(tmp_path / 'notes.txt')
    (tmp_path / 'notes.txt').rename(tmp_path / 'notes.mp4')
    with pytest.raises(SourceError, match='notes.mp4: cannot be opened as a video'):
        open_source(tmp_path / 'notes.mp4')


def test_opencv_and_ffmpeg_are_quiet_about_it(tmp_path: Path) -> None:
    """In a process of its own: FFmpeg's log level is fixed by the first video of a process, written ones included."""
    (tmp_path / 'notes.mp4').write_text('no video\n' * 100)
    code = f'from motion_detect_ros.sources.opening import open_source; open_source({str(tmp_path / "notes.mp4")!r})'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.endswith('notes.mp4: cannot be opened as a video')
    assert done.stderr.startswith('Traceback') and 'moov' not in done.stderr and '[ WARN' not in done.stderr


def test_the_log_of_opencv_4_6_is_silenced_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenCV 4.6, the version of Ubuntu 24.04, has no ``cv2.utils.logging``; 0 is its LOG_LEVEL_SILENT."""
    levels: list[int] = []
    monkeypatch.delattr(cv2.utils, 'logging', raising=False)
    monkeypatch.setattr(cv2, 'setLogLevel', levels.append, raising=False)
    (tmp_path / 'broken.mp4').write_bytes(b'no video')
    with pytest.raises(SourceError, match='broken.mp4: cannot be opened as a video'):
        open_source(tmp_path / 'broken.mp4')
    assert levels == [0]


@pytest.mark.parametrize('fps', [0.0, -1.0, float('nan')])
def test_frame_rate_must_be_positive(tmp_path: Path, fps: float) -> None:
    with pytest.raises(SourceError, match='frame rate: expected a number over 0'):
        open_source(tmp_path, fps)


def test_what_is_there_and_holds_no_pictures_is_named(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / 'socket'))
        for path, kind in ((Path('/dev/null'), 'a device; a camera is for the camera node'),
                           (tmp_path / 'pipe', 'a pipe'), (tmp_path / 'socket', 'a socket')):
            for opened, expected in ((open_source, 'a file or folder'), (BagReader, 'a bag')):
                with pytest.raises(SourceError) as error:
                    opened(path)
                assert str(error.value) == f'{path}: expected {expected}, got {kind}'


def test_a_pipe_is_no_bag_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    found: list[bool] = []
    looking = threading.Thread(target=lambda: found.append(is_bag(tmp_path / 'pipe')), daemon=True)
    looking.start()
    looking.join(60.0)
    assert found == [False]


def absurd_png() -> bytes:
    """A header that promises 100,000 x 100,000 pixels."""
    chunks = struct.pack('>4sIIBBBBB', b'IHDR', 100_000, 100_000, 8, 0, 0, 0, 0), b'IEND'
    return b'\x89PNG\r\n\x1a\n' + b''.join(
        struct.pack('>I', len(chunk) - 4) + chunk + struct.pack('>I', zlib.crc32(chunk)) for chunk in chunks)


def test_a_picture_of_absurd_size_costs_itself_only(tmp_path: Path) -> None:
    for index in range(3):
        cv2.imwrite(str(tmp_path / f'{index}.png'), np.full((20, 30), index, np.uint8))
    (tmp_path / '1.png').write_bytes(absurd_png())
    with pytest.raises(SourceError, match='45 bytes that are no picture'):
        decode_image(absurd_png(), 'x')
    frames = image_folder(tmp_path, 10.0)
    assert [frame.index for frame in frames] == [0, 2]
    assert frames.bad_frames == 1


def test_names_with_digits_that_are_no_numbers_have_an_order(tmp_path: Path) -> None:
    for name in ('①.png', 'map10².png', '2.png', '10.png'):
        (tmp_path / name).touch()
    assert [file.name for file in image_files(tmp_path)][:2] == ['2.png', '10.png']


def test_a_name_that_is_no_utf_8_is_refused_and_shown(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b'/stra\xdfe.mp4'))
    path.touch()
    with pytest.raises(SourceError, match=r'stra\\xdfe.mp4: expected a name in UTF-8; rename it'):
        open_source(path)
