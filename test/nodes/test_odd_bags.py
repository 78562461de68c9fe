"""Bags with topics and messages that DDS does not take: the player leaves these out, says so, and plays the rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from mcap.writer import Writer
from peers import TIMEOUT_S, lossless, own_lines, picture
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import Image
from std_msgs.msg import Bool

from motion_detect_ros.bridge.images import image_from_msg, stamp_ns
from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.sources import messages

BOOL = 'std_msgs/msg/Bool'
STAMPS = [1_600_000_000 * NANOSECONDS + index * 50_000_000 for index in range(8)]
#: A Bool takes five bytes of CDR: DDS refuses more, and what is shorter is not noticed before it is read.
TRUE, TOO_LONG = b'\0\1\0\0\1', b'\0\1\0\0' + bytes(40)


def write(path: Path, *channels: tuple[str, str, str, bytes | None], profile: str = 'ros2') -> Path:
    """Channels as (topic, encoding, type, data) with a message at every stamp; None = the picture of its number."""
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile=profile)
        known = [(writer.register_channel(topic, encoding, writer.register_schema(kind, 'ros2msg', b'')), data)
                 for topic, encoding, kind, data in channels]
        for index, stamp in enumerate(STAMPS):
            image = messages.serialize(messages.image(picture(index), stamp, 'eye'))
            for channel, data in known:
                writer.add_message(channel, stamp, image if data is None else data, stamp)
        writer.finish()
    return path


def warnings(log: Path) -> list[str]:
    """What the player warned of, without time and name."""
    return [line.partition(']: ')[2] for line in own_lines(log.read_text()) if line.startswith('[WARN]')]


def test_a_message_that_dds_refuses_costs_itself_and_is_counted(peer, start, tmp_path):
    path = write(tmp_path / 'long.mcap', ('/flag', 'cdr', BOOL, TOO_LONG), ('/image_raw', 'cdr', messages.IMAGE, None))
    images, reports = peer.subscribe(Image, 'image_raw'), peer.subscribe(DiagnosticArray, '/diagnostics')
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'wait_for_subscribers:=1', '-p', 'loop:=true',
                    *lossless('image_raw'))

    def counts() -> tuple[int, ...]:
        values = {pair.key: pair.value for pair in reports[-1].status[0].values} if reports else {}
        return tuple(int(values.get(name, 0)) for name in ('received', 'processed', 'errors'))

    assert peer.until(lambda: counts()[2] > 2 * len(STAMPS) or process.poll() is not None)
    received, processed, errors = counts()
    assert received - processed - errors in (0, 1)
    assert abs(processed - errors) <= 1
    assert [stamp_ns(image.header) for image in images[:16]] == STAMPS * 2
    np.testing.assert_array_equal(image_from_msg(images[3]), picture(3))
    refused = [line for line in warnings(tmp_path / 'bag_player.log') if '/flag: left out: ' in line]
    assert len(refused) == 1
    assert f'a message of {len(TOO_LONG)} bytes that is refused as {BOOL}' in refused[0]


def test_channels_that_are_not_cdr_are_left_out_in_one_warning(peer, start, tmp_path):
    """A topic may have both; the one in CDR is played then, whichever comes first in the file."""
    path = write(tmp_path / 'json.mcap', ('/image_raw', 'json', messages.IMAGE, b'{"height": 1}'),
                 ('/flag', 'json', BOOL, b'{"data": true}'), ('/proto', 'protobuf', 'std_msgs/msg/String', b'\x0a\1a'),
                 ('/image_raw', 'cdr', messages.IMAGE, None), ('/things', 'cdr', 'none_msgs/msg/Thing', b'\0\1\0\0'))
    images = peer.subscribe(Image, 'image_raw')
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'wait_for_subscribers:=1', *lossless('image_raw'))
    assert process.wait(TIMEOUT_S) == 0
    assert peer.until(lambda: len(images) == len(STAMPS))
    assert [stamp_ns(image.header) for image in images] == STAMPS
    said, = warnings(tmp_path / 'bag_player.log')
    for part in ('topic /image_raw: expected messages in cdr, got json',
                 'topic /flag: expected messages in cdr, got json',
                 'topic /proto: expected messages in cdr, got protobuf',
                 'topic /things: message type none_msgs/msg/Thing: expected an installed package, found none'):
        assert part in said


def test_types_of_ros_1_that_cannot_be_converted_are_left_out(peer, start, tmp_path):
    """An installed type that the definitions for the conversion do not have."""
    path, flags = tmp_path / 'ros1.mcap', peer.subscribe(Bool, 'flag')
    write(path, ('/goals', 'ros1', 'nav_msgs/Goals', bytes(16)), ('/flag', 'ros1', 'std_msgs/Bool', b'\1'),
          profile='ros1')
    assert 'nav_msgs/msg/Goals' not in get_typestore(Stores.ROS2_JAZZY).fielddefs
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'loop:=true', *lossless('flag'))
    assert peer.until(lambda: len(flags) > len(STAMPS))
    assert flags[0].data
    assert process.poll() is None
    said, = warnings(tmp_path / 'bag_player.log')
    assert 'topic /goals: expected messages in cdr, got ros1' in said
