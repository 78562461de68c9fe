"""detections.mcap, read by rosbags with the definitions in the file alone, and by the MCAP library."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_contents import contents
from mcap.reader import make_reader
from result_samples import FOUND, UNKNOWN, interrupted, write
from rosbags.typesys import Stores, get_typestore

from motion_detect_ros.core.drawing import color_of
from motion_detect_ros.core.types import DETECTION_DTYPE
from motion_detect_ros.results.detection_bag import jpeg
from motion_detect_ros.results.detection_writer import FrameDetections
from motion_detect_ros.sources.images import decode_image


def test_rosbags_knows_none_of_these_types_by_itself() -> None:
    """Otherwise the tests below would say nothing about the definition in the file."""
    known = get_typestore(Stores.ROS2_JAZZY).types
    assert [name for name in known if name.startswith(('vision_msgs', 'foxglove_msgs'))] == []


def test_boxes_are_read_by_the_definition_in_the_file(tmp_path: Path) -> None:
    write(tmp_path, 'mcap')
    boxes = contents(tmp_path / 'detections.mcap')['/detections_2d']
    assert [stamp for stamp, _ in boxes] == [found.stamp_ns for found in FOUND]
    assert [len(message.detections) for _, message in boxes] == [1, 2, 0]
    stamp_ns, message = boxes[1]
    box = message.detections[1]
    assert (box.id, box.results[0].hypothesis.class_id, box.results[0].hypothesis.score) == ('9', 'moving', 0.75)
    assert (box.bbox.center.position.x, box.bbox.center.position.y, box.bbox.center.theta) == (300.0, 200.25, 0.0)
    assert (box.bbox.size_x, box.bbox.size_y) == (32.0, 16.5)
    for header in (message.header, box.header):
        assert header.stamp.sec * 10**9 + header.stamp.nanosec == stamp_ns
        assert header.frame_id == 'camera_optical_frame'
    pose = box.results[0].pose
    assert (pose.pose.orientation.w, pose.pose.position.x, np.abs(pose.covariance).max()) == (1.0, 0.0, 0.0)


def test_annotations_are_read_by_the_definition_in_the_file(tmp_path: Path) -> None:
    """A closed line around the box from its left top corner on, in the colour of its track, and its id."""
    write(tmp_path, 'mcap', found=[FOUND[1], UNKNOWN])
    (stamp_ns, message), (_, unknown) = contents(tmp_path / 'detections.mcap')['/annotations']
    outline, text = message.points[1], message.texts[1]
    assert [(point.x, point.y) for point in outline.points] == [(284, 192), (316, 192), (316, 208.5), (284, 208.5)]
    assert (outline.type, outline.thickness, outline.fill_color.a) == (outline.LINE_LOOP, 1.0, 0.0)
    assert outline.LINE_LOOP == 2
    for color in (outline.outline_color, text.text_color):
        assert (round(255 * color.b), round(255 * color.g), round(255 * color.r), color.a) == (*color_of(9), 1.0)
    assert (text.text, text.position.x, text.position.y, text.font_size) == ('9', 284, 192, 12)
    assert {part.timestamp.sec * 10**9 + part.timestamp.nanosec for part in (outline, text)} == {stamp_ns}
    assert (len(message.points), len(message.texts), len(unknown.points)) == (2, 2, 0)


def test_records_are_the_same_as_in_the_topic(tmp_path: Path) -> None:
    write(tmp_path, 'mcap')
    clouds = contents(tmp_path / 'detections.mcap')['/detections']
    assert [np.frombuffer(cloud.data.tobytes(), DETECTION_DTYPE).tobytes() for _, cloud in clouds] == [
        found.records.tobytes() for found in FOUND]


def test_the_mcap_library_finds_schema_and_index(tmp_path: Path) -> None:
    write(tmp_path, 'mcap')
    with (tmp_path / 'detections.mcap').open('rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    schemas = {channel.topic: summary.schemas[channel.schema_id] for channel in summary.channels.values()}
    assert {topic: (schema.name, schema.encoding) for topic, schema in schemas.items()} == {
        '/detections': ('sensor_msgs/msg/PointCloud2', 'ros2msg'),
        '/detections_2d': ('vision_msgs/msg/Detection2DArray', 'ros2msg'),
        '/annotations': ('foxglove_msgs/msg/ImageAnnotations', 'ros2msg')}
    definition = schemas['/detections_2d'].data.decode()
    assert definition.startswith('std_msgs/Header header\nvision_msgs/Detection2D[] detections\n')
    for name in ('Detection2D', 'BoundingBox2D', 'Pose2D', 'Point2D', 'ObjectHypothesisWithPose', 'ObjectHypothesis'):
        assert f'\nMSG: vision_msgs/{name}\n' in definition
    assert summary.statistics.message_count == 3 * len(FOUND)


def test_pictures_carry_their_boxes(tmp_path: Path) -> None:
    """The edge of the box has the colour of its track, up to JPEG; what is far from it stays grey."""
    grey = np.full((480, 640), 100, np.uint8)
    found = [FrameDetections(each.frame, each.stamp_ns, each.records, each.size, grey) for each in FOUND]
    write(tmp_path, 'mcap', found=found)
    pictures = contents(tmp_path / 'detections.mcap')['/overlay/overlay/compressed']
    assert [(stamp, message.format) for stamp, message in pictures] == [(each.stamp_ns, 'jpeg') for each in FOUND]
    drawn = [decode_image(message.data.tobytes(), 'picture').astype(int) for _, message in pictures]
    assert [picture.shape for picture in drawn] == [(480, 640, 3)] * 3
    left, top = 284, 192  # of the second box: 300 - 32 / 2, 200.25 - 16.5 / 2
    assert np.abs(drawn[1][top, left + 4:left + 28] - np.array(color_of(9))).mean() < 60
    assert np.abs(drawn[1][300:] - 100).max() < 8
    assert np.abs(drawn[2] - 100).max() < 8, 'nothing was found there'


def test_messages_are_in_the_frame_of_the_picture(tmp_path: Path) -> None:
    grey = np.full((480, 640), 100, np.uint8)
    found = [FrameDetections(each.frame, each.stamp_ns, each.records, each.size, grey, frame_id)
             for each, frame_id in zip(FOUND, ('front_optical', 'rear_optical', ''), strict=True)]
    write(tmp_path, 'mcap', found=found)
    written = contents(tmp_path / 'detections.mcap')
    for topic in ('/detections', '/detections_2d', '/overlay/overlay/compressed'):
        assert [message.header.frame_id for _, message in written[topic]] == ['front_optical', 'rear_optical', '']
    boxes = [box.header.frame_id for _, message in written['/detections_2d'] for box in message.detections]
    assert set(boxes) == {'front_optical', 'rear_optical'}


def test_without_pictures_there_is_no_topic_for_them(tmp_path: Path) -> None:
    write(tmp_path, 'mcap')
    assert sorted(contents(tmp_path / 'detections.mcap')) == ['/annotations', '/detections', '/detections_2d']


def test_jpeg_keeps_the_picture() -> None:
    image = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8), (0, 0), 3)
    data = jpeg(image)
    assert data[:3] == b'\xff\xd8\xff'
    assert np.abs(decode_image(data, 'picture').astype(int) - image).max() < 30


@pytest.mark.parametrize('topic', ['/annotations', '/detections', '/detections_2d'])
def test_what_an_interrupted_run_leaves_is_readable(topic: str, tmp_path: Path) -> None:
    interrupted(tmp_path, 'mcap')
    assert [path.name for path in tmp_path.iterdir()] == ['detections.mcap.part']
    with (tmp_path / 'detections.mcap.part').open('rb') as stream:
        stamps = [message.log_time for _, _, message in make_reader(stream).iter_messages([topic])]
    assert stamps == [found.stamp_ns for found in FOUND]
