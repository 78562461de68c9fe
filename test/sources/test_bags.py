"""Bags: what we write other libraries read, what others write we read, damage costs what is damaged."""

from __future__ import annotations

from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from motion_detect_ros.__main__ import main
from motion_detect_ros.core.errors import MessageError, SourceError
from motion_detect_ros.core.types import DETECTION_DTYPE, CameraModel, empty_detections
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bags import BagFrames, BagReader, BagWriter, TopicInfo, is_bag

STAMP = 1_317_042_272_345_808_896  # 2011-09-26 13:04:32.345808896 UTC
PERIOD = 100_000_000


def noise(seed: int, shape: tuple[int, ...] = (48, 64, 3)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Twelve pictures of 90 kB (so that every 1 MiB chunk holds eleven) with a calibration each."""
    path = tmp_path / 'flight.mcap'
    with BagWriter(path, compress=False) as writer:
        for index in range(12):
            stamp = STAMP + index * PERIOD
            writer.write_camera_info(CameraModel(200, 150, 300.0, 310.0, 99.5, 74.5), stamp)
            writer.write_image(noise(index, (150, 200, 3)), stamp)
    return path


@pytest.fixture
def chunked_bag(tmp_path: Path) -> Path:
    """Ten pictures over 1 MiB: the writer closes a chunk after each."""
    path = tmp_path / 'chunks.mcap'
    with BagWriter(path, compress=False) as writer:
        for index in range(10):
            writer.write_image(noise(index, (600, 640, 3)), STAMP + index * PERIOD)
    return path


def test_mcap_library_reads_topics_schemas_and_times(bag: Path) -> None:
    with bag.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        read = [(schema.name, schema.encoding, channel.topic, channel.message_encoding, message.log_time)
                for schema, channel, message in reader.iter_messages()]
        assert reader.get_header().profile == 'ros2'
    assert len(read) == 24
    assert read[0] == ('sensor_msgs/msg/CameraInfo', 'ros2msg', '/camera_info', 'cdr', STAMP)
    assert read[-1] == ('sensor_msgs/msg/Image', 'ros2msg', '/image_raw', 'cdr', STAMP + 11 * PERIOD)


def test_rosbags_reads_the_pictures_by_the_definitions_in_the_file(bag: Path) -> None:
    with AnyReader([bag]) as reader:
        wanted = [c for c in reader.connections if c.topic == '/image_raw']
        pictures = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(wanted)]
    assert [p.encoding for p in pictures] == ['bgr8'] * 12
    assert np.array_equal(pictures[3].data.reshape(150, 200, 3), noise(3, (150, 200, 3)))


class TestRosItselfReadsOurBytes:
    """The CDR bytes go through rclpy's own deserialiser."""

    def test_image(self) -> None:
        serialization, msg = pytest.importorskip('rclpy.serialization'), pytest.importorskip('sensor_msgs.msg')
        data = messages.serialize(messages.image(noise(1), STAMP, 'camera'))
        image = serialization.deserialize_message(data, msg.Image)
        assert (image.header.stamp.sec, image.header.stamp.nanosec) == (1317042272, 345808896)
        assert (image.header.frame_id, image.encoding) == ('camera', 'bgr8')
        assert (image.height, image.width, image.step) == (48, 64, 192)
        assert bytes(image.data) == noise(1).tobytes()

    def test_mono_image_cut_out_of_a_larger_one(self) -> None:
        serialization, msg = pytest.importorskip('rclpy.serialization'), pytest.importorskip('sensor_msgs.msg')
        part = noise(2)[4:20, 8:40, 0]
        image = serialization.deserialize_message(messages.serialize(messages.image(part, 0, '')), msg.Image)
        assert (image.encoding, image.step) == ('mono8', 32)
        assert bytes(image.data) == part.tobytes()

    def test_camera_info(self) -> None:
        serialization, msg = pytest.importorskip('rclpy.serialization'), pytest.importorskip('sensor_msgs.msg')
        camera = CameraModel(640, 480, 500.0, 510.0, 320.5, 240.5)
        info = serialization.deserialize_message(
            messages.serialize(messages.camera_info(camera, STAMP, 'camera')), msg.CameraInfo)
        assert list(info.k) == [500, 0, 320.5, 0, 510, 240.5, 0, 0, 1]
        assert list(info.p) == [500, 0, 320.5, 0, 0, 510, 240.5, 0, 0, 0, 1, 0]
        assert (info.width, info.height, info.distortion_model, list(info.d)) == (640, 480, 'plumb_bob', [0] * 5)

    def test_detections(self) -> None:
        serialization, msg = pytest.importorskip('rclpy.serialization'), pytest.importorskip('sensor_msgs.msg')
        records = empty_detections(2)
        records['id'], records['u'], records['ttc'] = (7, 9), (1.5, 2.5), (np.inf, np.nan)
        cloud = serialization.deserialize_message(
            messages.serialize(messages.point_cloud(records, STAMP, 'camera')), msg.PointCloud2)
        assert [(f.name, f.offset, f.count) for f in cloud.fields[:3]] == [('u', 0, 1), ('v', 4, 1), ('width', 8, 1)]
        field = {f.name: f for f in cloud.fields}
        assert field['u'].datatype == msg.PointField.FLOAT32
        assert field['id'].datatype == msg.PointField.UINT32
        assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (1, 2, 68, 136)
        assert np.frombuffer(bytes(cloud.data), DETECTION_DTYPE)['id'].tolist() == [7, 9]

    def test_no_detections(self) -> None:
        serialization, msg = pytest.importorskip('rclpy.serialization'), pytest.importorskip('sensor_msgs.msg')
        cloud = serialization.deserialize_message(
            messages.serialize(messages.point_cloud(empty_detections(), 5, '')), msg.PointCloud2)
        assert (cloud.width, len(cloud.data), len(cloud.fields)) == (0, 0, len(DETECTION_DTYPE))

    def test_a_new_message_is_as_empty_as_that_of_ros(self) -> None:
        serialization, msg = pytest.importorskip('rclpy.serialization'), pytest.importorskip('sensor_msgs.msg')
        for name in ('Imu', 'NavSatFix', 'CameraInfo', 'PointCloud2', 'CompressedImage'):
            data = messages.serialize(messages.make(f'sensor_msgs/msg/{name}'))
            ours, theirs = serialization.deserialize_message(data, getattr(msg, name)), getattr(msg, name)()
            if name == 'Imu':
                theirs.orientation.w = 0.0  # the two defaults that are not zero
            if name == 'NavSatFix':
                theirs.status.status = 0
            assert ours == theirs, name


def test_make_refuses_an_unknown_field() -> None:
    with pytest.raises(MessageError, match=r'sensor_msgs/msg/Imu has no field heading'):
        messages.make(messages.IMU, heading=1.0)


def test_reader_gives_topics_and_messages(bag: Path) -> None:
    with BagReader(bag) as reader:
        assert reader.topics == (TopicInfo('/camera_info', 'sensor_msgs/msg/CameraInfo', 12),
                                 TopicInfo('/image_raw', 'sensor_msgs/msg/Image', 12))
        stamps = [message.log_stamp_ns for message in reader.messages(['/image_raw'])]
        assert reader.damaged is None
    assert stamps == [STAMP + index * PERIOD for index in range(12)]


def write_db3(folder: Path, count: int = 5) -> Path:
    """A db3 bag by rosbags' own writer."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection('/cam/image_raw', messages.IMAGE, typestore=store)
        for index in range(count):
            picture = messages.image(noise(index), STAMP + index, 'camera')
            writer.write(connection, STAMP + index, store.serialize_cdr(picture, messages.IMAGE))
    return folder


@pytest.mark.parametrize('take', ['folder', 'file', 'folder without metadata'])
def test_reads_db3(tmp_path: Path, take: str) -> None:
    path = write_db3(tmp_path / 'recorded')
    if take == 'file':
        path = next(path.glob('*.db3'))
    elif take == 'folder without metadata':
        (path / 'metadata.yaml').unlink()
    assert is_bag(path)
    with BagReader(path) as reader:
        assert reader.topics == (TopicInfo('/cam/image_raw', messages.IMAGE, 5),)
    frames = list(BagFrames(path))
    assert [frame.stamp_ns for frame in frames] == [STAMP + index for index in range(5)]
    assert np.array_equal(frames[4].image, noise(4))


def test_reads_the_folder_of_an_mcap_recording(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / 'rec', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/image_raw', messages.IMAGE, typestore=store)
        picture = store.serialize_cdr(messages.image(noise(0), STAMP, 'c'), messages.IMAGE)
        writer.write(connection, STAMP, picture)
    assert [frame.stamp_ns for frame in BagFrames(tmp_path / 'rec')] == [STAMP]


def chunk_ends(path: Path) -> list[int]:
    """Where the chunks of an intact file end, by its own index, as the mcap library reads it."""
    with path.open('rb') as stream:
        indexes = make_reader(stream).get_summary().chunk_indexes
    return sorted(index.chunk_start_offset + index.chunk_length for index in indexes)


@pytest.mark.parametrize('share', [0.05, 0.5, 0.9, 0.999])
def test_a_cut_file_gives_every_intact_chunk(chunked_bag: Path, tmp_path: Path, share: float) -> None:
    content = chunked_bag.read_bytes()
    size = int(share * len(content))
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(content[:size])
    intact = sum(end <= size for end in chunk_ends(chunked_bag))
    with BagReader(cut) as reader:
        assert reader.damaged == 'cut.mcap: the end is missing (recording was cut off)'
        assert [m.log_stamp_ns for m in reader.messages()] == [STAMP + i * PERIOD for i in range(intact)]
        assert sum(topic.count for topic in reader.topics) == intact


def test_a_flipped_byte_costs_its_chunk_only(chunked_bag: Path) -> None:
    content = bytearray(chunked_bag.read_bytes())
    content[chunk_ends(chunked_bag)[2] - 500_000] ^= 0xFF  # inside the third chunk
    chunked_bag.write_bytes(content)
    with BagReader(chunked_bag) as reader:
        read = [m.log_stamp_ns for m in reader.messages() if m.data]
        assert reader.damaged == 'chunks.mcap: 1 unreadable chunk(s) skipped, 1 of 10 messages missing'
    assert read == [STAMP + i * PERIOD for i in range(10) if i != 2]


def test_channels_of_an_unreadable_first_chunk_come_from_the_summary(chunked_bag: Path) -> None:
    content = bytearray(chunked_bag.read_bytes())
    content[chunk_ends(chunked_bag)[0] - 500_000] ^= 0xFF
    chunked_bag.write_bytes(content)
    assert len(list(BagFrames(chunked_bag))) == 9


def test_an_interrupted_writer_leaves_a_readable_part(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), BagWriter(tmp_path / 'out.mcap') as writer:
        writer.write_image(noise(0), STAMP)
        raise KeyboardInterrupt
    assert not (tmp_path / 'out.mcap').exists()
    with BagReader(tmp_path / 'out.mcap.part') as reader:
        assert len(list(reader.messages())) == 1
        assert reader.damaged is None


class Counting:
    """A file that counts the bytes that are read from it."""

    def __init__(self, stream: IO[bytes], counts: list[int]) -> None:
        self._stream, self._counts = stream, counts

    def read(self, size: int = -1) -> bytes:
        data = self._stream.read(size)
        self._counts.append(len(data))
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def __enter__(self) -> Counting:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()


class TestWhatIsReadOfABag:
    """Ten chunks of 1.15 MB; what is counted are bytes, as time tells nothing on a busy machine."""

    SUMMARY = 20_000

    @pytest.fixture
    def counts(self, monkeypatch: pytest.MonkeyPatch) -> list[int]:
        counts: list[int] = []
        plain = Path.open
        monkeypatch.setattr(Path, 'open', lambda path, *words, **named: (
            Counting(plain(path, *words, **named), counts) if path.suffix == '.mcap' else plain(path, *words, **named)))
        return counts

    def test_opening_without_a_calibration_reads_the_summary_only(self, chunked_bag: Path, counts: list[int]) -> None:
        source = BagFrames(chunked_bag)
        assert (source.camera, source.frame_count, source.imu_topic) == (None, 10, None)
        assert 0 < sum(counts) < self.SUMMARY

    def test_topics_that_are_not_there_are_not_looked_for(self, chunked_bag: Path, counts: list[int]) -> None:
        with BagReader(chunked_bag) as reader:
            assert not [*reader.messages(['/imu'])]
            assert not [*reader.messages([])]
        assert not [*BagFrames(chunked_bag).gyro()]
        assert 0 < sum(counts) < 3 * self.SUMMARY

    def test_the_calibration_at_the_start_costs_one_chunk(self, tmp_path: Path, counts: list[int]) -> None:
        camera = CameraModel(640, 600, 300.0, 310.0, 319.5, 299.5)
        with BagWriter(tmp_path / 'a.mcap', compress=False) as writer:
            writer.write_camera_info(camera, STAMP)
            for index in range(10):
                writer.write_image(noise(index, (600, 640, 3)), STAMP + index * PERIOD)
        assert BagFrames(tmp_path / 'a.mcap').camera == camera
        assert 1_152_000 < sum(counts) < 1_152_000 + self.SUMMARY

    def test_a_file_without_its_end_is_read_for_what_it_holds(self, chunked_bag: Path, counts: list[int]) -> None:
        chunked_bag.write_bytes(chunked_bag.read_bytes()[:-100_000])
        assert BagFrames(chunked_bag).frame_count == 9
        assert sum(counts) > 9_000_000


class TestBagFrames:
    def test_gives_pictures_stamps_and_camera(self, bag: Path) -> None:
        source = BagFrames(bag)
        frames = list(source)
        assert [frame.index for frame in frames] == list(range(12))
        assert [frame.stamp_ns for frame in frames] == [STAMP + i * PERIOD for i in range(12)]
        assert all(np.array_equal(frame.image, noise(frame.index, (150, 200, 3))) for frame in frames)
        assert source.camera == CameraModel(200, 150, 300.0, 310.0, 99.5, 74.5)
        assert (source.frame_count, source.name, source.bad_frames) == (12, 'flight', 0)

    def test_no_focal_length_means_uncalibrated(self, tmp_path: Path) -> None:
        with BagWriter(tmp_path / 'a.mcap') as writer:
            writer.write_camera_info(CameraModel(64, 48, 0.0, 0.0, 0.0, 0.0), STAMP)
            writer.write_image(noise(0), STAMP)
        assert BagFrames(tmp_path / 'a.mcap').camera is None

    def test_a_malformed_message_costs_that_frame_only(self, tmp_path: Path) -> None:
        good = messages.serialize(messages.image(noise(0), STAMP, 'camera'))
        lying = messages.image(noise(0), STAMP, 'camera')
        lying.height = 4800
        with BagWriter(tmp_path / 'a.mcap') as writer:
            for data in (good, good[:50], b'', messages.serialize(lying), good):
                writer.write_raw('/image_raw', messages.IMAGE, data, STAMP)
        source = BagFrames(tmp_path / 'a.mcap')
        assert [frame.index for frame in source] == [0, 4]
        assert source.bad_frames == 3

    def test_compressed_pictures(self, tmp_path: Path) -> None:
        png = cv2.imencode('.png', noise(5))[1].tobytes()
        jpeg = cv2.imencode('.jpg', noise(5))[1].tobytes()
        with BagWriter(tmp_path / 'a.mcap') as writer:
            for data, kind in ((png, 'png'), (jpeg[:-100], 'jpeg'), (b'no picture', 'jpeg')):
                writer.write_compressed(data, kind, STAMP)
        source = BagFrames(tmp_path / 'a.mcap')
        frames = list(source)
        assert [frame.index for frame in frames] == [0]
        assert np.array_equal(frames[0].image, noise(5))
        assert source.bad_frames == 2

    def test_twelve_bits_are_learnt_anew_in_every_pass(self, tmp_path: Path) -> None:
        samples = np.array([[16, 3200, 4000], [16, 1600, 160]], '<u2')
        with BagWriter(tmp_path / 'a.mcap') as writer:
            for index, row in enumerate(samples):
                picture = messages.image(np.zeros((1, 3), np.uint8), STAMP + index, 'camera')
                picture.encoding, picture.step, picture.data = 'mono16', 6, row.view(np.uint8)
                writer.write('/image_raw', picture, STAMP + index)
        source = BagFrames(tmp_path / 'a.mcap')
        for _ in range(2):
            assert [frame.image.tolist() for frame in source] == [[[1, 200, 250]], [[1, 100, 10]]]

    def test_compressed_twelve_bits_are_learnt_too(self, tmp_path: Path) -> None:
        with BagWriter(tmp_path / 'a.mcap') as writer:
            for index, row in enumerate(([16, 3200, 4000], [16, 1600, 160])):
                png = cv2.imencode('.png', np.array([row], np.uint16))[1].tobytes()
                writer.write_compressed(png, '16UC1; png compressed mono16', STAMP + index)
        source = BagFrames(tmp_path / 'a.mcap')
        for _ in range(2):
            assert [frame.image.tolist() for frame in source] == [[[1, 200, 250]], [[1, 100, 10]]]

    def test_prefers_raw_where_a_compressed_copy_is_beside(self, tmp_path: Path) -> None:
        with BagWriter(tmp_path / 'a.mcap') as writer:
            writer.write_compressed(cv2.imencode('.png', noise(1))[1].tobytes(), 'png', STAMP)
            writer.write_image(noise(1), STAMP)
        assert BagFrames(tmp_path / 'a.mcap').topic.name == '/image_raw'

    def test_takes_a_topic_without_its_slash(self, bag: Path) -> None:
        assert BagFrames(bag, 'image_raw').topic.name == '/image_raw'

    def test_wrong_topic_lists_the_image_topics_with_counts(self, bag: Path) -> None:
        with pytest.raises(SourceError) as caught:
            BagFrames(bag, '/camera_info')
        assert str(caught.value) == (f"{bag}: no image topic '/camera_info'; image topics (type, messages): "
                                     '/image_raw (sensor_msgs/msg/Image, 12)')

    def test_several_topics_must_be_chosen_from(self, tmp_path: Path) -> None:
        with BagWriter(tmp_path / 'a.mcap') as writer:
            for topic in ('/left/image_raw', '/right/image_raw'):
                writer.write_image(noise(0), STAMP, topic)
        with pytest.raises(SourceError, match=r'--topic.*/left/image_raw \(.*, 1\), /right/image_raw \(.*, 1\)'):
            BagFrames(tmp_path / 'a.mcap')

    def test_an_empty_bag_is_refused(self, tmp_path: Path) -> None:
        with BagWriter(tmp_path / 'a.mcap'):
            pass
        with pytest.raises(SourceError, match=r'the bag is empty \(0 messages in 0 topics\)'):
            BagFrames(tmp_path / 'a.mcap')


def test_a_file_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'text.mcap').write_text('hello')
    with pytest.raises(SourceError, match=r'text.mcap: 5 bytes that are no bag; expected an MCAP file, a db3'):
        BagReader(tmp_path / 'text.mcap')


def test_a_missing_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match='nowhere.mcap: no such bag'):
        BagReader(tmp_path / 'nowhere.mcap')


def test_inspect_counts_messages_of_any_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """MCAP keeps times as uint64."""
    with BagWriter(tmp_path / 'a.mcap') as writer:
        for index, recorded in enumerate((STAMP, STAMP + PERIOD, 2**63 + 5, 2**64 - 1)):
            writer.write('/image_raw', messages.image(noise(index), STAMP, 'camera'), recorded)
    assert main(['inspect', str(tmp_path / 'a.mcap')]) == 0
    assert '4 readable messages' in capsys.readouterr().out
