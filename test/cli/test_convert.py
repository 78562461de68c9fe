"""convert: the bag holds the data set's pictures, stamps, calibration and inertial data, nothing more or less."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_contents import contents
from mcap.reader import make_reader

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.convert import convert
from motion_detect_ros.sources.bag_writer import BagWriter
from motion_detect_ros.sources.frames import FrameSource, SourceFrame
from motion_detect_ros.sources.images import image_folder
from motion_detect_ros.sources.part_file import locked_file
from motion_detect_ros.sources.truth import load_truth, read_truth

DRIVE = 'kitti/2011_09_26/2011_09_26_drive_0005_sync'
P_RECT_02 = [721.5377, 0, 609.5593, 44.85728, 0, 721.5377, 172.854, 0.2163791, 0, 0, 1, 0.002745884]


def header_stamp(message: object) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec  # type: ignore[attr-defined]


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    """Five VisDrone-like pictures of noise."""
    folder = tmp_path / 'uav0000001_00000_v'
    folder.mkdir()
    for index in range(5):
        picture = np.random.default_rng(index).integers(0, 256, (36, 64, 3), np.uint8)
        cv2.imwrite(str(folder / f'{index + 1:07d}.jpg'), picture)
    return folder


def test_visdrone_raw(sequence: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out.mcap'
    annotation = tmp_path / 'a.txt'
    annotation.write_text('1,3,5,6,7,8,1,4,0,0\n5,3,5,6,7,8,1,4,0,0\n6,3,5,6,7,8,1,4,0,0\n')
    assert main(['convert', 'visdrone', str(sequence), '-o', str(out), '--annotations', str(annotation)]) == 0
    read = contents(out)
    assert {topic: len(found) for topic, found in read.items()} == {'/image_raw': 5, '/camera_info': 5}
    for index, (stamp, message) in enumerate(read['/image_raw']):
        assert stamp == header_stamp(message) == 10**9 + index * 40_000_000  # 25 frames/s, never 0
        assert message.header.frame_id == 'camera_optical_frame'
        expected = cv2.imread(str(sequence / f'{index + 1:07d}.jpg'))
        assert np.array_equal(message.data.reshape(36, 64, 3), expected)
    info = read['/camera_info'][0][1]
    assert (info.width, info.height, list(info.k)) == (64, 36, [0] * 9)  # uncalibrated
    assert read_truth(tmp_path / 'out.truth.csv')['frame'].tolist() == [0, 4]  # picture 6 does not exist


def test_a_bag_that_another_process_writes_is_left_to_it(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / 'out.mcap'
    words = ['convert', 'images', str(sequence), '-o', str(out), '--fps', '10']
    assert main(words) == 0
    earlier = out.read_bytes()
    with BagWriter(out) as other:  # locks are of an open file: this is as good as another process
        other.write_image(np.zeros((4, 4), np.uint8), 1)
        begun = other.part_path.read_bytes()
        capsys.readouterr()
        assert main([*words, '--force']) == 2
        assert capsys.readouterr().err == f'error: {out}.part: is being written by another process\n'
        assert (out.read_bytes(), other.part_path.read_bytes()) == (earlier, begun)
    assert len(contents(out)['/image_raw']) == 1
    assert main([*words, '--force']) == 0
    assert len(contents(out)['/image_raw']) == 5


def test_a_bag_has_its_name_before_another_process_can_lock_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replace, refused = Path.replace, list[Path]()

    def replaced(part: Path, path: Path) -> Path:
        with pytest.raises(BlockingIOError):
            locked_file(part)
        refused.append(part)
        return replace(part, path)

    monkeypatch.setattr(Path, 'replace', replaced)
    with BagWriter(tmp_path / 'a.mcap') as bag:
        bag.write_image(np.zeros((4, 4), np.uint8), 1)
    assert refused == [tmp_path / 'a.mcap.part']
    assert len(contents(tmp_path / 'a.mcap')['/image_raw']) == 1


def test_compressed_keeps_the_files_byte_for_byte(sequence: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out.mcap'
    assert main(['convert', 'images', str(sequence), '-o', str(out), '--fps', '10', '--compressed']) == 0
    read = contents(out)['/image_raw/compressed']
    assert [bytes(message.data) for _, message in read] == [file.read_bytes() for file in sorted(sequence.iterdir())]
    assert {message.format for _, message in read} == {'jpeg'}


def test_video(tmp_path: Path) -> None:
    writer = cv2.VideoWriter(str(tmp_path / 'v.mp4'), cv2.VideoWriter.fourcc(*'mp4v'), 20, (64, 48))
    for _ in range(6):
        writer.write(np.full((48, 64, 3), 90, np.uint8))
    writer.release()
    assert main(['convert', 'video', str(tmp_path / 'v.mp4'), '-o', str(tmp_path / 'o.mcap')]) == 0
    assert [stamp for stamp, _ in contents(tmp_path / 'o.mcap')['/image_raw']] == [
        10**9 + i * 50_000_000 for i in range(6)]


def test_unreadable_pictures_are_left_out_and_told(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    (sequence / '0000003.jpg').write_bytes(b'\xff\xd8 no more')
    out = tmp_path / 'out.mcap'
    assert main(['convert', 'visdrone', str(sequence), '-o', str(out)]) == 3
    assert '4 frames, 1 unreadable frames left out' in capsys.readouterr().out
    # The gap stays in the stamps.
    assert [stamp // 40_000_000 for stamp, _ in contents(out)['/image_raw']] == [25, 26, 28, 29]


class Interrupted:
    """A source during which the user presses Ctrl-C after two frames."""

    def __init__(self, source: FrameSource) -> None:
        self._source = source

    def __getattr__(self, name: str) -> object:
        return getattr(self._source, name)

    def __iter__(self) -> Iterator[SourceFrame]:
        for frame in self._source:
            if frame.index == 2:
                raise KeyboardInterrupt
            yield frame


def test_an_interrupted_run_keeps_the_old_bag_and_the_new_part(sequence: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out.mcap'
    assert convert(image_folder(sequence, 25), out) == 5
    before = out.read_bytes()
    with pytest.raises(KeyboardInterrupt):
        convert(Interrupted(image_folder(sequence, 25)), out)  # type: ignore[arg-type]
    assert out.read_bytes() == before
    with (tmp_path / 'out.mcap.part').open('rb') as stream:
        assert make_reader(stream).get_summary().statistics.message_count == 4


def test_the_real_drive(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / 'kitti.mcap'
    labels = clips / 'kitti/label_02/0000.txt'
    assert main(['convert', 'kitti', str(clips / DRIVE), '-o', str(out), '--annotations', str(labels)]) == 0
    read = contents(out)
    assert {topic: len(found) for topic, found in read.items()} == {
        '/image_raw': 80, '/camera_info': 80, '/imu': 80, '/gps/fix': 80}
    stamp, picture = read['/image_raw'][0]
    assert stamp == header_stamp(picture) == 1_317_042_272_345_808_896
    expected = cv2.imread(str(clips / DRIVE / 'image_02/data/0000000000.jpg'))
    assert np.array_equal(picture.data.reshape(375, 1242, 3), expected)
    info = read['/camera_info'][79][1]
    assert (info.width, info.height, list(info.p)) == (1242, 375, P_RECT_02)
    assert list(info.k) == [721.5377, 0, 609.5593, 0, 721.5377, 172.854, 0, 0, 1]
    assert list(info.d) == [0] * 5
    imu = read['/imu'][0][1]
    assert header_stamp(imu) == 1_317_042_272_349_659_964
    assert (imu.angular_velocity.x, imu.angular_velocity.z) == (-0.017332142869546, 0.14511808479348)
    assert imu.linear_acceleration.z == 9.9957015129717
    yaw = 2 * np.arctan2(imu.orientation.z, imu.orientation.w)
    assert yaw == pytest.approx(-1.2219096732051, abs=1e-3)  # roll and pitch are under 0.03 rad
    assert read['/gps/fix'][0][1].latitude == 49.011212804408
    everything = [stamp for found in read.values() for stamp, _ in found]
    with out.open('rb') as stream:
        recorded = [message.log_time for _, _, message in make_reader(stream).iter_messages(log_time_order=False)]
    assert recorded == sorted(everything)
    assert read_truth(tmp_path / 'kitti.truth.csv').tolist() == read_truth(labels).tolist()


@pytest.mark.parametrize(('size', 'fx', 'cx', 'ty'), [
    ((80, 60), 100.0, 40.0, -300.0), ((40, 30), 50.0, 19.75, -150.0), ((60, 60), 0.0, 0.0, 0.0)])
def test_camera_info_is_of_the_pictures_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: tuple[int, int], fx: float, cx: float, ty: float,
) -> None:
    """A camera of 80x60 with its centre at 40: at half the size (40 + 0.5) / 2 - 0.5; unknown of cropped pictures."""
    data = tmp_path / 'day' / 'drive' / 'image_02' / 'data'
    data.mkdir(parents=True)
    cv2.imwrite(str(data / '0000000000.png'), np.full((size[1], size[0]), 9, np.uint8))
    (data.parent / 'timestamps.txt').write_text('2011-09-26 13:02:44.5\n')
    (tmp_path / 'day' / 'calib_cam_to_cam.txt').write_text(
        'S_rect_02: 80 60\nP_rect_02: 100 0 40 -300 0 100 30 0 0 0 1 0\n')
    assert main(['convert', 'kitti', str(data.parents[1]), '-o', str(tmp_path / 'out.mcap')]) == 0
    (_, info), = contents(tmp_path / 'out.mcap')['/camera_info']
    assert (info.width, info.height) == size
    assert (info.k[0], info.k[2], info.p[0], info.p[2], info.p[3]) == (fx, cx, fx, cx, ty)
    assert ('bearings are NaN' in capsys.readouterr().out) == (not fx)


def test_real_drive_compressed(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / 'kitti.mcap'
    assert main(['convert', 'kitti', str(clips / DRIVE), '-o', str(out), '--compressed']) == 0
    files = sorted((clips / DRIVE / 'image_02/data').iterdir())
    read = contents(out)['/image_raw/compressed']
    assert [bytes(message.data) for _, message in read] == [file.read_bytes() for file in files]


def test_truth_counts_as_the_bag_does_where_pictures_are_unreadable(sequence: Path, tmp_path: Path) -> None:
    """A box at x = 10 in picture 1, 20 in picture 2, ...; the third is unreadable: the bag's frame 2 is picture 4."""
    (sequence / '0000003.jpg').write_bytes(b'\xff\xd8 no more')
    annotations = tmp_path / 'a.txt'
    annotations.write_text(''.join(f'{number},1,{10 * number},5,8,8,1,4,0,0\n' for number in range(1, 6)))
    out = tmp_path / 'out.mcap'
    assert main(['convert', 'visdrone', str(sequence), '-o', str(out), '--annotations', str(annotations)]) == 3
    truth = read_truth(tmp_path / 'out.truth.csv')
    assert list(zip(truth['frame'].tolist(), truth['x'].tolist(), strict=True)) == [(0, 10), (1, 20), (2, 40), (3, 50)]


@pytest.mark.parametrize(('labels', 'says', 'marks'), [
    ('1,1,10,5,8,8,1,4,0,0\n1,2,30,5,8,8,0,0,0,0\n', False, [1, -1]),
    ('frame,id,x,y,w,h\n0,1,10,5,8,8\n', False, [1]),
    ('frame,id,x,y,w,h,moving\n0,1,10,5,8,8,1\n', True, [1]),
    ('frame,id,x,y,w,h,moving\n0,1,10,5,8,8,0\n0,2,30,5,8,8,-1\n', True, [0, -1])])
def test_truth_says_no_more_than_the_labels_do(
    labels: str, says: bool, marks: list[int], sequence: Path, tmp_path: Path,
) -> None:
    """Labels of what is there, standing cars too, do not become labels of what moves."""
    annotations = tmp_path / 'a.txt'
    annotations.write_text(labels)
    words = ['convert', 'visdrone', str(sequence), '-o', str(tmp_path / 'out.mcap')]
    assert main([*words, '--annotations', str(annotations)]) == 0
    truth = load_truth(tmp_path / 'out.truth.csv')
    assert (truth.says_what_moves, truth.boxes['moving'].tolist()) == (says, marks)


def test_a_truth_that_is_there_is_not_overwritten(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    annotations, mine = tmp_path / 'a.txt', tmp_path / 'out.truth.csv'
    annotations.write_text('1,1,10,5,8,8,1,4,0,0\n')
    mine.write_text('made by hand')
    words = ['convert', 'visdrone', str(sequence), '-o', str(tmp_path / 'out.mcap'), '--annotations', str(annotations)]
    assert main(words) == 2
    assert f'{mine}: exists; --force overwrites it' in capsys.readouterr().err
    assert mine.read_text() == 'made by hand'
    assert not (tmp_path / 'out.mcap').exists()
    assert main([*words, '--force']) == 0
    assert len(read_truth(mine)) == 1


def test_labels_of_an_excerpt_of_a_drive_go_by_the_names_of_its_pictures(tmp_path: Path) -> None:
    """Pictures 40 to 42; the left edge of the box in picture N is N."""
    data = tmp_path / 'drive' / 'image_02' / 'data'
    data.mkdir(parents=True)
    for number in (40, 41, 42):
        cv2.imwrite(str(data / f'{number:010d}.png'), np.full((36, 64), number, np.uint8))
    (data.parent / 'timestamps.txt').write_text(''.join(
        f'2011-09-26 13:02:{number // 10:02d}.{number % 10}00000000\n' for number in range(50)))
    labels = tmp_path / 'labels.txt'
    labels.write_text(''.join(f'{number} 1 Car 0 0 -1.9 {number} 20 60 30 1.7 0.8 1.8 1.6 1.7 5.8 -1.7\n'
                              for number in (0, 1, 2, 40, 42)))
    assert main(['convert', 'kitti', str(tmp_path / 'drive'), '-o', str(tmp_path / 'out.mcap'),
                 '--annotations', str(labels)]) == 0
    truth = read_truth(tmp_path / 'out.truth.csv')
    assert list(zip(truth['frame'].tolist(), truth['x'].tolist(), strict=True)) == [(0, 40), (2, 42)]


def test_the_truth_of_an_earlier_bag_does_not_stay_beside_the_next_one(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    annotations, out, truth = tmp_path / 'a.txt', tmp_path / 'out.mcap', tmp_path / 'out.truth.csv'
    annotations.write_text('1,1,10,5,8,8,1,4,0,0\n')
    words = ['convert', 'visdrone', str(sequence), '-o', str(out)]
    truth.write_text('made before there was a bag')
    assert main(words) == 0, 'of no earlier bag'
    assert main([*words, '--annotations', str(annotations), '--force']) == 0
    bag, boxes = out.read_bytes(), truth.read_bytes()
    capsys.readouterr()
    for again, hint in ((words, ', or give --annotations'), (['convert', 'images', *words[2:], '--fps', '10'], '')):
        assert main([*again, '--force']) == 2
        assert capsys.readouterr().err == (
            f'error: {truth}: expected no truth, as that of the earlier {out} would stay; move it away{hint}\n')
    assert (out.read_bytes(), truth.read_bytes()) == (bag, boxes)


@pytest.mark.parametrize('link', [None, Path.hardlink_to, Path.symlink_to], ids=['itself', 'hard link', 'link'])
def test_an_input_is_not_overwritten(
    link: Callable[[Path, Path], None] | None, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    video = tmp_path / 'flight.avi'
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*'MJPG'), 10.0, (64, 48))
    for index in range(3):
        writer.write(np.full((48, 64, 3), 50 * index, np.uint8))
    writer.release()
    before, output = video.read_bytes(), video
    if link:
        output = tmp_path / 'other.mcap'
        link(output, video)
    assert main(['convert', 'video', str(video), '-o', str(output), '--force']) == 2
    assert capsys.readouterr().err == (
        f'error: {output}: expected an output that replaces no input; choose another --output\n')
    assert video.read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {video.name, output.name}


def test_a_picture_of_the_input_and_the_truth_given_are_not_overwritten(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    picture, annotations = sequence / '0000003.jpg', tmp_path / 'out.truth.csv'
    annotations.write_text('frame,id,x,y,w,h,moving\n0,1,10,5,8,8,1\n')
    before = {path: path.read_bytes() for path in (*sequence.iterdir(), annotations)}
    for output, replaced, further in (
            (picture, picture, []), (tmp_path / 'out.mcap', annotations, ['--annotations', str(annotations)]),
            (annotations, annotations, ['--annotations', str(annotations)])):
        assert main(['convert', 'visdrone', str(sequence), '-o', str(output), *further, '--force']) == 2
        assert capsys.readouterr().err == (
            f'error: {replaced}: expected an output that replaces no input; choose another --output\n')
    assert {path: path.read_bytes() for path in (*sequence.iterdir(), annotations)} == before
    bag = sequence / 'a.mcap'
    for force in ([], ['--force']):
        assert main(['convert', 'visdrone', str(sequence), '-o', str(bag), *force]) == 0, 'beside the pictures'


def test_a_folder_is_no_output(sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / 'out').mkdir()
    assert main(['convert', 'visdrone', str(sequence), '-o', str(tmp_path / 'out'), '--force']) == 2
    assert capsys.readouterr().err == f'error: {tmp_path}/out: expected an MCAP file to write, got a folder\n'
    assert not (tmp_path / 'out.part').exists()
