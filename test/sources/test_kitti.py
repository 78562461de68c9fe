"""KITTI raw drives: layout as published, numbers read off the files by eye."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.sources.inertial import GyroSample
from motion_detect_ros.sources.kitti import KittiDrive, OxtsSample, parse_stamp, read_oxts
from motion_detect_ros.sources.opening import check_rate_is_used, open_source

P_RECT_02 = ('7.215377e+02 0.000000e+00 6.095593e+02 4.485728e+01 0.000000e+00 7.215377e+02 1.728540e+02 '
             '2.163791e-01 0.000000e+00 0.000000e+00 1.000000e+00 2.745884e-03')
# Columns of dataformat.txt: lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz wf wl wu pos vel ...
OXTS = ('49.01 8.42 112.8 0.022 0.001 -1.22 -3.3 1.1 3.5 0.03 -0.03 11 12 13 14 15 16 17 18 19 20 21 22 '
        '0.49 0.06 4 10 4 4 0')


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """A drive of three pictures of 40x30 with two inertial packets."""
    path = tmp_path / '2011_09_26' / '2011_09_26_drive_0001_sync'
    for folder in ('image_02/data', 'oxts/data'):
        (path / folder).mkdir(parents=True)
    stamps = [f'2011-09-26 13:02:44.{fraction}' for fraction in ('323092481', '426', '53')]
    for index in range(3):
        cv2.imwrite(str(path / f'image_02/data/{index:010d}.png'), np.full((30, 40, 3), 10 * index, np.uint8))
    (path / 'image_02/timestamps.txt').write_text('\n'.join(stamps) + '\n')
    for index in range(2):
        (path / f'oxts/data/{index:010d}.txt').write_text(OXTS + '\n')
    (path / 'oxts/timestamps.txt').write_text('\n'.join(stamps[:2]) + '\n')
    (path.parent / 'calib_cam_to_cam.txt').write_text(
        f'calib_time: 09-Jan-2012 13:57:47\nS_rect_02: 1.242000e+03 3.750000e+02\nP_rect_02: {P_RECT_02}\n')
    return path


def test_stamps_are_exact_utc() -> None:
    # date -u -d '2011-09-26 13:04:32' +%s
    assert parse_stamp('2011-09-26 13:04:32.345808896') == 1_317_042_272_345_808_896
    assert parse_stamp('2011-09-26 13:04:32.5') == 1_317_042_272_500_000_000
    assert parse_stamp('2011-09-26 13:04:32') == 1_317_042_272_000_000_000
    assert parse_stamp('1970-01-02 00:00:00.000000001') == 86_400_000_000_001


def test_stamps_do_not_depend_on_the_time_zone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('TZ', 'Pacific/Auckland')
    expected = int(datetime(2012, 7, 1, 3, 4, 5, tzinfo=UTC).timestamp()) * 10**9
    assert parse_stamp('2012-07-01 03:04:05.000000000') == expected


@pytest.mark.parametrize('text', ['', 'yesterday', '2011-09-26T13:04:32', '2011-13-26 13:04:32', '1317042272.3'])
def test_another_form_of_stamp_is_refused(text: str) -> None:
    with pytest.raises(SourceError, match='time stamp'):
        parse_stamp(text)


def test_frames_have_the_stamps_of_their_numbers(drive: Path) -> None:
    (drive / 'image_02/data/0000000001.png').unlink()
    frames = list(KittiDrive(drive))
    assert [int(frame.image[0, 0, 0]) for frame in frames] == [0, 20]
    assert [frame.stamp_ns % 10**9 for frame in frames] == [323_092_481, 530_000_000]


def test_calibration_is_that_of_the_rectified_colour_camera(drive: Path) -> None:
    source = KittiDrive(drive)
    assert source.camera == CameraModel(1242, 375, 721.5377, 721.5377, 609.5593, 172.8540)
    assert source.calibration is not None
    assert source.calibration.projection[0, 3] == 44.85728


def test_hidden_files_are_no_packets(drive: Path) -> None:
    (drive / 'oxts/data/._0000000000.txt').write_bytes(b'\0\5\x16\7')
    assert len(KittiDrive(drive).oxts()) == 2


def test_oxts_columns_and_stamps(drive: Path) -> None:
    first, second = KittiDrive(drive).oxts()
    assert first.acceleration == (11, 12, 13)
    assert first.angular_velocity == (17, 18, 19)
    assert (first.roll, first.pitch, first.yaw) == (0.022, 0.001, -1.22)
    assert (first.latitude_deg, first.longitude_deg, first.altitude_m) == (49.01, 8.42, 112.8)
    assert first.position_accuracy_m == 0.49
    assert second.stamp_ns - first.stamp_ns == 426_000_000 - 323_092_481


@pytest.mark.parametrize('angles', [(0.0, 0.0, 0.0), (0.3, -0.2, 2.9), (-1.0, 1.2, -2.0)])
def test_orientation_agrees_with_scipy(angles: tuple[float, float, float]) -> None:
    roll, pitch, yaw = angles
    sample = OxtsSample(0, 0, 0, 0, roll, pitch, yaw, (0, 0, 0), (0, 0, 0), 0)
    expected = Rotation.from_euler('ZYX', [yaw, pitch, roll])
    assert (Rotation.from_quat(sample.quaternion) * expected.inv()).magnitude() < 1e-12


def test_angular_rates_are_those_about_the_body_axes(drive: Path) -> None:
    first, second = KittiDrive(drive).gyro()
    assert first == GyroSample(parse_stamp('2011-09-26 13:02:44.323092481'), (17.0, 18.0, 19.0))
    assert second.stamp_ns == parse_stamp('2011-09-26 13:02:44.426')


def test_a_short_oxts_packet_is_refused(drive: Path) -> None:
    (drive / 'oxts/data/0000000000.txt').write_text('1 2 3')
    with pytest.raises(SourceError, match='expected 30 numbers, got 3'):
        read_oxts(drive / 'oxts/data/0000000000.txt', 0)


def test_more_pictures_than_stamps_is_refused(drive: Path) -> None:
    cv2.imwrite(str(drive / 'image_02/data/0000000003.png'), np.zeros((3, 3), np.uint8))
    with pytest.raises(SourceError, match='timestamps.txt has 3 lines, none for this file'):
        KittiDrive(drive)


def test_a_drive_without_calibration_has_no_camera(drive: Path) -> None:
    (drive.parent / 'calib_cam_to_cam.txt').unlink()
    assert KittiDrive(drive).camera is None


@pytest.mark.parametrize(('old', 'new', 'words'), [
    ('1.242000e+03', 'inf', 'expected S_rect_02 (2 numbers) and P_rect_02 (12 numbers)'),
    ('1.242000e+03', '-5', 'S_rect_02: expected a size in pixels, got -5x375'),
    ('7.215377e+02', 'nan', 'P_rect_02: expected focal lengths of 1 px or more, got nan and nan'),
    ('7.215377e+02', '0', 'P_rect_02: expected focal lengths of 1 px or more, got 0 and 0')])
def test_numbers_that_are_no_calibration_are_refused_in_one_line(drive: Path, old: str, new: str, words: str) -> None:
    path = drive.parent / 'calib_cam_to_cam.txt'
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(SourceError) as caught:
        KittiDrive(drive)
    assert str(caught.value).startswith(f'{path}: {words}')
    assert '\n' not in str(caught.value)


def test_letters_of_other_alphabets_beside_the_calibration_do_not_matter(drive: Path) -> None:
    path = drive.parent / 'calib_cam_to_cam.txt'
    path.write_bytes('# Köln\n'.encode('latin-1') + path.read_bytes())
    assert KittiDrive(drive).camera == CameraModel(1242, 375, 721.5377, 721.5377, 609.5593, 172.8540)


def test_wrong_layout_names_what_is_there_and_what_should_be(tmp_path: Path) -> None:
    (tmp_path / 'image_00').mkdir()
    with pytest.raises(SourceError) as caught:
        KittiDrive(tmp_path)
    assert 'found image_00/; expected a KITTI raw drive: image_02/data/*.png or *.jpg' in str(caught.value)


@pytest.mark.parametrize('inside', ['', 'image_02/data'])
def test_open_source_knows_a_drive_and_its_picture_folder(drive: Path, inside: str) -> None:
    source = open_source(drive / inside)
    assert isinstance(source, KittiDrive)
    assert source.frame_count == 3


def other_camera(drive: Path, folder: str, focal_px: str = '600.0') -> None:
    """The drive seen by another of its cameras, a second later, of another brightness and calibration."""
    (drive / folder / 'data').mkdir(parents=True)
    for index in range(3):
        cv2.imwrite(str(drive / folder / f'data/{index:010d}.png'), np.full((30, 40), 200 + index, np.uint8))
    stamps = (drive / 'image_02/timestamps.txt').read_text().replace('13:02:44', '13:02:45')
    (drive / folder / 'timestamps.txt').write_text(stamps)
    calibration, number = drive.parent / 'calib_cam_to_cam.txt', folder[-2:]
    calibration.write_text(calibration.read_text() + f'S_rect_{number}: 40 30\nP_rect_{number}: '
                           f'{focal_px} 0 20 -300 0 {focal_px} 15 0 0 0 1 0\n')


@pytest.mark.parametrize('folder', ['image_00', 'image_01', 'image_03'])
def test_the_pictures_of_another_camera_are_its_own(drive: Path, folder: str) -> None:
    other_camera(drive, folder)
    source = open_source(drive / folder / 'data')
    frames = list(source)
    assert [frame.stamp_ns for frame in frames] == [stamp + 10**9 for stamp in KittiDrive(drive).images.stamps_ns]
    assert [int(frame.image.flat[0]) for frame in frames] == [200, 201, 202]
    assert frames[0].camera == source.camera == CameraModel(40, 30, 600.0, 600.0, 20.0, 15.0)
    assert source.complaints == ()


def test_a_drive_without_the_left_camera(drive: Path) -> None:
    other_camera(drive, 'image_03')
    shutil.rmtree(drive / 'image_02')
    assert len(list(open_source(drive / 'image_03/data'))) == 3


@pytest.mark.parametrize('folder', ['image_02', 'image_03'])
def test_a_rate_means_nothing_to_a_folder_with_stamps(drive: Path, folder: str) -> None:
    other_camera(drive, 'image_03')
    with pytest.raises(SourceError, match='--fps: expected an input without stamps'):
        check_rate_is_used('--fps', 30.0, [str(drive / folder / 'data')])


def resized(drive: Path, width: int, height: int) -> KittiDrive:
    for file in (drive / 'image_02/data').iterdir():
        cv2.imwrite(str(file), np.zeros((height, width), np.uint8))
    return KittiDrive(drive)


@pytest.mark.parametrize(('width', 'height'), [(1242, 375), (621, 188), (414, 125), (2484, 750)])
def test_pictures_of_another_size_have_the_calibration(drive: Path, width: int, height: int) -> None:
    source = resized(drive, width, height)
    assert [frame.camera for frame in source] == [CameraModel(1242, 375, 721.5377, 721.5377, 609.5593, 172.8540)] * 3
    assert source.complaints == ()


@pytest.mark.parametrize(('width', 'height'), [(842, 375), (1242, 360), (30, 40)])
def test_cropped_pictures_have_none_and_that_is_said(drive: Path, width: int, height: int) -> None:
    """What was cut off nobody knows, so neither where the axis is: bearings would be wrong."""
    source = resized(drive, width, height)
    assert [frame.camera for frame in source] == [None] * 3
    assert source.complaints == (f'calib_cam_to_cam.txt refused (it is for 1242x375, the pictures have '
                                 f'{width}x{height}): bearings are NaN',)


def test_the_real_drive(clips: Path) -> None:
    source = KittiDrive(clips / 'kitti/2011_09_26/2011_09_26_drive_0005_sync')
    frame = next(iter(source))
    assert frame.stamp_ns == 1_317_042_272_345_808_896
    assert frame.image.shape == (375, 1242, 3)
    assert source.camera == CameraModel(1242, 375, 721.5377, 721.5377, 609.5593, 172.8540)
    # Line 1 of oxts/data/0000000000.txt and of oxts/timestamps.txt.
    sample = source.oxts()[0]
    assert sample.stamp_ns == 1_317_042_272_349_659_964
    assert sample.acceleration == (-0.29437452763793, 0.037166856911681, 9.9957015129717)
    assert sample.angular_velocity == (-0.017332142869546, 0.024792163815438, 0.14511808479348)
