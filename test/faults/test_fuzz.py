"""Damaged bytes give an answer or one error of our own, whatever is damaged; what once did not is in corpus/."""

from __future__ import annotations

import random
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from peak_memory import PEAK_BYTES
from sensor_msgs.msg import CompressedImage, Image, PointCloud2, PointField

from motion_detect_ros.bridge.images import flow_from_msg, header_of, image_from_msg, image_to_msg
from motion_detect_ros.bridge.load import Stage, StageTime, load_from_msg, load_to_msg
from motion_detect_ros.bridge.records import detections_to_msg, ego_from_msg, ego_to_msg, read_detections
from motion_detect_ros.core.ego_motion.stage import no_estimate
from motion_detect_ros.core.errors import MotionDetectError, SourceError
from motion_detect_ros.core.types import EgoStatus, empty_detections
from motion_detect_ros.sources.bags import BagFrames, BagReader, BagWriter
from motion_detect_ros.sources.encoding import FLOW_ENCODING
from motion_detect_ros.sources.images import decode_image
from motion_detect_ros.sources.truth import read_truth

CORPUS = Path(__file__).parent / 'corpus'
#: Mutations of each target; one may take so long, seconds (a bomb would take minutes or the memory).
MUTATIONS = 2000
SLOW_S = 20.0
EXTREMES = (0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)
WORDS = ('', 'mono8', 'bgr8', '8UC1', '16UC1', '32FC2', '64FC9', 'bayer_rggb8', 'yuv422', 'nonsense', 'x' * 300)


def mutated(chance: random.Random, data: bytes) -> bytes:
    """Bits flipped, bytes replaced, numbers made extreme, parts cut off, doubled or taken out."""
    found = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        place, what = chance.randrange(len(found) + 1), chance.randrange(6)
        end = min(len(found), place + chance.choice((1, 4, 8, 64, 1024)))
        if what == 0 and found[place:]:
            found[place] ^= 1 << chance.randrange(8)
        elif what == 1:
            found[place:end] = chance.randbytes(end - place)
        elif what == 2:
            found[place:place + 8] = struct.pack('<Q', chance.choice(EXTREMES))
        elif what == 3:
            del found[place:]
        elif what == 4:
            found[place:place] = found[place:end]
        else:
            del found[place:end]
    return bytes(found)


def survives(action: Callable[[], object], what: object) -> None:
    began = time.monotonic()
    try:
        action()
    except MotionDetectError as error:
        assert str(error)
        assert '\n' not in str(error)
    except Exception as error:
        raise AssertionError(f'{type(error).__name__} of {what!r}'[:2000]) from error
    assert time.monotonic() - began < SLOW_S, what


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp('fuzz') / 'a.mcap'
    with BagWriter(path, chunk_bytes=2000) as writer:
        for index in range(4):
            writer.write_image(np.full((8, 12), 20 * index, np.uint8), index * 10**8)
            writer.write_detections(empty_detections(2), index * 10**8)
    return path.read_bytes()


def read_whole(path: Path) -> None:
    with BagReader(path) as reader:
        _ = reader.topics
        list(reader.messages())
    list(BagFrames(path, None))


def test_bags(bag: bytes, tmp_path: Path, shown):
    chance, path = random.Random(11), tmp_path / 'a.mcap'
    for number in range(MUTATIONS):
        data = mutated(chance, bag)
        path.write_bytes(data)
        survives(lambda: read_whole(path), (number, data[:200]))
    shown('damaged bytes', 'an answer, or one line of our own error', f'{MUTATIONS} MCAP files')


def test_bags_cut_off_anywhere(bag: bytes, tmp_path: Path):
    path = tmp_path / 'a.mcap'
    for length in range(0, len(bag), 3):
        path.write_bytes(bag[:length])
        survives(lambda: read_whole(path), length)


@pytest.mark.parametrize('path', sorted(CORPUS.iterdir()), ids=lambda path: path.name)
def test_corpus(path: Path):
    if path.suffix == '.mcap':
        survives(lambda: read_whole(path), path.name)
    elif path.suffix == '.png':
        survives(lambda: decode_image(path.read_bytes(), path.name), path.name)
    else:
        survives(lambda: read_truth(path), path.name)


def test_truth(tmp_path: Path, shown):
    chance = random.Random(12)
    rows = '\n'.join(f'{frame},1,{10 * frame},20,30,40,1' for frame in range(5))
    for number in range(MUTATIONS):
        suffix = chance.choice(('.csv', '.txt'))
        path = tmp_path / f'truth{suffix}'
        header = 'frame,id,x,y,w,h,moving\n' if suffix == '.csv' else ''
        data = mutated(chance, (header + rows).encode())
        path.write_bytes(data)
        survives(lambda path=path: read_truth(path), (number, data))
    shown('damaged bytes', 'an answer, or one line of our own error', f'{MUTATIONS} truth files')


def odd_image(chance: random.Random, image: Image) -> Image:
    pixels = chance.choice((bytes(image.data), chance.randbytes(chance.randrange(400))))
    return Image(header=image.header, data=pixels, is_bigendian=chance.randrange(3),
                 height=chance.choice((image.height, *EXTREMES[:5], chance.randrange(64))),
                 width=chance.choice((image.width, *EXTREMES[:5], chance.randrange(64))),
                 step=chance.choice((image.step, *EXTREMES[:5], chance.randrange(400))),
                 encoding=chance.choice((image.encoding, *WORDS)))


def test_images(shown):
    chance, image = random.Random(13), image_to_msg(np.zeros((8, 12, 3), np.uint8), header_of(1, 'a'))
    for _ in range(MUTATIONS):
        odd = odd_image(chance, image)
        survives(lambda odd=odd: image_from_msg(odd), odd)
        odd.encoding = FLOW_ENCODING
        survives(lambda odd=odd: flow_from_msg(odd), odd)
    shown('damaged bytes', 'an answer, or one line of our own error', f'{2 * MUTATIONS} images and flows')


@pytest.mark.parametrize('suffix', ['.jpg', '.png'])
def test_compressed_images(suffix: str, shown):
    chance = random.Random(14)
    _, data = cv2.imencode(suffix, np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8))
    for _ in range(MUTATIONS // 2):
        odd = CompressedImage(format=suffix, data=mutated(chance, data.tobytes()))
        survives(lambda odd=odd: image_from_msg(odd), bytes(odd.data))
    shown('damaged bytes', 'an answer, or one line of our own error', f'{MUTATIONS // 2} pictures {suffix}')


#: In a process of its own, whose peak of memory nothing else has raised.
DECODING = PEAK_BYTES + """
import sys
from pathlib import Path
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.images import decode_image

before = peak_bytes()
try:
    decode_image(Path(sys.argv[1]).read_bytes(), 'odd')
except SourceError as error:
    print(error)
print((peak_bytes() - before) // 1024)
"""


def test_a_picture_whose_damage_asks_for_gigabytes_gets_none():
    """Its 1444 bytes made OpenCV take 3.5 GB for a chunk: the end of a node on a small computer."""
    said, taken_kb = subprocess.run(
        [sys.executable, '-c', DECODING, str(CORPUS / 'chunk_announces_3_5_gb.png')], capture_output=True, text=True,
        check=True, timeout=100.0).stdout.splitlines()
    assert said == 'odd: PNG is cut off after 1444 bytes'
    assert int(taken_kb) < 100_000


@pytest.mark.parametrize('share', [0.1, 0.5, 0.9, 0.999])
def test_a_png_that_is_cut_off_is_no_picture(share: float):
    whole = cv2.imencode('.png', np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8))[1].tobytes()
    assert decode_image(whole + b'padding', 'a').shape == (24, 32, 3)
    with pytest.raises(SourceError, match=r'a: PNG is cut off after \d+ bytes'):
        decode_image(whole[:int(share * len(whole))], 'a')


def odd_records(chance: random.Random, message: PointCloud2) -> PointCloud2:
    def rarely(usual: int, *others: int) -> int:
        return chance.choice(others) if chance.random() < 0.25 else usual

    fields = [PointField(name=chance.choice((field.name, field.name, field.name, 'u')),
                         offset=rarely(field.offset, *EXTREMES[:5]),
                         datatype=rarely(field.datatype, chance.randrange(256)),
                         count=chance.choice((1, 0, 7))) for field in message.fields]
    return PointCloud2(
        header=message.header, fields=fields[:chance.choice((len(fields), chance.randrange(len(fields))))],
        height=chance.choice((1, 1, *EXTREMES[:5])), width=chance.choice((message.width, message.width, *EXTREMES[:5])),
        point_step=chance.choice((message.point_step, message.point_step, *EXTREMES[:5])),
        row_step=chance.choice((message.row_step, message.row_step, *EXTREMES[:5])),
        is_bigendian=chance.random() < 0.3, data=mutated(chance, bytes(message.data)))


@pytest.mark.parametrize(('read', 'message'), [
    (read_detections, detections_to_msg(empty_detections(3), header_of(1, 'a'))),
    (ego_from_msg, ego_to_msg(no_estimate(EgoStatus.FIRST_FRAME, 1, 1), header_of(1, 'a'))),
    (load_from_msg, load_to_msg(StageTime(Stage.OPTICAL_FLOW, 10.0, 0), header_of(1, 'a')))])
def test_records(read: Callable[[PointCloud2], object], message: PointCloud2, shown):
    chance = random.Random(15)
    for _ in range(MUTATIONS):
        odd = odd_records(chance, message)
        survives(lambda odd=odd: read(odd), odd)
    shown('damaged bytes', 'an answer, or one line of our own error', f'{MUTATIONS} messages for {read.__name__}')
