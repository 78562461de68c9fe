"""Bags whose camera_info changes: each picture has its own calibration, as in the live nodes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from bag_contents import contents

from motion_detect_ros.__main__ import main
from motion_detect_ros.core.types import DETECTION_DTYPE, CameraModel
from motion_detect_ros.sources.bags import BagFrames, BagWriter
from motion_detect_ros.sources.window import WHOLE, Window

BEGIN, PERIOD = 10**9, 40_000_000
WIDTH, HEIGHT = 320, 240


def lens(focal_px: float, width: int = WIDTH, height: int = HEIGHT) -> CameraModel:
    return CameraModel(width, height, focal_px, focal_px, 160.0, 120.0)


def written(path: Path, order: Sequence[tuple[str, int, float]]) -> Path:
    """A bag of messages in that order: ('image', number, 0) or ('info', number whose stamp it has, focal length)."""
    with BagWriter(path, compress=False) as writer:
        for kind, number, focal_px in order:
            stamp = BEGIN + number * PERIOD
            if kind == 'image':
                writer.write_image(np.full((HEIGHT, WIDTH), number, np.uint8), stamp)
            else:
                writer.write_camera_info(lens(focal_px), stamp)
    return path


def focal_lengths(path: Path, window: Window = WHOLE) -> list[float | None]:
    return [frame.camera and frame.camera.fx for frame in BagFrames(path, window=window)]


def zoom(first: str, second: str, count: int = 6) -> list[tuple[str, int, float]]:
    return [(kind, number, 500.0 + number) for number in range(count) for kind in (first, second)]


@pytest.mark.parametrize('kinds', [('info', 'image'), ('image', 'info')])
def test_each_picture_has_the_one_of_its_stamp_whichever_was_recorded_first(
    kinds: tuple[str, str], tmp_path: Path,
) -> None:
    path = written(tmp_path / 'zoom.mcap', zoom(*kinds))
    assert focal_lengths(path) == [500.0, 501.0, 502.0, 503.0, 504.0, 505.0]
    assert focal_lengths(path, Window(start_s=0.12)) == [503.0, 504.0, 505.0]
    assert focal_lengths(path, Window(every=2)) == [500.0, 502.0, 504.0]


def test_without_one_of_its_stamp_the_latest_before_it_or_the_first(tmp_path: Path) -> None:
    order = [('image', 0, 0.0), ('image', 1, 0.0), ('info', 2, 502.0), ('image', 3, 0.0), ('info', 4, 504.0),
             ('image', 5, 0.0), ('image', 6, 0.0)]
    path = written(tmp_path / 'rare.mcap', order)
    assert focal_lengths(path) == [502.0, 502.0, 502.0, 504.0, 504.0]
    assert focal_lengths(path, Window(start_s=0.1)) == [502.0, 504.0, 504.0]


def test_one_that_says_uncalibrated_holds_too(tmp_path: Path) -> None:
    path = written(tmp_path / 'gone.mcap', [
        (kind, number, 500.0 if number < 2 else 0.0) for number in range(4) for kind in ('info', 'image')])
    assert focal_lengths(path) == [500.0, 500.0, None, None]


def test_a_bag_without_any_has_uncalibrated_pictures(tmp_path: Path) -> None:
    assert focal_lengths(written(tmp_path / 'none.mcap', [('image', 0, 0.0), ('image', 1, 0.0)])) == [None, None]


@pytest.mark.parametrize(('images', 'infos', 'focal_px'), [
    (['/front/image_raw'], ['/camera_info'], 500.0),
    (['/front/image_raw', '/front/depth'], ['/front/info'], 500.0),
    (['/front/image_raw'], ['/front/depth_info', '/front/camera_info'], 501.0),
    (['/front/image_raw', '/overlay/image'], ['/lens/camera_info'], 500.0),
    (['/front/image_raw', '/rear/image_raw'], ['/front/camera_info', '/rear/camera_info'], 500.0),
    (['/front/image_raw', '/front/image_raw/compressed'], ['/front/camera_info'], 500.0),
    (['/front/image_raw', '/rear/image_raw'], ['/rear/camera_info'], None),
    (['/front/image_raw', '/rear/image_raw/compressed'], ['/rear/camera_info'], None),
    (['/front/image_raw'], ['/rear/camera_info', '/camera_info'], None)])
def test_that_of_another_camera_is_not_taken(
    tmp_path: Path, images: list[str], infos: list[str], focal_px: float | None,
) -> None:
    with BagWriter(tmp_path / 'cameras.mcap', compress=False) as writer:
        for topic in images:
            if topic.endswith('compressed'):
                writer.write_compressed(b'none', 'png', BEGIN, topic)
            else:
                writer.write_image(np.zeros((HEIGHT, WIDTH), np.uint8), BEGIN, topic)
        for number, topic in enumerate(infos):
            writer.write_camera_info(lens(500.0 + number), BEGIN, topic)
    source = BagFrames(tmp_path / 'cameras.mcap', 'front/image_raw')
    assert [frame.camera and frame.camera.fx for frame in source] == [focal_px]
    said = ('/rear/camera_info left out, as it is beside another image topic: bearings are NaN',)
    assert source.complaints == (said if infos == ['/rear/camera_info'] else ())


def test_one_of_another_size_is_refused_as_by_the_nodes(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'size.mcap', compress=False) as writer:
        for number in range(4):
            stamp = BEGIN + number * PERIOD
            writer.write_camera_info(lens(500.0) if number < 2 else lens(1000.0, 2 * WIDTH, 2 * HEIGHT), stamp)
            writer.write_image(np.zeros((HEIGHT, WIDTH), np.uint8), stamp)
    source = BagFrames(tmp_path / 'size.mcap')
    assert [frame.camera and frame.camera.fx for frame in source] == [500.0, 500.0, None, None]
    assert source.complaints == (
        'camera_info refused (camera_info is of 640x480 px, the images of 320x240): bearings are NaN',)


def test_replay_says_that_one_of_another_size_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with BagWriter(tmp_path / 'size.mcap', compress=False) as writer:
        for number in range(3):
            writer.write_camera_info(lens(1000.0, 640, 480), BEGIN + number * PERIOD)
            writer.write_image(moving(number), BEGIN + number * PERIOD)
    assert main(['replay', str(tmp_path / 'size.mcap'), '-o', str(tmp_path / 'out'), '--no-report']) == 0
    said = 'camera_info refused (camera_info is of 640x480 px, the images of 320x240): bearings are NaN'
    assert capsys.readouterr().out.count(said) == 1
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert (summary['calibrated'], summary['warnings']) == (False, [said])


def moving(number: int) -> np.ndarray:
    """A textured block at 6 px a frame before a still textured ground."""
    random = np.random.default_rng(1)
    picture = random.integers(60, 120, (HEIGHT // 4, WIDTH // 4), np.uint8).repeat(4, 0).repeat(4, 1)
    left = 30 + 6 * number
    picture[90:140, left:left + 60] = random.integers(0, 255, (10, 12), np.uint8).repeat(5, 0).repeat(5, 1)
    return picture


def test_replay_measures_each_picture_with_its_own(tmp_path: Path) -> None:
    """Bearings are unknown up to the ninth picture, then of 400 px, then of a lens that zooms to 800 px."""
    focal_px = [0.0] * 9 + [400.0] * 5 + [800.0] * 5
    with BagWriter(tmp_path / 'zoom.mcap', compress=False) as writer:
        for number, focal in enumerate(focal_px):
            writer.write_image(moving(number), BEGIN + number * PERIOD)
            writer.write_camera_info(lens(focal), BEGIN + number * PERIOD)
    assert main(['replay', str(tmp_path / 'zoom.mcap'), '-o', str(tmp_path / 'out'), '--no-report']) == 0
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert (summary['calibrated'], summary['warnings']) == (True, [])
    seen = set()
    for number, (_, cloud) in enumerate(contents(tmp_path / 'out' / 'detections.mcap')['/detections']):
        for record in np.frombuffer(cloud.data.tobytes(), DETECTION_DTYPE):
            seen.add(focal_px[number])
            if not focal_px[number]:
                assert np.isnan(record['bearing_x'])
                continue
            assert record['bearing_x'] / record['bearing_z'] == pytest.approx(
                (record['u'] - 0.5 - 160.0) / focal_px[number], abs=1e-5)
    assert seen == {0.0, 400.0, 800.0}
