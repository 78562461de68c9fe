"""Every form that bags come in gives the same pictures, stamps, calibration and angular rates."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore

from motion_detect_ros.__main__ import main
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bags import BagFrames, BagReader, TopicInfo, is_bag
from motion_detect_ros.sources.opening import open_source

STAMP, PERIOD = 1_600_000_000_123_456_789, 100_000_000
CAMERA = CameraModel(64, 48, 50.0, 51.0, 31.5, 23.5)
NOETIC, JAZZY = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
Messages = list[tuple[str, Any, int]]


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (48, 64, 3), np.uint8)


def recorded(count: int = 4) -> Messages:
    """Topic, message of Jazzy, time."""
    found: Messages = []
    for index in range(count):
        stamp = STAMP + index * PERIOD
        rate = messages.make('geometry_msgs/msg/Vector3', x=0.1, y=0.2, z=float(index))
        found += [('/cam/camera_info', messages.camera_info(CAMERA, stamp, 'cam'), stamp),
                  ('/cam/image_raw', messages.image(noise(index), stamp, 'cam'), stamp),
                  ('/imu', messages.make(messages.IMU, header=messages.header(stamp, 'imu'), angular_velocity=rate),
                   stamp)]
    return found


def as_ros1(message: Any) -> Any:
    """The same message as ROS 1 has it: headers are numbered, fields of CameraInfo in capitals."""
    kind = message.__msgtype__
    if kind == 'std_msgs/msg/Header':
        return NOETIC.types[kind](7, as_ros1(message.stamp), message.frame_id)
    if not hasattr(message, '__dataclass_fields__'):
        return message
    values = [as_ros1(getattr(message, name)) if hasattr(getattr(message, name), '__msgtype__')
              else getattr(message, name) for name, _ in JAZZY.fielddefs[kind][1]]
    return NOETIC.types[kind](*values)


def ros1_bytes(message: Any) -> bytes:
    return bytes(NOETIC.serialize_ros1(as_ros1(message), message.__msgtype__))


def write_ros1(path: Path, content: Messages, compression: Rosbag1Writer.CompressionFormat | None) -> Path:
    writer = Rosbag1Writer(path)
    if compression:
        writer.set_compression(compression)
    with writer:
        connections: dict[str, Any] = {}
        for topic, message, stamp in content:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=NOETIC)
            writer.write(connections[topic], stamp, ros1_bytes(message))
    return path


def write_mcap(path: Path, content: Messages, compression: CompressionType, ros1: bool = False) -> Path:
    with path.open('wb') as stream:
        writer = McapWriter(stream, compression=compression)
        writer.start(profile='ros1' if ros1 else 'ros2')
        channels: dict[str, int] = {}
        for topic, message, stamp in content:
            kind = message.__msgtype__
            if topic not in channels:
                definition = (NOETIC if ros1 else JAZZY).generate_msgdef(kind, ros_version=1 if ros1 else 2)[0].encode()
                schema = writer.register_schema(kind.replace('/msg/', '/') if ros1 else kind,
                                                'ros1msg' if ros1 else 'ros2msg', definition)
                channels[topic] = writer.register_channel(topic, 'ros1' if ros1 else 'cdr', schema)
            data = ros1_bytes(message) if ros1 else bytes(JAZZY.serialize_cdr(message, kind))
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()
    return path


def write_db3(path: Path, content: Messages) -> Path:
    with Rosbag2Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections: dict[str, Any] = {}
        for topic, message, stamp in content:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=JAZZY)
            writer.write(connections[topic], stamp, JAZZY.serialize_cdr(message, message.__msgtype__))
    return path


FORMS: dict[str, Callable[[Path, Messages], Path]] = {
    'mcap': lambda folder, content: write_mcap(folder / 'a.mcap', content, CompressionType.NONE),
    'mcap lz4': lambda folder, content: write_mcap(folder / 'a.mcap', content, CompressionType.LZ4),
    'mcap zstd': lambda folder, content: write_mcap(folder / 'a.mcap', content, CompressionType.ZSTD),
    'mcap of ROS 1': lambda folder, content: write_mcap(folder / 'a.mcap', content, CompressionType.LZ4, ros1=True),
    'db3': lambda folder, content: write_db3(folder / 'a', content),
    'ROS 1': lambda folder, content: write_ros1(folder / 'a.bag', content, None),
    'ROS 1 bz2': lambda folder, content: write_ros1(folder / 'a.bag', content, Rosbag1Writer.CompressionFormat.BZ2),
    'ROS 1 lz4': lambda folder, content: write_ros1(folder / 'a.bag', content, Rosbag1Writer.CompressionFormat.LZ4),
}


@pytest.mark.parametrize('form', FORMS)
def test_pictures_calibration_and_rates(form: str, tmp_path: Path):
    path = FORMS[form](tmp_path, recorded())
    assert is_bag(path)
    source = open_source(path)
    assert isinstance(source, BagFrames)
    frames = [*source]
    assert [frame.stamp_ns for frame in frames] == [STAMP + index * PERIOD for index in range(4)]
    assert all(np.array_equal(frame.image, noise(frame.index)) for frame in frames)
    assert (source.camera, source.frame_count, source.damaged, source.bad_frames) == (CAMERA, 4, None, 0)
    assert [(sample.stamp_ns, sample.rate) for sample in source.gyro()] == [
        (STAMP + index * PERIOD, (0.1, 0.2, float(index))) for index in range(4)]
    with BagReader(path) as reader:
        assert set(reader.topics) == {
            TopicInfo('/cam/camera_info', messages.CAMERA_INFO, 4), TopicInfo('/cam/image_raw', messages.IMAGE, 4),
            TopicInfo('/imu', messages.IMU, 4)}


@pytest.mark.parametrize('form', FORMS)
def test_compressed_pictures_beside_raw_ones_of_another_camera(form: str, tmp_path: Path):
    png = cv2.imencode('.png', noise(9))[1].tobytes()
    path = FORMS[form](tmp_path, [
        *recorded(2), ('/rear/image_raw/compressed', messages.compressed_image(png, 'png', STAMP, 'rear'), STAMP)])
    with pytest.raises(SourceError) as caught:
        open_source(path)
    said = str(caught.value)
    assert ('several image topics, choose one: --topic, or topic of the camera node; '
            'image topics (type, messages): ') in said
    assert '/cam/image_raw (sensor_msgs/msg/Image, 2)' in said
    assert '/rear/image_raw/compressed (sensor_msgs/msg/CompressedImage, 1)' in said
    frames = [*open_source(path, topic='rear/image_raw/compressed')]
    assert len(frames) == 1
    assert np.array_equal(frames[0].image, noise(9))
    assert len([*open_source(path, topic='/cam/image_raw')]) == 2


def test_a_malformed_message_of_ros1_costs_that_frame_only(tmp_path: Path):
    path = tmp_path / 'a.bag'
    good = ros1_bytes(messages.image(noise(0), STAMP, 'cam'))
    with Rosbag1Writer(path) as writer:
        connection = writer.add_connection('/image_raw', messages.IMAGE, typestore=NOETIC)
        for index, data in enumerate((good, good[:60], b'', good)):
            writer.write(connection, STAMP + index, data)
    source = open_source(path)
    assert [frame.index for frame in source] == [0, 3]
    assert source.bad_frames == 2


def test_messages_of_unknown_types_are_counted_and_in_nobodys_way(tmp_path: Path):
    path = tmp_path / 'a.bag'
    with Rosbag1Writer(path) as writer:
        odd = writer.add_connection('/odd', 'my_msgs/msg/Odd', msgdef='float64 value\n', md5sum='0' * 32)
        writer.write(odd, STAMP, b'\0' * 8)
        images = writer.add_connection('/image_raw', messages.IMAGE, typestore=NOETIC)
        writer.write(images, STAMP, ros1_bytes(messages.image(noise(0), STAMP, 'cam')))
    assert len([*open_source(path)]) == 1
    with BagReader(path) as reader:
        assert [(message.topic, message.msgtype) for message in reader.messages()] == [
            ('/odd', 'my_msgs/msg/Odd'), ('/image_raw', messages.IMAGE)]


def write_two_types(path: Path, count: int = 10) -> Path:
    """Images and texts in turn, in two channels of the same topic, as other tools than ROS can write them."""
    text = bytes(JAZZY.serialize_cdr(messages.make('std_msgs/msg/String', data='a'), 'std_msgs/msg/String'))
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start(profile='ros2')
        channels = [writer.register_channel('/image_raw', 'cdr', writer.register_schema(kind, 'ros2msg', b''))
                    for kind in (messages.IMAGE, 'std_msgs/msg/String')]
        for index in range(count):
            stamp = STAMP + index * PERIOD
            image = messages.serialize(messages.image(noise(index), stamp, 'cam'))
            for channel, data in zip(channels, (image, text), strict=True):
                writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    return path


def test_a_topic_with_two_types_is_two(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_two_types(tmp_path / 'a.mcap')
    with BagReader(path) as reader:
        assert reader.topics == (TopicInfo('/image_raw', messages.IMAGE, 10),
                                 TopicInfo('/image_raw', 'std_msgs/msg/String', 10))
    source = BagFrames(path, 'image_raw')
    frames = [*source]
    assert [frame.index for frame in frames] == [*range(10)]
    assert all(np.array_equal(frame.image, noise(frame.index)) for frame in frames)
    assert (source.frame_count, source.bad_frames, source.damaged) == (10, 0, None)
    assert main(['inspect', str(path)]) == 0
    counts = [line.split()[:3] for line in capsys.readouterr().out.splitlines() if line.startswith('/image_raw')]
    assert counts == [['/image_raw', messages.IMAGE, '10'], ['/image_raw', 'std_msgs/msg/String', '10']]


def write_json_mcap(path: Path, count: int) -> Path:
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start(profile='ros2')
        schema = writer.register_schema(messages.IMAGE, 'ros2msg', b'')
        json, cdr = (writer.register_channel('/image_raw', encoding, schema) for encoding in ('json', 'cdr'))
        for index in range(count):
            stamp = STAMP + index * PERIOD
            writer.add_message(json, stamp, b'{"height": 48}', stamp)
            writer.add_message(cdr, stamp, messages.serialize(messages.image(noise(index), stamp, 'cam')), stamp)
        writer.finish()
    return path


def write_json_db3(path: Path, count: int) -> Path:
    with Rosbag2Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        json, cdr = (writer.add_connection('/image_raw', messages.IMAGE, typestore=JAZZY, serialization_format=encoding)
                     for encoding in ('json', 'cdr'))
        for index in range(count):
            stamp = STAMP + index * PERIOD
            writer.write(json, stamp, b'{"height": 48}')
            writer.write(cdr, stamp, messages.serialize(messages.image(noise(index), stamp, 'cam')))
    return path


@pytest.mark.parametrize('write', [write_json_mcap, write_json_db3])
def test_a_topic_in_two_encodings_is_two_and_the_images_in_cdr_are_read(
        write: Callable[[Path, int], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write(tmp_path / 'a.mcap', 10)
    with BagReader(path) as reader:
        assert reader.topics == (TopicInfo('/image_raw', messages.IMAGE, 10, 'json'),
                                 TopicInfo('/image_raw', messages.IMAGE, 10))
    source = BagFrames(path)
    assert [np.array_equal(frame.image, noise(index)) for index, frame in enumerate(source)] == [True] * 10
    assert (source.frame_count, source.bad_frames) == (10, 0)
    assert main(['inspect', str(path)]) == 0
    found = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith('/image_raw')]
    assert [words[:4] for words in found] == [['/image_raw', messages.IMAGE, 'in', 'json'],
                                              ['/image_raw', messages.IMAGE, '10', '10.00']]


def test_images_in_another_encoding_only_are_named(tmp_path: Path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start(profile='ros2')
        schema = writer.register_schema(messages.IMAGE, 'ros2msg', b'')
        writer.add_message(writer.register_channel('/image_raw', 'json', schema), STAMP, b'{}', STAMP)
        writer.finish()
    with pytest.raises(SourceError, match=r'no image topic .*: /image_raw \(sensor_msgs/msg/Image in json, 1\)'):
        BagFrames(path)


@pytest.mark.parametrize('share', [0.0005, 0.3, 0.95])
def test_a_bag_of_ros1_that_was_cut_off_is_refused_in_one_line(share: float, tmp_path: Path):
    whole = write_ros1(tmp_path / 'whole.bag', recorded(), None).read_bytes()
    (tmp_path / 'cut.bag').write_bytes(whole[:max(14, int(share * len(whole)))])
    with pytest.raises(SourceError, match=r'cut.bag: not a readable ROS 1 bag: .+ \(rosbag reindex may repair it\)$'):
        open_source(tmp_path / 'cut.bag')


def test_a_bag_of_ros1_with_a_damaged_byte_is_read_or_refused(tmp_path: Path):
    """In each place of the header of the bag and of the index at its end: no error of the reader comes through."""
    whole = write_ros1(tmp_path / 'whole.bag', recorded(1), None).read_bytes()
    index_pos = int.from_bytes(whole[whole.index(b'index_pos=') + 10:][:8], 'little')
    damaged, refused = tmp_path / 'damaged.bag', []
    for place in (*range(13, 96), *range(index_pos, min(len(whole), index_pos + 200))):
        for value in (0, 0x80, 0xff):
            damaged.write_bytes(whole[:place] + bytes([value]) + whole[place + 1:])
            try:
                BagReader(damaged).close()
            except SourceError as error:
                refused.append(str(error))
    assert len(refused) > 100
    assert all(line.startswith(f'{damaged}: not a readable ROS 1 bag: ') and '\n' not in line for line in refused)


def test_a_damaged_chunk_of_ros1_ends_the_bag_there(tmp_path: Path):
    path = write_ros1(tmp_path / 'a.bag', recorded(), Rosbag1Writer.CompressionFormat.BZ2)
    content = bytearray(path.read_bytes())
    at = content.index(b'BZh') + 2000
    content[at:at + 100] = bytes(100)
    path.write_bytes(content)
    with BagReader(path) as reader:
        assert len([message for message in reader.messages(['/cam/image_raw']) if message.data]) < 4
        assert 'a.bag: unreadable from some message on' in str(reader.damaged)


def test_what_is_lost_of_a_part_moves_no_number_in_the_next(tmp_path: Path):
    folder, content = tmp_path / 'rec', recorded(8)
    folder.mkdir()
    for part in range(2):
        write_ros1(folder / f'rec_{part}.bag', content[12 * part:][:12], Rosbag1Writer.CompressionFormat.BZ2)
    first = bytearray((folder / 'rec_0.bag').read_bytes())
    at = first.index(b'BZh') + 2000
    first[at:at + 100] = bytes(100)
    (folder / 'rec_0.bag').write_bytes(first)
    source = BagFrames(folder)
    frames = [*source]
    assert [frame.index for frame in frames][-4:] == [4, 5, 6, 7]
    assert all(np.array_equal(frame.image, noise(frame.index)) for frame in frames)
    assert 'rec_0.bag: unreadable from some message on' in str(source.damaged)
    assert source.bad_frames == 8 - len(frames) > 0
