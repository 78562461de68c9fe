"""Pictures whose headers promise more pixels than any camera has are refused before memory is taken for them."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from peak_memory import PEAK_BYTES

from motion_detect_ros.sources.bags import BagWriter

LIMIT = 'OPENCV_IO_MAX_IMAGE_PIXELS'
MEMORY_BYTES = 600 << 20
#: In a process of its own, as OpenCV reads the limit when it is loaded.
CODE = PEAK_BYTES + '''
import sys
from pathlib import Path
from motion_detect_ros.core.errors import MotionDetectError
from motion_detect_ros.sources.opening import open_source
from motion_detect_ros.sources.images import decode_image
for name in sys.argv[2:]:
    try:
        print(decode_image(Path(name).read_bytes(), Path(name).name).shape)
    except MotionDetectError as error:
        print(error)
source = open_source(sys.argv[1])
print([frame.index for frame in source], source.bad_frames)
print(peak_bytes())
'''


def encoded(suffix: str) -> bytes:
    return cv2.imencode(suffix, np.full((16, 16, 3), 99, np.uint8))[1].tobytes()


def png(width: int, height: int) -> bytes:
    """Whole by its chunks, with the pixels of a few rows."""
    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack('>I', len(content)) + kind + content + struct.pack('>I', zlib.crc32(kind + content))
    header = struct.pack('>IIBBBBB', width, height, 8, 2, 0, 0, 0)
    return b'\x89PNG\r\n\x1a\n' + b''.join((
        chunk(b'IHDR', header), chunk(b'IDAT', zlib.compress(bytes(1000))), chunk(b'IEND', b'')))


def jpeg(width: int, height: int) -> bytes:
    content = encoded('.jpg')
    place = content.index(b'\xff\xc0') + 5
    return content[:place] + struct.pack('>HH', height, width) + content[place + 4:]


def bmp(width: int, height: int) -> bytes:
    content = encoded('.bmp')
    return content[:18] + struct.pack('<ii', width, height) + content[26:]


def tiff(width: int, height: int) -> bytes:
    """Tags 256 and 257 are width and height, 4 bytes or 2 of their own type."""
    content = bytearray(encoded('.tiff'))
    place = int.from_bytes(content[4:8], 'little')
    for entry in range(int.from_bytes(content[place:place + 2], 'little')):
        at = place + 2 + 12 * entry
        if (tag := int.from_bytes(content[at:at + 2], 'little')) in (256, 257):
            content[at:at + 12] = struct.pack('<HHII', tag, 4, 1, width if tag == 256 else height)
    return bytes(content)


HUGE = {
    'a.png': png(20_000, 20_000), 'b.jpg': jpeg(20_000, 20_000), 'c.bmp': bmp(20_000, 20_000),
    'd.ppm': b'P6\n20000 20000\n255\n' + bytes(99), 'e.pgm': b'P5\n20000 20000\n255\n' + bytes(99),
    'f.tiff': tiff(20_000, 20_000), 'g.ppm': b'P6\n2000000 3\n255\n' + bytes(99)}


def decoded(files: list[Path], limit: str | None = None, source: Path | None = None) -> list[str]:
    environment = {name: value for name, value in os.environ.items() if name != LIMIT}
    done = subprocess.run(
        [sys.executable, '-c', CODE, str(source or files[0].parent), *map(str, files)], capture_output=True, text=True,
        check=True, env=environment | ({LIMIT: limit} if limit else {}))
    return done.stdout.splitlines()


def test_pictures_of_absurd_size_are_refused_and_take_no_memory(tmp_path: Path) -> None:
    for name, content in {**HUGE, 'y.png': encoded('.png'), 'z.webp': encoded('.webp')}.items():
        (tmp_path / name).write_bytes(content)
    *said, folder, memory = decoded(sorted(tmp_path.iterdir()))
    assert said[:len(HUGE)] == [
        f'{name}: expected a picture of at most 100000000 pixels ({LIMIT}) and 1048576 a side, got a larger one'
        for name in HUGE]
    assert said[len(HUGE):] == ['(16, 16, 3)', '(16, 16, 3)']
    assert folder == '[7, 8] 7'
    assert int(memory) < MEMORY_BYTES


def test_a_huge_picture_in_a_bag_costs_itself(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for index, content in enumerate((encoded('.png'), HUGE['a.png'], HUGE['b.jpg'], encoded('.jpg'))):
            bag.write_compressed(content, 'png', 10**9 * (index + 1))
    folder, memory = decoded([], source=tmp_path / 'a.mcap')
    assert folder == '[0, 3] 2'
    assert int(memory) < MEMORY_BYTES


@pytest.mark.parametrize(('limit', 'answer'), [
    ('255', f'a.png: expected a picture of at most 255 pixels ({LIMIT}) and 1048576 a side, got a larger one'),
    ('256', '(16, 16, 3)')])
def test_the_limit_is_that_of_the_environment_where_it_is_given(tmp_path: Path, limit: str, answer: str) -> None:
    (tmp_path / 'a.png').write_bytes(encoded('.png'))
    assert decoded([tmp_path / 'a.png'], limit)[0] == answer
