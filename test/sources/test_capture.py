"""Capture: real files and a real HTTP stream that breaks and comes back."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.benchmarks.jpeg_stream import JpegStream
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.capture import Capture
from motion_detect_ros.sources.live import LiveFrames

#: A safety net for what must come.
TIMEOUT_S = 300.0


@pytest.fixture
def pictures(tmp_path: Path) -> str:
    """Twenty small pictures."""
    for index in range(20):
        cv2.imwrite(str(tmp_path / f'{index:03d}.png'), np.full((24, 32), index, np.uint8))
    return str(tmp_path)


def test_a_device_is_a_camera_and_no_file() -> None:
    assert not Path('/dev/video987').exists()
    with pytest.raises(SourceError, match='^/dev/video987: cannot be opened as a camera$'):
        Capture('/dev/video987')
    with pytest.raises(SourceError, match='^/dev/null: expected a file or folder, got a device; '):
        Capture('/dev/null')


def read_all(capture: Capture) -> list[int]:
    indexes = []
    while (frame := capture.read(TIMEOUT_S)) is not None:
        indexes.append(frame.index)
    return indexes


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_without_real_time_nothing_is_lost(pictures: str) -> None:
    with Capture(pictures, queue_size=1, realtime=False) as capture:
        assert read_all(capture) == list(range(20))
        assert capture.ended
        stats = capture.stats
    assert (stats.captured, stats.delivered, stats.dropped, stats.behind) == (20, 20, 0, False)


@pytest.mark.parametrize(('selection', 'expected'), [
    ({'decimation_of': 3}, [0, 3, 6, 9, 12, 15, 18]),
    ({'decimation_keep': 2, 'decimation_of': 5}, [0, 1, 5, 6, 10, 11, 15, 16]),
])
def test_selection(pictures: str, selection: dict[str, int], expected: list[int]) -> None:
    with Capture(pictures, realtime=False, **selection) as capture:
        assert read_all(capture) == expected
        assert (capture.stats.captured, capture.stats.dropped) == (20, 0)


def test_a_slow_reader_gets_the_newest_and_is_told(pictures: str) -> None:
    with Capture(pictures, fps=200, queue_size=2) as capture:
        until(lambda: capture.stats.dropped == 18)
        indexes = read_all(capture)
        stats = capture.stats
    assert indexes == [18, 19]
    assert (stats.captured, stats.delivered, stats.dropped, stats.behind) == (20, 2, 18, True)


SECOND_NS, DATE_S = 1_000_000_000, 1_700_000_000


@pytest.mark.parametrize(('seconds', 'least_s'), [
    ([0.0, *(DATE_S + index / 10 for index in range(5))], 0.4),              # the driver had no time yet
    ([DATE_S, DATE_S + 0.1, 2_147_483_647, DATE_S + 0.2, DATE_S + 0.3], 0.2),  # one absurd stamp in between
    ([*(DATE_S + 3600 + index / 10 for index in range(5)), *(DATE_S + index / 10 for index in range(5))], 0.8),
    ([DATE_S, DATE_S + 0.1, DATE_S + 90.0, DATE_S + 90.1], 0.2),             # the recorder was paused
])
def test_a_jump_of_the_stamps_neither_stops_a_file_nor_has_it_rush(
    tmp_path: Path, seconds: list[float], least_s: float,
) -> None:
    with BagWriter(tmp_path / 'flight.mcap') as writer:
        for index, stamp_s in enumerate(seconds):
            picture = messages.image(np.full((24, 32), index, np.uint8), round(stamp_s * SECOND_NS), 'eye')
            writer.write('/image_raw', picture, (index + 1) * SECOND_NS // 10)
    start = time.monotonic()
    with Capture(str(tmp_path / 'flight.mcap'), queue_size=len(seconds)) as capture:
        assert read_all(capture) == list(range(len(seconds)))
    assert time.monotonic() - start >= least_s


@pytest.mark.timing
def test_files_play_at_their_own_pace(pictures: str) -> None:
    with Capture(pictures, fps=40) as capture:
        start = time.monotonic()
        assert len(read_all(capture)) == 20
        elapsed = time.monotonic() - start
        rate = capture.stats.capture_rate_hz
    assert elapsed == pytest.approx(19 / 40, abs=0.2)
    assert rate == pytest.approx(40, rel=0.2)


def test_whatever_breaks_a_source_is_not_its_end(pictures: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: Capture) -> None:
        raise cv2.error('cannot decode')

    monkeypatch.setattr(Capture, '_paced_frames', broken)
    with Capture(pictures, fps=100.0) as capture, pytest.raises(SourceError, match='error: cannot decode'):
        capture.read(TIMEOUT_S)


def test_read_gives_none_after_its_timeout(pictures: str) -> None:
    with Capture(pictures, fps=0.01) as capture:  # the next one comes in 100 s
        assert capture.read(TIMEOUT_S) is not None
        assert capture.read(0.05) is None
        assert not capture.ended


def test_closing_does_not_wait_for_a_blocked_thread(pictures: str) -> None:
    with Capture(pictures, queue_size=1, realtime=False) as capture:
        capture.read(TIMEOUT_S)
        assert readers() == ['capture']
    assert readers() == []
    assert not capture.blocked


@pytest.mark.parametrize('source', ['/no/such/file.mp4', 'http://127.0.0.1:9/stream', '87', '²', '9' * 30])
def test_unopenable_sources_are_refused(source: str) -> None:
    with pytest.raises(SourceError, match=source.lstrip('/')):
        Capture(source)


@pytest.mark.parametrize('selection', [
    {'decimation_of': 0}, {'decimation_keep': 3, 'decimation_of': 2}, {'decimation_keep': 0}, {'queue_size': 0}])
def test_senseless_selection_is_refused(pictures: str, selection: dict[str, int]) -> None:
    with pytest.raises(SourceError, match='capture: expected queue_size >= 1 and 1 <= decimation_keep'):
        Capture(pictures, **selection)


def film(path: Path) -> Path:
    """Ten frames, 1 s."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*'MJPG'), 10.0, (64, 48))
    for index in range(10):
        writer.write(np.full((48, 64, 3), 20 * index, np.uint8))
    writer.release()
    return path


def test_a_file_address_is_played_as_a_file(tmp_path: Path) -> None:
    with Capture(f'file://{film(tmp_path / "film.avi")}', realtime=False) as capture:
        assert [capture.read(TIMEOUT_S) is not None for _ in range(11)] == [True] * 10 + [False]
        assert capture.ended


@pytest.mark.parametrize('name', ['film.avi', 'film.mkv', 'film.mp4'])
def test_a_recording_on_a_web_server_is_no_live_stream(tmp_path: Path, name: str) -> None:
    """It would be read as fast as the network is, over and over, and stamped with the time of day."""
    film(tmp_path / name)
    files = ThreadingHTTPServer(('127.0.0.1', 0), partial(SimpleHTTPRequestHandler, directory=str(tmp_path)))
    threading.Thread(target=files.serve_forever, daemon=True).start()
    try:
        with pytest.raises(SourceError, match=f'{name}: expected a live stream, got a recording of 10 frames'):
            Capture(f'http://127.0.0.1:{files.server_port}/{name}')
    finally:
        files.shutdown()
        files.server_close()


@pytest.fixture
def stream() -> Iterator[JpegStream]:
    with JpegStream([np.full((48, 64, 3), 128, np.uint8)], rate_hz=50.0) as camera:
        yield camera


def test_a_stream_that_breaks_is_opened_again(stream: JpegStream) -> None:
    before = time.time_ns()
    with Capture(stream.address) as capture:
        frames = []
        deadline = time.monotonic() + TIMEOUT_S
        while capture.stats.reconnects < 2 and time.monotonic() < deadline:
            if (frame := capture.read(0.5)) is not None:
                frames.append(frame)
                if len(frames) % 10 == 0:
                    stream.cut()
        reconnects = capture.stats.reconnects
    assert reconnects >= 2
    assert len(frames) > 10
    stamps = [frame.stamp_ns for frame in frames]
    assert before < stamps[0]
    assert stamps == sorted(set(stamps))


def readers() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name == 'capture']


def test_closing_a_stalled_stream_lets_go_of_it(stream: JpegStream) -> None:
    with Capture(stream.address) as capture:
        assert capture.read(TIMEOUT_S) is not None
        stream.freeze()
        while capture.read(1.0) is not None:
            pass
    assert readers() == []
    assert not capture.blocked
    until(lambda: stream.connections == 0)


def test_closing_a_stream_that_was_never_read_lets_go_of_it(stream: JpegStream) -> None:
    capture = Capture(stream.address)
    stream.freeze()
    assert stream.connections == 1
    capture.close()
    assert not capture.blocked
    until(lambda: stream.connections == 0)


def test_nobody_is_asked_why_a_camera_does_not_open_after_the_stop(
    stream: JpegStream, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The stop comes while the stream is being opened again, which fails."""
    asked = list[str]()
    frames = LiveFrames(stream.address)

    def black_hole() -> None:
        frames.stop()
        raise SourceError('no picture')

    monkeypatch.setattr('motion_detect_ros.sources.live.why_unreachable', lambda source: asked.append(source) or '')
    monkeypatch.setattr('motion_detect_ros.sources.live.FIRST_BACK_OFF_S', 0.0)
    monkeypatch.setattr(frames, '_open', black_hole)
    frames.release()
    assert list(frames) == []
    assert asked == []


def test_a_driver_that_does_not_come_back_is_told(pictures: str, monkeypatch: pytest.MonkeyPatch) -> None:
    back = threading.Event()

    def stuck(self: Capture) -> Iterator[None]:
        yield from iter(back.wait, True)

    monkeypatch.setattr(Capture, '_paced_frames', stuck)
    monkeypatch.setattr('motion_detect_ros.sources.capture._JOIN_TIMEOUT_S', 0.2)
    with Capture(pictures) as capture:
        pass
    assert capture.blocked
    back.set()
    capture.close()
    assert not capture.blocked


@pytest.mark.parametrize('jump_s', [3e9, 1e6, -1e6])
def test_no_picture_is_waited_for_longer_than_a_day(tmp_path: Path, jump_s: float) -> None:
    """One stamp that is far away from the others, or all from there on."""
    for name, odd in (('one', [3]), ('all', range(3, 6))):
        path = tmp_path / f'{name}.mcap'
        with BagWriter(path) as writer:
            for index in range(6):
                image = messages.image(np.full((24, 32), index, np.uint8), 0, 'camera')
                image.header.stamp.sec, image.header.stamp.nanosec = 10**9, index * 10**7
                if index in odd:  # seconds that a header can hold, and those that it cannot
                    image.header.stamp.sec = round(min(10**9 + jump_s, 2**31 - 1))
                    image.header.stamp.nanosec += 10**9 * (jump_s > 2**31)
                writer.write('/image_raw', image, index)
        with Capture(str(path), queue_size=6) as capture:
            found = []
            while (frame := capture.read(10.0)) is not None:
                found.append(frame.index)
            assert found == [*range(6)]
