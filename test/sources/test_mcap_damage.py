"""Damage inside an MCAP file: every intact chunk is read, what is not is told, and later frames keep their numbers."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, IndexType, Writer

from motion_detect_ros.__main__ import main
from motion_detect_ros.sources import mcap_recovery, messages
from motion_detect_ros.sources.bags import BagFrames, BagReader, BagWriter

STAMP, PERIOD = 1_600_000_000_000_000_000, 100_000_000
COUNT = 10
#: Where a record keeps its kind, and its length from there on.
KIND, LENGTH = 0, 1
#: Bytes of a message before its data: kind, length, channel, sequence, two times.
MESSAGE_HEAD = 1 + 8 + 2 + 4 + 8 + 8


def picture(index: int) -> np.ndarray:
    return np.full((64, 64), index, np.uint8)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Ten images, a chunk each."""
    path = tmp_path / 'a.mcap'
    with BagWriter(path, compress=False, chunk_bytes=1000) as writer:
        for index in range(COUNT):
            writer.write_image(picture(index), STAMP + index * PERIOD)
    return path


def write_images(path: Path, **options: Any) -> None:
    """The same images by the mcap library. options: of its writer."""
    with path.open('wb') as stream:
        writer = Writer(stream, **options)
        writer.start(profile='ros2')
        schema = writer.register_schema(messages.IMAGE, 'ros2msg', b'')
        channel = writer.register_channel('/image_raw', 'cdr', schema)
        for index in range(COUNT):
            stamp = STAMP + index * PERIOD
            writer.add_message(channel, stamp, messages.serialize(messages.image(picture(index), stamp, '')), stamp)
        writer.finish()


def chunks(path: Path) -> list[ChunkIndex]:
    """As the mcap library finds them."""
    with path.open('rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset)


def overwrite(path: Path, at: int, new: Callable[[bytes], bytes] | bytes, size: int = 1) -> None:
    """new: bytes, or what to make of those that are there."""
    content = bytearray(path.read_bytes())
    found = bytes(content[at:at + size])
    content[at:at + size] = new(found) if callable(new) else new
    path.write_bytes(content)


def flipped(found: bytes) -> bytes:
    return bytes(value ^ 0xFF for value in found)


def read(path: Path) -> tuple[list[tuple[int, int]], BagFrames]:
    """(index, what its picture shows) of each frame."""
    source = BagFrames(path)
    return [(frame.index, int(frame.image[0, 0])) for frame in source], source


#: Damage to the third chunk.
FAULTS: dict[str, Callable[[Path, ChunkIndex], None]] = {
    'kind': lambda path, chunk: overwrite(path, chunk.chunk_start_offset + KIND, b'\0'),
    **{f'length, byte {byte}': lambda path, chunk, byte=byte: overwrite(
        path, chunk.chunk_start_offset + LENGTH + byte, flipped) for byte in range(1, 8)},
    'length of the data': lambda path, chunk: overwrite(path, chunk.chunk_start_offset + 9 + 32, flipped),
    'data': lambda path, chunk: overwrite(path, chunk.chunk_start_offset + 2000, flipped),
    'zeros over its beginning': lambda path, chunk: overwrite(path, chunk.chunk_start_offset, bytes(200), 200),
    'zeros over all of it': lambda path, chunk: overwrite(
        path, chunk.chunk_start_offset, bytes(chunk.chunk_length), chunk.chunk_length),
}


@pytest.mark.parametrize('fault', FAULTS)
def test_a_fault_costs_its_chunk_only_is_told_and_moves_no_number(bag: Path, fault: str) -> None:
    FAULTS[fault](bag, chunks(bag)[2])
    frames, source = read(bag)
    assert frames == [(index, index) for index in range(COUNT) if index != 2]
    assert source.damaged == 'a.mcap: 1 unreadable chunk(s) skipped, 1 of 10 messages missing'
    assert (source.frame_count, source.bad_frames) == (COUNT, 1)


def test_zeros_over_the_border_of_two_chunks(bag: Path) -> None:
    overwrite(bag, chunks(bag)[2].chunk_start_offset - 20, bytes(220), 220)
    frames, source = read(bag)
    assert frames == [(index, index) for index in range(COUNT) if index != 2]
    assert 'a.mcap: 1 unreadable chunk(s) skipped' in str(source.damaged)


def test_inspect_counts_what_can_be_read_and_ends_with_3(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    FAULTS['kind'](bag, chunks(bag)[2])
    assert main(['inspect', str(bag)]) == 3
    printed = capsys.readouterr().out
    assert '9 readable messages' in printed
    assert 'damaged: a.mcap: 1 unreadable chunk(s) skipped, 1 of 10 messages missing' in printed
    assert ' 9/10 ' in printed


def test_a_message_that_the_statistics_know_and_nobody_finds_is_missing(bag: Path) -> None:
    """A record outside of the chunks whose kind is damaged looks like one of a later version of the format."""
    write_images(bag, use_chunking=False)
    fifth = messages.serialize(messages.image(picture(4), STAMP + 4 * PERIOD, ''))
    overwrite(bag, bag.read_bytes().index(fifth) - MESSAGE_HEAD, b'\xF0')
    frames, source = read(bag)
    assert [shown for _, shown in frames] == [index for index in range(COUNT) if index != 4]
    assert source.damaged == (
        'a.mcap: 1 of 10 messages missing, numbers of the frames after them are too small')


def test_without_an_index_of_messages_it_is_told_that_numbers_are_wrong(bag: Path) -> None:
    write_images(bag, chunk_size=1000, compression=CompressionType.NONE, use_statistics=False,
                 index_types=IndexType.CHUNK)
    FAULTS['kind'](bag, chunks(bag)[2])
    frames, source = read(bag)
    assert [shown for _, shown in frames] == [index for index in range(COUNT) if index != 2]
    assert source.damaged == (
        'a.mcap: 1 unreadable chunk(s) skipped, numbers of the frames after them are too small')


def test_a_recording_that_was_cut_off_keeps_its_numbers_after_a_damaged_chunk(bag: Path) -> None:
    """No summary says where chunks are, but their indexes of messages follow them."""
    third, last = chunks(bag)[2], chunks(bag)[-1]
    FAULTS['data'](bag, third)
    bag.write_bytes(bag.read_bytes()[:last.chunk_start_offset])
    frames, source = read(bag)
    assert frames == [(index, index) for index in range(COUNT - 1) if index != 2]
    assert source.damaged == (
        'a.mcap: the end is missing (recording was cut off), 1 unreadable chunk(s) skipped')


@pytest.mark.parametrize('share', [0.1, 0.5, 0.9])
def test_damage_to_the_summary_loses_no_message(bag: Path, share: float) -> None:
    """Where its checksum is wrong, nothing that it says of places and numbers is believed."""
    last = chunks(bag)[-1]
    begin, end = last.chunk_start_offset + last.chunk_length + 100, bag.stat().st_size - 40
    overwrite(bag, round(begin + share * (end - begin)), flipped)
    frames, source = read(bag)
    assert frames == [(index, index) for index in range(COUNT)]
    assert source.damaged == 'a.mcap: the summary at the end is damaged'


def test_all_bytes_in_turn(tmp_path: Path) -> None:
    """Wherever a byte is wrong, nine of ten images are read at least, and numbers are right or said to be wrong."""
    whole = tmp_path / 'whole.mcap'
    with BagWriter(whole, compress=False, chunk_bytes=200) as writer:
        for index in range(COUNT):
            writer.write_image(np.full((16, 16), index, np.uint8), STAMP + index * PERIOD)
    content, damaged = whole.read_bytes(), tmp_path / 'a.mcap'
    begin = chunks(whole)[0].chunk_start_offset
    for place in range(begin, len(content) - 8, 3):
        damaged.write_bytes(content[:place] + flipped(content[place:place + 1]) + content[place + 1:])
        frames, source = read(damaged)
        told = str(source.damaged)
        assert len(frames) == COUNT or (len(frames) == COUNT - 1 and '1 unreadable chunk(s)' in told), place
        assert all(index == shown for index, shown in frames) or 'too small' in told, (place, frames, told)


def test_players_of_bags_get_no_bytes_for_what_is_lost(bag: Path) -> None:
    FAULTS['data'](bag, chunks(bag)[2])
    with BagReader(bag) as reader:
        given = [(message.log_stamp_ns, bool(message.data)) for message in reader.messages()]
    assert given == [(STAMP + index * PERIOD, index != 2) for index in range(COUNT)]


def test_messages_of_several_topics_in_a_lost_chunk_keep_their_order_of_time(tmp_path: Path) -> None:
    path = tmp_path / 'a.mcap'
    with BagWriter(path, compress=False, chunk_bytes=100_000) as writer:
        for index in range(COUNT):
            writer.write_image(np.full((16, 16), index, np.uint8), STAMP + index * PERIOD, f'/{index % 3}')
    FAULTS['kind'](path, chunks(path)[0])
    with BagReader(path) as reader:
        given = [(message.topic, message.log_stamp_ns, message.data) for message in reader.messages()]
    assert given == [(f'/{index % 3}', STAMP + index * PERIOD, b'') for index in range(COUNT)]


def without_summary(path: Path) -> list[ChunkIndex]:
    """As a recorder leaves it that lost its power: cut inside the last chunk. Returns where the chunks were."""
    found = chunks(path)
    path.write_bytes(path.read_bytes()[:found[-1].chunk_start_offset + 100])
    return found


@pytest.mark.parametrize(('fault', 'compression'), [
    ('zeros over its beginning', ''), *product(('length, byte 2', 'length, byte 7', 'zeros over all of it'),
                                               ('', 'lz4', 'zstd'))])
def test_of_a_recording_that_was_cut_off_what_follows_a_hole_is_read(bag: Path, fault: str, compression: str) -> None:
    write_images(bag, chunk_size=1000, compression=CompressionType[compression.upper() or 'NONE'])
    FAULTS[fault](bag, without_summary(bag)[2])
    frames, source = read(bag)
    assert [shown for _, shown in frames] == [0, 1, *range(3, COUNT - 1)]
    assert source.damaged == (
        'a.mcap: the end is missing (recording was cut off), unreadable bytes in 1 place(s), '
        'numbers of the frames after them are too small')


def test_several_holes_and_bytes_that_are_gone(bag: Path) -> None:
    found = without_summary(bag)
    FAULTS['zeros over its beginning'](bag, found[6])
    content = bag.read_bytes()
    bag.write_bytes(content[:found[1].chunk_start_offset + 50] + content[found[3].chunk_start_offset + 777:])
    frames, source = read(bag)
    assert [shown for _, shown in frames] == [0, 4, 5, 7, 8]
    assert 'unreadable bytes in 2 place(s)' in str(source.damaged)


def test_a_summary_that_is_damaged_too_loses_nothing_more(bag: Path) -> None:
    FAULTS['zeros over its beginning'](bag, chunks(bag)[2])
    overwrite(bag, len(bag.read_bytes()) - 60, flipped, 60)
    frames, source = read(bag)
    assert [shown for _, shown in frames] == [0, 1, *range(3, COUNT)]
    assert 'unreadable bytes in 1 place(s)' in str(source.damaged)


@pytest.mark.parametrize('shift', [0, 1, 20, 52, 53, 54])
def test_a_chunk_is_found_wherever_it_lies_between_what_is_read_at_once(
    shift: int, bag: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And nothing that looks like one but does not fit the file."""
    first = chunks(bag)[0]
    whole = bag.read_bytes()[first.chunk_start_offset:first.chunk_start_offset + first.chunk_length]
    monkeypatch.setattr(mcap_recovery, '_BLOCK_BYTES', 64)
    noise = np.random.default_rng(shift).integers(0, 256, 64 + shift, np.uint8).tobytes()
    for content, place in ((noise + whole, len(noise)), (noise + whole[:-1], None),
                           (noise + b'\x06' + whole[:8] + whole, len(noise) + 9),
                           (noise + whole[:1] + bytes(8) + whole[9:], None)):
        assert mcap_recovery.next_chunk(BytesIO(content), 0, len(content)) == place
