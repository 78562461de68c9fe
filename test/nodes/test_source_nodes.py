"""The nodes at both ends: camera and bag player make messages, the overlay makes pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from lifecycle_msgs.msg import Transition
from mcap.writer import Writer
from peers import PATIENT, TIMEOUT_S, image_message, lossless, own_lines, picture, ready, set_parameters, small
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu, PointCloud2
from std_srvs.srv import Trigger
from test_stage_nodes import change

from motion_detect_ros.bridge.images import header_of, image_from_msg, stamp_ns
from motion_detect_ros.bridge.records import detections_to_msg
from motion_detect_ros.core.types import NANOSECONDS, CameraModel, empty_detections
from motion_detect_ros.sources import messages
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.camera_info import camera_of

PERIOD_NS = 50_000_000
#: For messages that must not come: as long as a player stays after its last one, seconds.
LINGER_S = 0.5
STAMPS = [1_600_000_000 * NANOSECONDS + index * PERIOD_NS for index in range(8)]


@pytest.fixture
def pictures(tmp_path):
    """A folder of eight PNG files."""
    folder = tmp_path / 'pictures'
    folder.mkdir()
    for index in range(8):
        cv2.imwrite(str(folder / f'{index:03d}.png'), picture(index))
    return folder


@pytest.fixture
def bag(tmp_path):
    """Eight images from /image_raw, their calibration, and one image from /rear/image_raw."""
    path = tmp_path / 'flight.mcap'
    with BagWriter(path) as writer:
        for index, stamp in enumerate(STAMPS):
            writer.write_camera_info(CameraModel(320, 240, 300.0, 301.0, 160.0, 120.0), stamp)
            writer.write_image(picture(index), stamp)
        writer.write_image(picture(9), STAMPS[-1], '/rear/image_raw')
    return path


def film(peer, start, pictures, received, count, *arguments):
    """``pictures`` by the camera, none left out, until it ends, and a little longer; ``received`` gets ``count``."""
    given = ('-p', 'wait_for_subscribers:=1', '-p', 'realtime:=false',
             *lossless('image_raw', 'image_raw/compressed', 'camera_info'))
    process = start('camera', '-p', f'source:={pictures}', '-p', 'fps:=10.0', *given, *arguments)
    assert peer.until(lambda: len(received) >= count), len(received)
    assert peer.until(lambda: process.poll() is not None)
    peer.rest(LINGER_S)
    assert len(received) == count


def test_camera_publishes_every_picture_of_a_folder_and_ends(peer, start, pictures):
    images, infos = peer.subscribe(Image, 'image_raw'), peer.subscribe(CameraInfo, 'camera_info')
    film(peer, start, pictures, images, 8, '-p', 'frame_id:=nose')
    assert peer.until(lambda: len(infos) == 8)
    for index, message in enumerate(images):
        np.testing.assert_array_equal(image_from_msg(message), picture(index))
        assert (message.encoding, message.header.frame_id) == ('bgr8', 'nose')
    assert np.diff([stamp_ns(m.header) for m in images]) == pytest.approx([0.1 * NANOSECONDS] * 7)
    assert [m.header for m in infos] == [m.header for m in images]
    assert list(infos[0].k) == [0.0] * 9  # REP 104: uncalibrated


CALIBRATION = """
image_width: {width}
image_height: 240
camera_name: narrow_stereo
camera_matrix: {{rows: 3, cols: 3, data: [438.1, 0, 163.5, 0, 439.2, 118.2, 0, 0, 1]}}
distortion_model: {model}
distortion_coefficients: {{rows: 1, cols: 4, data: [-0.3, 0.1, 0.001, 0]}}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [400.0, 0, 162.0, 0, 0, 420.0, 119.0, 0, 0, 0, 1, 0]}}
"""


@pytest.mark.parametrize(('width', 'known'), [(320, True), (640, False)])
def test_camera_publishes_the_calibration_that_fits_its_images(peer, start, pictures, tmp_path, width, known):
    file = tmp_path / 'lens.yaml'
    file.write_text(CALIBRATION.format(width=width, model='equidistant'))
    images, infos = peer.subscribe(Image, 'image_raw'), peer.subscribe(CameraInfo, 'camera_info')
    film(peer, start, pictures, images, 8, '-p', f'camera_info_url:=file://{file}')
    assert peer.until(lambda: len(infos) == 8)
    info, header = infos[3], images[3].header
    assert (info.header, info.width, info.height) == (header, 320, 240)
    assert (info.k[0], info.p[5], info.distortion_model) == ((438.1, 420.0, 'equidistant') if known
                                                             else (0.0, 0.0, 'plumb_bob'))
    printed = (tmp_path / 'camera.log').read_text()
    assert ('expected one of 320x240 px, got 640x240' in printed) != known


def test_camera_takes_two_of_five(peer, start, pictures):
    images = peer.subscribe(Image, 'image_raw')
    film(peer, start, pictures, images, 4, '-p', 'decimation_keep:=2', '-p', 'decimation_of:=5')
    for message, index in zip(images, (0, 1, 5, 6), strict=True):
        np.testing.assert_array_equal(image_from_msg(message), picture(index))


def test_camera_plays_the_topic_of_a_bag_that_is_asked_for(peer, start, bag):
    images, infos = peer.subscribe(Image, 'image_raw'), peer.subscribe(CameraInfo, 'camera_info')
    film(peer, start, bag, images, 8, '-p', 'topic:=image_raw')
    assert [stamp_ns(message.header) for message in images] == STAMPS
    np.testing.assert_array_equal(image_from_msg(images[3]), picture(3))
    assert peer.until(lambda: len(infos) == 8)
    assert infos[0].k[0] == 300.0


def test_camera_publishes_the_camera_info_of_a_bag_as_it_was_recorded(peer, start, tmp_path):
    """Of a rectified topic: stages take its matrix P with rectified:=true."""
    path = tmp_path / 'rectified.mcap'
    given = {'k': [438.1, 0.0, 163.5, 0.0, 439.2, 118.2, 0.0, 0.0, 1.0],
             'r': [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
             'p': [400.0, 0.0, 162.0, -48.0, 0.0, 420.0, 119.0, 0.0, 0.0, 0.0, 1.0, 0.0],
             'd': [-0.3, 0.1, 0.001, 0.0, 0.0]}
    roi = messages.make('sensor_msgs/msg/RegionOfInterest', x_offset=8, y_offset=4, width=640, height=480)
    with BagWriter(path) as writer:
        for index, stamp in enumerate(STAMPS):
            writer.write('/camera_info', messages.make(
                messages.CAMERA_INFO, header=messages.header(stamp, 'eye'), width=1280, height=960, binning_x=2,
                binning_y=2, roi=roi, distortion_model='rational_polynomial',
                **{name: np.array(values) for name, values in given.items()}), stamp)
            writer.write_image(picture(index), stamp)
    images, infos = peer.subscribe(Image, 'image_raw'), peer.subscribe(CameraInfo, 'camera_info')
    film(peer, start, path, images, 8, '-p', 'frame_id:=nose')
    assert peer.until(lambda: len(infos) == 8)
    info = infos[3]
    assert (info.header, info.header.frame_id) == (images[3].header, 'nose')
    assert {name: list(getattr(info, name)) for name in given} == given
    assert (info.width, info.height, info.binning_x, info.binning_y) == (1280, 960, 2, 2)
    assert (info.roi.x_offset, info.roi.width, info.distortion_model) == (8, 640, 'rational_polynomial')
    assert camera_of(info, rectified=True).fx == 200.0


def test_camera_asks_which_topic_of_a_bag_it_shall_play(start, bag, tmp_path):
    process = start('camera', '-p', f'source:={bag}', code=2)
    process.wait(TIMEOUT_S)
    assert 'several image topics, choose one: --topic, or topic of the camera node; image topics' in (
        tmp_path / 'camera.log').read_text()


def test_camera_compresses_for_those_who_ask(peer, start, pictures):
    jpegs = peer.subscribe(CompressedImage, 'image_raw/compressed')
    film(peer, start, pictures, jpegs, 8)
    for index, message in enumerate(jpegs):
        assert bytes(message.data[:3]) == b'\xff\xd8\xff'  # the mark every JPEG begins with
        assert np.abs(image_from_msg(message).astype(int) - picture(index)).mean() < 10.0


def test_camera_says_once_that_pictures_are_too_wide_for_jpeg(peer, start, tmp_path):
    folder = tmp_path / 'wide'
    folder.mkdir()
    for index in range(8):
        cv2.imwrite(str(folder / f'{index}.png'), np.full((4, 66_000), index, np.uint8))
    jpegs, images = peer.subscribe(CompressedImage, 'image_raw/compressed'), peer.subscribe(Image, 'image_raw')
    film(peer, start, folder, images, 8)
    assert jpegs == []
    assert (tmp_path / 'camera.log').read_text().count('JPEG: expected up to 65500 pixels a side, got 66000x4') == 1


def play(peer, start, bag, received, count, *arguments):
    """The bag by the player, until it ends and ``received`` holds ``count``, and a little longer."""
    given = ('-p', 'wait_for_subscribers:=1',
             *lossless('image_raw', 'rear/image_raw', 'seen', 'camera_info', 'clock'))
    process = start('bag_player', '-p', f'bag:={bag}', *given, *arguments)
    assert peer.until(lambda: len(received) >= count), len(received)
    assert peer.until(lambda: process.poll() is not None)
    peer.rest(LINGER_S)
    assert len(received) == count


@pytest.mark.messages
def test_player_plays_what_was_recorded_with_its_stamps(peer, start, bag):
    images, rear = peer.subscribe(Image, 'image_raw'), peer.subscribe(Image, 'rear/image_raw')
    infos, ticks = peer.subscribe(CameraInfo, 'camera_info'), peer.subscribe(Clock, '/clock')
    play(peer, start, bag, images, 8)
    assert [stamp_ns(m.header) for m in images] == STAMPS
    assert peer.until(lambda: len(infos) == 8 and len(rear) == 1 and len(ticks) == 17)
    assert [stamp_ns(m.header) for m in infos] == STAMPS
    assert [stamp_ns(m.header) for m in rear] == STAMPS[-1:]
    for index, message in enumerate(images):
        np.testing.assert_array_equal(image_from_msg(message), picture(index))
    assert sorted({t.clock.sec * NANOSECONDS + t.clock.nanosec for t in ticks}) == STAMPS
    assert infos[0].k[4] == 301.0


@pytest.mark.timing
def test_player_keeps_the_recorded_pace_times_rate(peer, start, bag):
    arrivals: list[float] = []
    peer.node.create_subscription(Image, 'image_raw', lambda _: arrivals.append(now_s(peer)), 10)
    play(peer, start, bag, arrivals, 8, '-p', 'rate:=0.5')
    assert arrivals[-1] - arrivals[0] == pytest.approx(7 * 0.05 / 0.5, abs=0.1)


def clock_ns(ticks) -> list[int]:
    return [tick.clock.sec * NANOSECONDS + tick.clock.nanosec for tick in ticks]


@pytest.mark.messages
def test_the_clock_is_when_messages_were_recorded_and_does_not_go_back(peer, start, tmp_path):
    """Two cameras whose stamps are 30 and 700 ms old when they are recorded; the writer was late with one message."""
    path, log = tmp_path / 'flight.mcap', [STAMPS[0] + ms * 1_000_000 for ms in (0, 10, 20, 5, 30)]
    with BagWriter(path, compress=False) as writer:
        for index, recorded in enumerate(log):
            topic, age_ns = (('/image_raw', 30_000_000), ('/rear/image_raw', 700_000_000))[index % 2]
            picture = messages.image(np.zeros((600, 700, 3), np.uint8), recorded - age_ns, 'eye')  # a chunk each
            writer.write(topic, picture, recorded)
    images, ticks = peer.subscribe(Image, 'image_raw'), peer.subscribe(Clock, '/clock')
    play(peer, start, path, ticks, 5)
    assert peer.until(lambda: len(images) == 3)
    assert clock_ns(ticks) == [log[0], log[1], log[2], log[2], log[4]]


@pytest.mark.messages
def test_a_bag_without_images_has_a_clock(peer, start, tmp_path):
    path, ticks = tmp_path / 'imu.mcap', peer.subscribe(Clock, '/clock')
    with BagWriter(path) as writer:
        for stamp in STAMPS:
            writer.write('/imu', messages.make(messages.IMU), stamp)
    rates = peer.subscribe(Imu, 'imu')
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'loop:=true', '-p', 'rate:=2')
    assert peer.until(lambda: len(ticks) > 16)
    assert peer.until(lambda: rates)
    assert set(clock_ns(ticks)) == set(STAMPS)
    falls = np.flatnonzero(np.diff(clock_ns(ticks)) < 0)
    assert {clock_ns(ticks)[index + 1] for index in falls} == {STAMPS[0]}  # the next round of the loop only
    assert process.poll() is None


@pytest.mark.messages
def test_a_player_without_clock_leaves_it_to_another(peer, start, bag):
    images, ticks = peer.subscribe(Image, 'image_raw'), peer.subscribe(Clock, '/clock')
    start('bag_player', '-p', f'bag:={bag}', '-p', 'loop:=true', '-p', 'clock:=false')
    assert peer.until(lambda: len(images) >= 8)
    assert (peer.node.count_publishers('/clock'), ticks) == (0, [])


def now_s(peer) -> float:
    return peer.node.get_clock().now().nanoseconds * 1e-9


def test_whole_numbers_may_stand_for_texts_and_rates(peer, start, pictures):
    images = peer.subscribe(Image, 'image_raw')
    film(peer, start, pictures, images, 8, '-p', 'frame_id:=7', '-p', 'fps:=5')
    assert {m.header.frame_id for m in images} == {'7'}
    assert np.diff([stamp_ns(m.header) for m in images]) == pytest.approx([0.2 * NANOSECONDS] * 7)


def test_camera_number_needs_no_quotes(peer, start, tmp_path):
    process = start('camera', '-p', 'source:=87', code=2)
    assert peer.until(lambda: process.poll() is not None)
    assert own_lines((tmp_path / 'camera.log').read_text()) == ['87: cannot be opened as a camera']


@pytest.mark.messages
def test_player_plays_chosen_topics_only(peer, start, bag):
    images, rear = peer.subscribe(Image, 'image_raw'), peer.subscribe(Image, 'seen')
    play(peer, start, bag, rear, 1, '-p', 'topics:=/rear/image_raw', '-r', 'rear/image_raw:=seen')
    assert not images
    np.testing.assert_array_equal(image_from_msg(rear[0]), picture(9))


@pytest.fixture
def recorded_run(tmp_path):
    """Images with what the detector answered, as users record it, and a topic of another program."""
    path = tmp_path / 'run.mcap'
    header = header_of(STAMPS[0], 'camera')
    results = {'/detections': PointCloud2(header=header), '/front/ego_motion': PointCloud2(header=header),
               '/flow': Image(header=header), '/overlay/overlay': Image(header=header),
               '/diagnostics': DiagnosticArray(), '/lidar/flow': PointCloud2(header=header)}
    with BagWriter(path) as writer:
        for index, stamp in enumerate(STAMPS):
            writer.write_image(picture(index), stamp)
            for topic, message in results.items():
                kind = type(message)
                writer.write_raw(topic, f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}',
                                 serialize_message(message), stamp)
    return path


LEFT_OUT = ('left out, recorded results of this package: /detections, /diagnostics, /flow, /front/ego_motion, '
            '/overlay/overlay')


@pytest.mark.parametrize(('arguments', 'results', 'left_out'), [
    (('-p', 'play_results:=false'), 0, LEFT_OUT),
    (('-p', 'play_results:=false', '-p', 'topics:=image_raw,detections'), 8, ''),
    ((), 8, ''),
], ids=['left out', 'named', 'as ros2 bag play'])
@pytest.mark.messages
def test_recorded_results_are_played_unless_a_detector_runs(
        peer, start, tmp_path, recorded_run, arguments, results, left_out):
    images, others = peer.subscribe(Image, 'image_raw'), peer.subscribe(PointCloud2, 'lidar/flow')
    detections = peer.subscribe(PointCloud2, 'detections')
    process = start('bag_player', '-p', f'bag:={recorded_run}', '-p', 'wait_for_subscribers:=1',
                    *lossless('image_raw', 'detections', 'lidar/flow'), *arguments)
    assert peer.until(lambda: process.poll() is not None and len(images) == 8 and len(detections) >= results)
    peer.rest(LINGER_S)
    assert (len(images), len(detections)) == (8, results)
    assert bool(others) != ('topics:=' in str(arguments))
    printed = (tmp_path / 'bag_player.log').read_text()
    said = [line.partition('run.mcap: ')[2] for line in own_lines(printed) if 'left out' in line]
    assert said == ([left_out] if left_out else [])


@pytest.mark.messages
def test_a_bag_of_nothing_but_results_is_refused(start, tmp_path):
    path = tmp_path / 'results.mcap'
    with BagWriter(path) as writer:
        writer.write_raw('/detections', 'sensor_msgs/msg/PointCloud2', serialize_message(PointCloud2()), STAMPS[0])
    assert start('bag_player', '-p', f'bag:={path}', '-p', 'play_results:=false', code=2).wait(TIMEOUT_S) == 2
    assert 'expected messages to play, found none' in (tmp_path / 'bag_player.log').read_text()


@pytest.mark.messages
def test_a_bag_without_a_known_type_is_not_played_for_ever(peer, start, tmp_path):
    path = tmp_path / 'flight.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2')
        schema = writer.register_schema('none_msgs/msg/Thing', 'ros2msg', b'string name')
        writer.add_message(writer.register_channel('/things', 'cdr', schema), STAMPS[0], b'', STAMPS[0])
        writer.finish()
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'loop:=true', code=2)
    assert peer.until(lambda: process.poll() is not None)
    assert f'{path}: expected a topic that can be played, got none' in (tmp_path / 'bag_player.log').read_text()


@pytest.mark.messages
def test_late_subscribers_get_the_static_transforms(peer, start, tmp_path):
    """By the topic's name: tf2_msgs, its usual type, has no wheels."""
    path, kind = tmp_path / 'flight.mcap', 'geometry_msgs/msg/TransformStamped'
    with BagWriter(path) as writer:
        writer.write('/tf_static', messages.make(kind, child_frame_id='camera'), STAMPS[0])
        writer.write_image(picture(0), STAMPS[0])
        writer.write_image(picture(1), STAMPS[0] + 60 * NANOSECONDS)
    images, received = peer.subscribe(Image, 'image_raw'), []
    start('bag_player', '-p', f'bag:={path}', '-p', 'wait_for_subscribers:=1')
    assert peer.until(lambda: images)
    late = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    peer.node.create_subscription(TransformStamped, '/tf_static', received.append, late)
    assert peer.until(lambda: received)
    assert received[0].child_frame_id == 'camera'


@pytest.mark.messages
def test_player_starts_again_at_the_end(peer, start, bag):
    images = peer.subscribe(Image, 'image_raw')
    start('bag_player', '-p', f'bag:={bag}', '-p', 'loop:=true', '-p', 'rate:=10', '-p', 'wait_for_subscribers:=1',
          *lossless('image_raw'))
    assert peer.until(lambda: len(images) >= 20)
    assert [stamp_ns(m.header) for m in images[:20]] == (STAMPS * 3)[:20]


def test_overlay_draws_only_while_someone_subscribes(peer, start):
    start('overlay')
    publisher, boxes = peer.advertise(Image, 'image_raw'), peer.advertise(PointCloud2, 'detections')
    assert peer.until(lambda: 'overlay' in peer.node.get_node_names())
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    assert peer.until(lambda: len(reports) >= 2)  # a second apart: it has looked for subscribers in between
    assert {message.status[0].message for message in reports} == {'no subscribers'}
    assert peer.node.count_subscribers('image_raw') == 0
    drawn = peer.subscribe(Image, '/overlay/overlay')
    assert ready(peer, 'image_raw')
    assert ready(peer, 'detections')
    records = empty_detections(1)
    for name, value in {'u': 100, 'v': 80, 'width': 60, 'height': 40, 'id': 3}.items():
        records[name] = value
    image = image_message(0)
    publisher.publish(image)
    boxes.publish(detections_to_msg(records, image.header))
    assert peer.until(lambda: drawn)
    assert drawn[0].header == image.header
    changed = np.abs(image_from_msg(drawn[0]).astype(int) - picture(0)).max(axis=2) > 0
    assert changed[60, 75:125].all()  # the upper edge of a box from (70, 60) to (130, 100)
    assert changed[100, 75:125].all()
    assert changed[65:95, 70].all()
    assert changed[65:95, 130].all()
    assert changed[59:103, 68:133].mean() < 0.5
    assert not changed[120:, :].any()


def test_overlay_leaves_out_what_never_gets_detections(peer, start):
    start('overlay')
    publisher, boxes = peer.advertise(Image, 'image_raw'), peer.advertise(PointCloud2, 'detections')
    drawn, reports = peer.subscribe(Image, '/overlay/overlay'), peer.subscribe(DiagnosticArray, '/diagnostics')
    assert ready(peer, 'image_raw')
    assert ready(peer, 'detections')

    def latest() -> dict[str, str]:
        return {pair.key: pair.value for pair in reports[-1].status[0].values} if reports else {}

    for index in range(3):  # its subscription holds one image
        publisher.publish(image_message(index))
        assert peer.until(lambda index=index: latest().get('received') == str(index + 1)), latest()
    boxes.publish(detections_to_msg(empty_detections(), header_of(300_000_000, 'front')))
    assert peer.until(lambda: drawn)
    assert [stamp_ns(m.header) for m in drawn] == [300_000_000]
    np.testing.assert_array_equal(image_from_msg(drawn[0]), picture(2))
    assert peer.until(lambda: latest().get('processed') == '1'), latest()
    assert (latest()['received'], latest()['left_out'], latest()['dropped']) == ('3', '2', '0')
    assert float(latest()['latency_p50_ms']) > 0.0


@pytest.fixture
def long_bag(tmp_path):
    """An hour: an image every 100 s, and a static transform at the start."""
    path = tmp_path / 'long.mcap'
    with BagWriter(path) as writer:
        writer.write('/tf_static', messages.make('geometry_msgs/msg/TransformStamped'), STAMPS[0])
        for index in range(37):
            writer.write_image(picture(index), STAMPS[0] + index * 100 * NANOSECONDS)
    return path


@pytest.mark.messages
def test_player_is_steered_while_it_plays(peer, start, long_bag):
    images = peer.subscribe(Image, 'image_raw')
    process = start('bag_player', '-p', f'bag:={long_bag}', '-p', 'wait_for_nodes:=peer', '-p', 'position_s:=3000.0',
                    *lossless('image_raw'))
    assert peer.until(lambda: images)
    assert stamp_ns(images[0].header) == STAMPS[0] + 3000 * NANOSECONDS
    assert peer.call(Trigger, '/bag_player/pause').message == 'paused'
    assert set_parameters(peer, 'bag_player', position_s=1000) == ['']
    peer.rest(LINGER_S)
    assert len(images) == 1
    assert peer.call(Trigger, '/bag_player/resume').message == 'playing'
    assert peer.until(lambda: len(images) == 2)
    assert stamp_ns(images[1].header) == STAMPS[0] + 1000 * NANOSECONDS
    refused, = set_parameters(peer, 'bag_player', rate=0.0)
    assert 'rate' in refused
    assert set_parameters(peer, 'bag_player', rate=1000) == ['']
    assert peer.until(lambda: process.poll() is not None)
    peer.rest(LINGER_S)
    assert [stamp_ns(each.header) for each in images[1:]] == [
        STAMPS[0] + index * 100 * NANOSECONDS for index in range(10, 37)]


@pytest.mark.messages
def test_player_waits_for_the_stages_and_not_for_just_anybody(peer, start, bag, tmp_path):
    images, detections = peer.subscribe(Image, 'image_raw'), peer.subscribe(PointCloud2, 'detections')
    start('bag_player', '-p', f'bag:={bag}', '-p', 'wait_for_nodes:=pipeline', *lossless('image_raw'))
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    waiting = 'waiting for /pipeline to subscribe to /image_raw or /rear/image_raw'
    assert peer.until(lambda: [message for message in reports if message.status[0].message == waiting])
    assert peer.until(lambda: waiting in (tmp_path / 'bag_player.log').read_text())
    assert not images
    assert peer.call(Trigger, '/bag_player/pause').message == 'paused'
    start('pipeline', *small(*PATIENT))
    assert peer.until(lambda: 'paused' in reports[-1].status[0].message)  # so it waits no more: the pipeline is there
    peer.known_to('/pipeline')  # which would answer nobody before
    assert peer.call(Trigger, '/bag_player/resume').message == 'playing'
    assert peer.until(lambda: len(detections) == 8)
    assert [stamp_ns(m.header) for m in detections] == STAMPS


@pytest.mark.parametrize(('size', 'published'), [((320, 240), [-0.3, 0.1, 0.0, 0.0, 0.0]), ((640, 480), None)])
def test_camera_publishes_the_calibration_of_a_bag_with_its_lens_unless_it_is_of_another_size(
    peer, start, tmp_path, size, published,
):
    path, infos = tmp_path / 'lens.mcap', peer.subscribe(CameraInfo, 'camera_info')
    peer.subscribe(Image, 'image_raw')  # which the camera waits for
    with BagWriter(path) as writer:
        for index, stamp in enumerate(STAMPS):
            writer.write_camera_info(
                CameraModel(*size, 300.0, 301.0, 160.0, 120.0, (-0.3, 0.1, 0.0, 0.0, 0.0)), stamp)
            writer.write_image(picture(index), stamp)
    film(peer, start, path, infos, 8)
    assert {(info.width, info.height) for info in infos} == {(320, 240)}
    assert [list(info.d) for info in infos if info.k[0]] == ([published] * 8 if published else [])
    said = 'calibration not used: expected one of 320x240 px, got 640x480' in (tmp_path / 'camera.log').read_text()
    assert said == (published is None)


def damaged_inside(path):
    """A bag whose summary is whole while bytes of its chunks are not."""
    with BagWriter(path, compress=False, chunk_bytes=1 << 16) as writer:
        for index, stamp in enumerate(STAMPS):
            writer.write_image(picture(index), stamp)
    content = bytearray(path.read_bytes())
    for place in range(len(content) // 3, len(content) // 2, 50_000):
        content[place] ^= 0xff
    path.write_bytes(content)
    return path


@pytest.mark.parametrize('node', ['bag_player', 'camera'])
def test_damage_that_shows_while_a_file_is_read_is_told(peer, start, tmp_path, node):
    path, images = damaged_inside(tmp_path / 'bad.mcap'), peer.subscribe(Image, 'image_raw')
    given = ('-p', f'bag:={path}', '-p', 'rate:=10.0') if node == 'bag_player' else (
        '-p', f'source:={path}', '-p', 'realtime:=false')
    process = start(node, '-p', 'wait_for_subscribers:=1', *given, *lossless('image_raw'))
    assert peer.until(lambda: process.poll() is not None)
    assert 0 < len(images) < len(STAMPS)
    assert 'unreadable chunk(s) skipped' in (tmp_path / f'{node}.log').read_text()


def test_the_camera_leaves_out_an_image_whose_stamp_no_message_can_carry(peer, start, tmp_path):
    path, images = tmp_path / 'stamps.mcap', peer.subscribe(Image, 'image_raw')
    with BagWriter(path) as writer:
        for index, stamp in enumerate(STAMPS):
            image = messages.image(picture(index), stamp, 'eye')
            if index == 3:
                image.header.stamp.sec, image.header.stamp.nanosec = 2**31 - 1, 2**32 - 1
            writer.write('/image_raw', image, stamp)
    process = start('camera', '-p', f'source:={path}', '-p', 'wait_for_subscribers:=1', '-p', 'realtime:=false',
                    *lossless('image_raw'))
    assert peer.until(lambda: process.poll() is not None, 60.0)
    assert peer.until(lambda: len(images) == len(STAMPS) - 1, 10.0)
    assert [stamp_ns(message.header) for message in images] == [*STAMPS[:3], *STAMPS[4:]]
    assert 'input left out: stamp: expected seconds from -2147483648 to 2147483647, got 2147483651' in (
        tmp_path / 'camera.log').read_text()


def recorded_at(path, times_ns):
    """Images of ``STAMPS`` and on, recorded at other times, a chunk each."""
    with BagWriter(path, compress=False, chunk_bytes=1000) as writer:
        for index, recorded in enumerate(times_ns):
            writer.write('/image_raw', messages.image(picture(index), STAMPS[0] + index * PERIOD_NS, 'eye'), recorded)
    return path


@pytest.mark.parametrize('wild', [2**63 + 5, 2**64 - 1, STAMPS[0] + 30 * 86_400 * NANOSECONDS, 0])
@pytest.mark.messages
def test_a_wild_time_of_recording_neither_stops_the_player_nor_the_clock(peer, start, tmp_path, wild):
    path = recorded_at(tmp_path / 'wild.mcap', [*STAMPS[:4], wild, *STAMPS[5:]])
    images, ticks = peer.subscribe(Image, 'image_raw'), peer.subscribe(Clock, '/clock')
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'wait_for_subscribers:=1', '-p', 'rate:=0.1',
                    *lossless('image_raw', 'clock'))
    assert peer.until(lambda: process.poll() is not None, 60.0)
    assert peer.until(lambda: len(images) == len(STAMPS) == len(ticks), 10.0)
    assert clock_ns(ticks) == [*STAMPS[:4], STAMPS[3], *STAMPS[5:]]
    assert (tmp_path / 'bag_player.log').read_text().count('not waited for') == 1


@pytest.mark.messages
def test_a_recorder_without_a_clock_at_first(peer, start, tmp_path):
    path = recorded_at(tmp_path / 'zero.mcap', [0, *STAMPS[1:]])
    images, ticks = peer.subscribe(Image, 'image_raw'), peer.subscribe(Clock, '/clock')
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'wait_for_subscribers:=1', '-p', 'rate:=0.1',
                    *lossless('image_raw', 'clock'))
    assert peer.until(lambda: process.poll() is not None, 60.0)
    assert peer.until(lambda: len(images) == len(STAMPS) == len(ticks), 10.0)
    assert clock_ns(ticks) == [0, *STAMPS[1:]]


@pytest.mark.messages
def test_a_recording_whose_clock_was_set_back_keeps_its_pace_and_the_clock_goes_back_with_it(peer, start, tmp_path):
    """By an hour after three of eight images, which are 5 s apart."""
    times = [STAMPS[0] + 5 * index * NANOSECONDS + 3600 * NANOSECONDS * (index < 3) for index in range(8)]
    path = recorded_at(tmp_path / 'back.mcap', times)
    images, ticks, arrivals = peer.subscribe(Image, 'image_raw'), peer.subscribe(Clock, '/clock'), []
    peer.node.create_subscription(Image, 'image_raw', lambda _: arrivals.append(now_s(peer)), 10)
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'wait_for_subscribers:=2', '-p', 'rate:=10.0',
                    *lossless('image_raw', 'clock'))
    assert peer.until(lambda: process.poll() is not None, 60.0)
    assert peer.until(lambda: len(images) == 8 == len(ticks), 10.0)
    assert clock_ns(ticks) == times
    assert arrivals[-1] - arrivals[3] > 1.9  # four pauses of half a second; an upper limit would measure the machine
    said = (tmp_path / 'bag_player.log').read_text()
    assert said.count('/image_raw was recorded -3595.0 s from the time of those before it: not waited for') == 1


@pytest.mark.messages
def test_topics_that_cannot_be_played_cost_themselves_only(peer, start, tmp_path):
    """A JSON channel without a schema, and names that ROS 2 does not allow, as other tools write them."""
    path, images = tmp_path / 'odd.mcap', peer.subscribe(Image, 'image_raw')
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2', library='test')
        schema = writer.register_schema('sensor_msgs/msg/Image', 'ros2msg',
                                        messages.message_definition(messages.IMAGE).encode())
        channels = [writer.register_channel(topic, 'cdr', schema)
                    for topic in ('/image_raw', '/front-left/image', '/{0}')]
        bare = writer.register_channel('/log', 'json', 0)
        for index, stamp in enumerate(STAMPS):
            image = messages.serialize(messages.image(picture(index), stamp, 'eye'))
            for channel, data in (*((channel, image) for channel in channels), (bare, b'{}')):
                writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'wait_for_subscribers:=1', '-p', 'rate:=10.0',
                    *lossless('image_raw'))
    assert peer.until(lambda: process.poll() is not None)
    assert len(images) == len(STAMPS)
    printed = (tmp_path / 'bag_player.log').read_text()
    for name in ('/front-left/image', '/{0}', '/log'):
        assert printed.count(f'topic {name}: ') == 1


@pytest.mark.messages
def test_a_topic_with_two_types_is_played_with_the_first(peer, start, tmp_path):
    path, images = tmp_path / 'two.mcap', peer.subscribe(Image, 'image_raw')
    with BagWriter(path) as writer:
        for index, stamp in enumerate(STAMPS):
            writer.write_image(picture(index), stamp)
            writer.write('/image_raw', messages.make('std_msgs/msg/String', data='a'), stamp)
    process = start('bag_player', '-p', f'bag:={path}', '-p', 'wait_for_subscribers:=1', '-p', 'rate:=10.0',
                    *lossless('image_raw'))
    assert peer.until(lambda: process.poll() is not None)
    assert peer.until(lambda: len(images) == len(STAMPS))
    np.testing.assert_array_equal(image_from_msg(images[3]), picture(3))
    said = 'topic /image_raw: expected one type, got sensor_msgs/msg/Image and std_msgs/msg/String; the first is played'
    assert (tmp_path / 'bag_player.log').read_text().count(said) == 1


@pytest.mark.messages
def test_messages_that_cannot_be_converted_are_counted_and_not_played(peer, start, tmp_path):
    """Every second message of a ROS 1 recording in MCAP holds no image."""
    path, images = tmp_path / 'ros1.mcap', peer.subscribe(Image, 'image_raw')
    store = get_typestore(Stores.ROS1_NOETIC)
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros1')
        schema = writer.register_schema(
            'sensor_msgs/Image', 'ros1msg', store.generate_msgdef(messages.IMAGE, ros_version=1)[0].encode())
        channel = writer.register_channel('/image_raw', 'ros1', schema)
        for index, stamp in enumerate(STAMPS):
            cdr = messages.serialize(messages.image(picture(index), stamp, 'eye'))
            data = bytes(messages.typestore().cdr_to_ros1(cdr, messages.IMAGE)) if index % 2 else b'garbage'
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    start('bag_player', '-p', f'bag:={path}', '-p', 'wait_for_subscribers:=1', '-p', 'loop:=true',
          *lossless('image_raw'))

    def counts() -> tuple[int, int, int]:
        values = {pair.key: pair.value for pair in reports[-1].status[0].values} if reports else {}
        return tuple(int(values.get(name, 0)) for name in ('received', 'processed', 'errors'))

    assert peer.until(lambda: counts()[2] > 8, 60.0), counts()
    received, processed, errors = counts()
    assert received - processed - errors in (0, 1)
    assert abs(processed - errors) <= 1
    assert {stamp_ns(message.header) for message in images} == {*STAMPS[1::2]}
    assert (tmp_path / 'bag_player.log').read_text().count(
        '/image_raw: left out: a message that cannot be read as sensor_msgs/msg/Image') == 1


def test_a_bag_that_is_a_link_to_nothing_is_one_line(start, tmp_path):
    (tmp_path / 'flight').mkdir()
    (tmp_path / 'flight' / 'flight_0.mcap').symlink_to(tmp_path / 'gone.mcap')
    process = start('bag_player', '-p', f'bag:={tmp_path / "flight"}', code=2)
    assert process.wait(TIMEOUT_S) == 2
    assert (tmp_path / 'bag_player.log').read_text().strip().endswith(
        'flight_0.mcap: cannot be read: No such file or directory')


@pytest.fixture
def transforms(tmp_path):
    """30 s of /imu at 10 Hz, and a static transform from before."""
    path = tmp_path / 'transforms.mcap'
    with BagWriter(path) as writer:
        writer.write('/tf_static', messages.make('geometry_msgs/msg/TransformStamped'), 100 * NANOSECONDS)
        for tenth in range(300):
            stamp = 100 * NANOSECONDS + tenth * NANOSECONDS // 10
            writer.write('/imu', messages.make(messages.IMU, header=messages.header(stamp, 'imu')), stamp)
    return path


def seconds(ticks) -> list[float]:
    """Of the recording."""
    return [value / NANOSECONDS - 100.0 for value in clock_ns(ticks)]


@pytest.mark.messages
def test_a_jump_ahead_does_not_turn_the_clock_back(peer, start, transforms):
    ticks = peer.subscribe(Clock, '/clock')
    start('bag_player', '-p', f'bag:={transforms}', '-p', 'position_s:=5.0')
    assert peer.until(lambda: len(ticks) > 5)
    assert set_parameters(peer, 'bag_player', position_s=20.0) == ['']
    assert peer.until(lambda: seconds(ticks)[-1] > 20.5)
    assert min(np.diff(seconds(ticks))) >= 0.0
    assert 5.0 <= seconds(ticks)[0] < 15.0  # the first ones may be lost


@pytest.mark.messages
def test_a_jump_beyond_the_end_is_told(peer, start, transforms, tmp_path):
    process = start('bag_player', '-p', f'bag:={transforms}', '-p', 'position_s:=20.0')
    assert set_parameters(peer, 'bag_player', position_s=500.0) == ['']
    assert process.wait(timeout=60) == 0
    assert 'position_s: 500 is after the end of' in (tmp_path / 'bag_player.log').read_text()


@pytest.mark.messages
def test_a_player_that_is_activated_again_starts_where_it_is_told(peer, start, transforms):
    ticks = peer.subscribe(Clock, '/clock')
    start('bag_player', '-p', f'bag:={transforms}', '-p', 'position_s:=7.0')
    assert peer.until(lambda: len(ticks) > 5)
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        change(peer, 'bag_player', transition)
        if transition == Transition.TRANSITION_DEACTIVATE:
            peer.rest(LINGER_S)
            ticks.clear()
    assert peer.until(lambda: len(ticks) > 5)
    assert 7.0 <= seconds(ticks)[0] < 15.0
