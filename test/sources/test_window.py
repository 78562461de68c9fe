"""Windows: which pictures of a recording are given, from whatever it is."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.opening import open_source
from motion_detect_ros.sources.window import WHOLE, Choice, Selection, Window

FRAMES, PERIOD_NS = 20, 100_000_000


def grey(index: int) -> np.ndarray:
    return np.full((48, 64, 3), 10 * index, np.uint8)


def bag(folder: Path) -> Path:
    with BagWriter(folder / 'a.mcap') as writer:
        for index in range(FRAMES):
            writer.write_image(grey(index), 10**18 + index * PERIOD_NS)
    return folder / 'a.mcap'


def pictures(folder: Path) -> Path:
    for index in range(FRAMES):
        cv2.imwrite(str(folder / f'{index:07d}.png'), grey(index))
    return folder


def video(folder: Path) -> Path:
    writer = cv2.VideoWriter(str(folder / 'a.avi'), cv2.VideoWriter_fourcc(*'MJPG'), 10.0, (64, 48))
    for index in range(FRAMES):
        writer.write(grey(index))
    writer.release()
    return folder / 'a.avi'


def kitti_drive(folder: Path) -> Path:
    data = folder / '2011_09_26_drive_0001_sync' / 'image_02' / 'data'
    data.mkdir(parents=True)
    for index in range(FRAMES):
        cv2.imwrite(str(data / f'{index:010d}.png'), grey(index))
    stamps = [f'2011-09-26 13:02:{25 + index // 10}.{index % 10}00000000' for index in range(FRAMES)]
    (data.parent / 'timestamps.txt').write_text('\n'.join(stamps) + '\n')
    return data.parent.parent


#: At 10 frames/s.
WINDOWS = {
    'whole': (WHOLE, list(range(20))),
    'from a moment on': (Window(start_s=1.5), [15, 16, 17, 18, 19]),
    'for a while': (Window(duration_s=0.3), [0, 1, 2]),
    'in the middle': (Window(start_s=0.5, duration_s=0.4), [5, 6, 7, 8]),
    'between two pictures': (Window(start_s=0.45, duration_s=0.1), [5]),
    'every third': (Window(every=3), [0, 3, 6, 9, 12, 15, 18]),
    'every fourth from the first of the window on': (Window(start_s=0.5, duration_s=1.0, every=4), [5, 9, 13]),
    'after the end': (Window(start_s=2.0), []),
    'longer than there is': (Window(start_s=1.8, duration_s=99.0), [18, 19]),
}


@pytest.mark.parametrize('name', WINDOWS)
@pytest.mark.parametrize('make', [bag, pictures, video, kitti_drive])
def test_pictures_of_a_window_keep_their_numbers_and_stamps(make: Callable[[Path], Path], name: str, tmp_path: Path):
    window, expected = WINDOWS[name]
    path = make(tmp_path)
    whole = {frame.index: frame for frame in open_source(path, fps=10.0)}
    source = open_source(path, fps=10.0, window=window)
    frames = [*source]
    assert [frame.index for frame in frames] == expected
    assert [frame.stamp_ns for frame in frames] == [whole[index].stamp_ns for index in expected]
    assert all(abs(float(frame.image.mean()) - 10 * frame.index) < 2 for frame in frames)
    assert (source.frame_count, source.damaged, source.bad_frames) == (FRAMES, None, 0)
    assert [frame.index for frame in source] == expected, 'another pass gives the same'


def test_the_window_of_a_bag_is_by_the_times_of_recording(tmp_path: Path):
    """As the clock of a camera may jump."""
    with BagWriter(tmp_path / 'a.mcap') as writer:
        for index, stamp_ns in enumerate([0, 10**18, 10**18 + PERIOD_NS]):
            writer.write('/image_raw', _image(stamp_ns), 10**18 + index * PERIOD_NS)
    source = open_source(tmp_path / 'a.mcap', window=Window(start_s=0.1))
    assert [frame.stamp_ns for frame in source] == [10**18, 10**18 + PERIOD_NS]


@pytest.mark.parametrize(('window', 'expected'), [
    (WHOLE, [0, 1, 2, 3, 4, 5, 6, 7]),
    (Window(every=3), [0, 3, 6]),
    (Window(start_s=0.1), [1, 2, 3, 4, 5, 6, 7]),
    (Window(start_s=0.4), [5, 6, 7]),
    (Window(duration_s=0.3), [0, 1, 2]),
    (Window(start_s=0.1, duration_s=0.4), [1, 2, 3, 4, 5]),
])
@pytest.mark.parametrize('step_s', [-3600, -9.5e8, 9.5e8])
def test_a_clock_that_is_set_loses_nothing(tmp_path: Path, window: Window, expected: list[int], step_s: float):
    """Four pictures, the clock is set, four more: 0, 0.1, 0.2, 0.3 and 0.3, 0.4, 0.5, 0.6 s that were recorded."""
    recorded = bag_recorded_at(tmp_path, [index / 10 + (step_s if index > 3 else 0) for index in range(8)])
    assert numbers(recorded, window) == expected


@pytest.mark.parametrize(('window', 'expected'), [
    (WHOLE, [0, 1, 2, 3, 4, 5, 6, 7]), (Window(start_s=0.5), [5, 6, 7]), (Window(duration_s=0.6), [0, 1, 2, 3, 4, 5])])
@pytest.mark.parametrize('odd_s', [-3600, 43_200])
def test_one_wrong_time_of_recording_moves_no_window(
    tmp_path: Path, window: Window, expected: list[int], odd_s: float,
):
    recorded = bag_recorded_at(tmp_path, [odd_s if index == 2 else index / 10 for index in range(8)])
    assert numbers(recorded, window) == expected


def bag_recorded_at(folder: Path, times_s: list[float]) -> Path:
    """Pictures of 10 frames/s by the camera's clock, recorded at these times after 2001-09-09; a chunk each, as readers
    sort within a chunk.
    """
    with BagWriter(folder / 'a.mcap', chunk_bytes=1) as writer:
        for index, time_s in enumerate(times_s):
            writer.write('/image_raw', _image(10**18 + index * PERIOD_NS), 10**18 + round(time_s * 10) * PERIOD_NS)
    return folder / 'a.mcap'


def numbers(recorded: Path, window: Window) -> list[int]:
    """Of the pictures of a window, by their own stamps."""
    frames = [*open_source(recorded, window=window)]
    assert [(frame.stamp_ns - 10**18) // PERIOD_NS for frame in frames] == [frame.index for frame in frames]
    return [frame.index for frame in frames]


def test_stamps_of_a_drive_that_go_back_lose_no_picture(tmp_path: Path):
    drive = kitti_drive(tmp_path)
    stamps = drive / 'image_02' / 'timestamps.txt'
    lines = stamps.read_text().splitlines()
    stamps.write_text('\n'.join(lines[:5] + [line.replace(' 13:', ' 12:') for line in lines[5:]]) + '\n')
    assert [frame.index for frame in open_source(drive)] == list(range(FRAMES))
    assert [frame.index for frame in open_source(drive, window=Window(start_s=0.3))] == list(range(3, FRAMES))


def _image(stamp_ns: int) -> object:
    from motion_detect_ros.sources import messages
    return messages.image(grey(1), stamp_ns, 'camera')


def test_what_is_left_out_is_not_decoded(tmp_path: Path):
    """Broken pictures outside of the window are nobody's business."""
    folder = pictures(tmp_path)
    for index in (0, 1, 19):
        (folder / f'{index:07d}.png').write_bytes(b'broken')
    source = open_source(folder, fps=10.0, window=Window(start_s=0.2, duration_s=1.0))
    assert [frame.index for frame in source] == list(range(2, 12))
    assert source.bad_frames == 0


def test_a_folder_that_goes_while_it_is_read_is_said(tmp_path: Path):
    (tmp_path / 'p').mkdir()
    frames = iter(open_source(pictures(tmp_path / 'p'), fps=10.0))
    next(frames)
    shutil.rmtree(tmp_path / 'p')
    with pytest.raises(SourceError, match=r'p: the folder has gone while it was read$'):
        next(frames)


@pytest.mark.parametrize(('values', 'message'), [
    ({'start_s': -1.0}, 'start: expected a number of seconds from 0 on, got -1'),
    ({'start_s': float('nan')}, 'start: expected a number of seconds from 0 on, got nan'),
    ({'duration_s': 0.0}, 'duration: expected a number of seconds over 0, got 0'),
    ({'duration_s': float('inf')}, 'duration: expected a number of seconds over 0, got inf'),
    ({'every': 0}, 'every: expected 1 or more, got 0'),
])
def test_windows_that_are_none(values: dict[str, float], message: str):
    with pytest.raises(SourceError) as caught:
        Window(**values)
    assert str(caught.value) == message


def test_the_first_picture_begins_the_window_whatever_its_stamp():
    selection = Selection(Window(start_s=1.0, duration_s=1.0))
    stamps = [5 * 10**9, 6 * 10**9 - 1, 6 * 10**9, 7 * 10**9 - 1, 7 * 10**9]
    assert [selection.judge(index, stamp) for index, stamp in enumerate(stamps)] == [
        Choice.SKIP, Choice.SKIP, Choice.TAKE, Choice.TAKE, Choice.END]
