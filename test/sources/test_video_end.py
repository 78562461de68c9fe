"""Sound videos that OpenCV expects more frames of, and those that are cut off or damaged."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.sources.opening import open_source

av = pytest.importorskip('av', reason='PyAV is not installed (extra "report")')

FRAMES = 60
EVEN = [40 * index for index in range(FRAMES)]
VARIABLE = [40 * index for index in range(FRAMES // 2)] + [1200 + 120 * index for index in range(FRAMES // 2)]


def video(path: Path, times_ms: list[int], sound_s: int = 0, trim_ms: int = 0, **options: str) -> Path:
    """Noise at these times, MPEG-4; trim_ms: so much of the start is hidden, as ffmpeg -ss does without coding anew."""
    rng = np.random.default_rng(0)
    with av.open(str(path), 'w', options=options) as container:
        stream = container.add_stream('mpeg4', rate=25)
        stream.width = stream.height = 64
        stream.pix_fmt = 'yuv420p'
        stream.codec_context.time_base = Fraction(1, 1000)
        sound = container.add_stream('aac', rate=8000) if sound_s else None
        packets = []
        for time_ms in times_ms:
            frame = av.VideoFrame.from_ndarray(rng.integers(0, 256, (64, 64, 3), np.uint8), format='rgb24')
            frame.pts, frame.time_base = time_ms, Fraction(1, 1000)
            packets += stream.encode(frame)
        for packet in [*packets, *stream.encode(None)]:
            packet.pts, packet.dts = packet.pts - trim_ms, packet.dts - trim_ms
            container.mux(packet)
        if sound:
            silence = av.AudioFrame.from_ndarray(np.zeros((1, 8000 * sound_s), np.float32), 'fltp', 'mono')
            silence.sample_rate = 8000
            container.mux([*sound.encode(silence), *sound.encode(None)])
    return path


@pytest.mark.parametrize(('name', 'times_ms', 'more', 'frames'), [
    ('even.mkv', EVEN, {}, FRAMES), ('variable.mkv', VARIABLE, {}, FRAMES),
    ('sound.mkv', EVEN, {'sound_s': 5}, FRAMES), ('late.mkv', [5000 + ms for ms in EVEN], {}, FRAMES),
    ('variable.avi', VARIABLE, {}, FRAMES), ('even.ts', EVEN, {}, FRAMES),
    ('variable.mp4', VARIABLE, {}, FRAMES), ('trimmed.mp4', EVEN, {'trim_ms': 1000}, FRAMES - 25),
    ('parts.mp4', EVEN, {'movflags': 'frag_keyframe+empty_moov'}, FRAMES)])
def test_a_sound_video_is_not_called_damaged(tmp_path: Path, name, times_ms, more, frames) -> None:
    source = open_source(video(tmp_path / name, times_ms, **more))
    assert len(list(source)) == frames
    assert source.damaged is None


def test_what_a_camera_appends_to_a_video_is_not_missing(tmp_path: Path) -> None:
    path = video(tmp_path / 'even.mp4', EVEN)
    with path.open('ab') as file:
        file.write(b'\xff\xff\xff\xff model \0\0\0\2' * 20)
    assert open_source(path).damaged is None


class Pipe:
    """A file that is written from front to back only, as ``ffmpeg -f avi - > a.avi`` does."""

    def __init__(self, path: Path) -> None:
        self._file = path.open('wb', buffering=0)

    def write(self, data: bytes) -> int:
        return self._file.write(data)

    def writable(self) -> bool:
        return True

    def readable(self) -> bool:
        return False

    def seekable(self) -> bool:
        return False


@pytest.mark.parametrize('kind', ['avi', 'matroska', 'mpegts'])
def test_a_video_that_was_written_to_a_pipe_is_not_called_damaged(tmp_path: Path, kind: str) -> None:
    """Nobody came back to write how long it has become."""
    path = tmp_path / {'avi': 'a.avi', 'matroska': 'a.mkv', 'mpegts': 'a.ts'}[kind]
    with av.open(Pipe(path), 'w', format=kind) as container:
        stream = container.add_stream('mpeg4', rate=25)
        stream.width = stream.height = 64
        stream.pix_fmt = 'yuv420p'
        rng = np.random.default_rng(0)
        for _ in range(10):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(
                rng.integers(0, 256, (64, 64, 3), np.uint8), format='rgb24')))
        container.mux(stream.encode(None))
    source = open_source(path)
    assert len(list(source)) == 10
    assert source.damaged is None


@pytest.mark.parametrize('share', [0.5, 0.98])
@pytest.mark.parametrize('name', ['sound.mkv', 'even.avi', 'even.mp4'])
def test_a_video_that_is_cut_off_is_told(tmp_path: Path, name: str, share: float) -> None:
    path = video(tmp_path / name, EVEN, 5 if name == 'sound.mkv' else 0, movflags='faststart')
    whole = path.read_bytes()
    path.write_bytes(whole[:int(share * len(whole))])
    source = open_source(path)
    assert 0 < len(list(source)) <= FRAMES
    assert source.damaged == f'cut off after {int(share * len(whole))} of {len(whole)} bytes'


def test_a_hole_that_ends_a_video_early_is_told(tmp_path: Path) -> None:
    path = video(tmp_path / 'hole.mp4', EVEN)
    content = path.read_bytes()
    half = len(content) // 2
    path.write_bytes(content[:half] + bytes(2000) + content[half + 2000:])
    source = open_source(path)
    readable = len(list(source))
    assert 0 < readable < FRAMES
    assert source.damaged == f'unreadable after {readable} frames'
