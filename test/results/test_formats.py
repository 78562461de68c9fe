"""A replay in every format: all hold the detections of detections.csv, read by pandas and by libraries of others."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from motion_detect_ros.__main__ import main
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.results.formats import DEFAULT_FORMATS, FORMATS, output_names, parse_formats
from motion_detect_ros.results.summary import read_summary
from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.images import decode_image

FRAMES = 16
#: All that can be written here: parquet needs its package.
WRITABLE = [name for name, each in FORMATS.items() if not each.package or importlib.util.find_spec(each.package)]
#: detections.csv has 5 decimals, as mot.txt and coco.json.
CSV_STEP = 1.01e-5


def texture(seed: int, height: int, width: int) -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).integers(0, 256, (height, width), np.uint8), (0, 0), 1.5)
    return cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX)


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A camera that drifts 3 px a frame over a plane, and a block that crosses it."""
    path = tmp_path_factory.mktemp('bag') / 'scene.mcap'
    ground, block = texture(1, 240, 400), texture(2, 50, 60)
    with BagWriter(path, compress=False) as writer:
        for index in range(FRAMES):
            picture = ground[:, 3 * index:320 + 3 * index].copy()
            picture[90:140, 30 + 6 * index:90 + 6 * index] = block
            writer.write_image(picture, 10**9 + index * 40_000_000)
    return path


@pytest.fixture(scope='module')
def replayed(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp('out')
    words = ['replay', str(bag), '-o', str(out), '--formats', ','.join(WRITABLE), '--overlay', '--no-report']
    assert main(words) == 0
    return out


@pytest.fixture(scope='module')
def table(replayed: Path):
    """detections.csv as pandas reads it; a scene without detections would say nothing."""
    pandas = pytest.importorskip('pandas', reason='pip install pandas')
    read = pandas.read_csv(replayed / 'detections.csv')
    assert len(read) >= 5
    return read


def test_exactly_the_wanted_files_are_there(replayed: Path) -> None:
    assert sorted(path.name for path in replayed.iterdir()) == sorted(output_names(WRITABLE))
    summary = read_summary(replayed)
    assert (summary.formats, summary.overlay) == (WRITABLE, True)


def test_the_bag_holds_them(replayed: Path, table) -> None:
    boxes, pictures = [], []
    with AnyReader([replayed / 'detections.mcap']) as reader:
        for connection, stamp_ns, data in reader.messages():
            if connection.topic == '/detections_2d':
                message = reader.deserialize(data, connection.msgtype)
                boxes += [(stamp_ns, int(box.id), box.bbox.center.position.x - box.bbox.size_x / 2,
                           box.bbox.center.position.y - box.bbox.size_y / 2, box.bbox.size_x, box.bbox.size_y,
                           box.results[0].hypothesis.score) for box in message.detections]
            elif connection.topic == '/overlay/overlay/compressed':
                pictures.append(decode_image(reader.deserialize(data, connection.msgtype).data.tobytes(), 'picture'))
    columns = ['stamp_ns', 'id', 'x', 'y', 'w', 'h', 'score']
    assert np.array(boxes) == pytest.approx(table[columns].to_numpy(), abs=CSV_STEP)
    assert [picture.shape for picture in pictures] == [(240, 320, 3)] * FRAMES


def test_parquet_holds_them(replayed: Path, table) -> None:
    pytest.importorskip('pyarrow', reason='pip install motion_detect_ros[parquet]')
    import pandas
    read = pandas.read_parquet(replayed / 'detections.parquet')
    assert set(read['input']) == {str(read_summary(replayed).input)}
    columns = list(table.columns)
    assert read[columns].to_numpy(float) == pytest.approx(table[columns].to_numpy(float), abs=CSV_STEP, nan_ok=True)


def test_mot_holds_them(replayed: Path, table) -> None:
    read = np.loadtxt(replayed / 'mot.txt', delimiter=',', ndmin=2)
    assert read[:, 0] - 1 == pytest.approx(table['frame'].to_numpy())
    assert read[:, 2:4] - 1 == pytest.approx(table[['x', 'y']].to_numpy(), abs=CSV_STEP)
    assert read[:, [1, 4, 5, 6]] == pytest.approx(table[['id', 'w', 'h', 'score']].to_numpy(), abs=CSV_STEP)


def test_coco_holds_them(replayed: Path, table) -> None:
    coco = pytest.importorskip('pycocotools.coco', reason='pip install pycocotools')
    read = coco.COCO(str(replayed / 'coco.json'))
    assert read.getImgIds() == list(range(FRAMES))
    assert {(image['width'], image['height']) for image in read.loadImgs(read.getImgIds())} == {(320, 240)}
    rows = [[box['image_id'], box['track_id'], *box['bbox'], box['score']] for box in read.loadAnns(read.getAnnIds())]
    columns = ['frame', 'id', 'x', 'y', 'w', 'h', 'score']
    assert np.array(rows) == pytest.approx(table[columns].to_numpy(), abs=CSV_STEP)


def test_the_files_are_the_same_bytes_again_and_those_of_other_formats_go(
    bag: Path, replayed: Path, tmp_path: Path,
) -> None:
    """With --force; what the folder holds besides results of a replay stays."""
    words = ['replay', str(bag), '-o', str(tmp_path), '--no-report', '--formats']
    assert main([*words, ','.join(WRITABLE), '--overlay']) == 0
    for name in (each for each in output_names(WRITABLE) if each not in {'times.csv', 'summary.json'}):
        assert (tmp_path / name).read_bytes() == (replayed / name).read_bytes(), name
    (tmp_path / 'notes.txt').write_text('mine')
    assert main([*words, 'mot', '--force']) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        'detections.csv', 'frames.csv', 'mot.txt', 'notes.txt', 'summary.json', 'times.csv']
    assert (tmp_path / 'mot.txt').read_bytes() == (replayed / 'mot.txt').read_bytes()


def test_a_finished_input_is_done_anew_for_a_format_or_pictures_that_it_does_not_have(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    words = ['replay', str(bag), '-o', str(tmp_path)]
    for more, anew in (([], False), (['--formats', 'mcap,mot'], True), (['--formats', 'mot'], False),
                       (['--formats', 'mcap,mot', '--overlay'], True), (['--formats', 'mcap,mot'], False)):
        assert main([*words, *more]) == 0
        assert ('incomplete, done anew' in capsys.readouterr().out) == anew, more
    assert (tmp_path / 'mot.txt').is_file()
    assert read_summary(tmp_path).overlay


@pytest.mark.parametrize(('before', 'now', 'lost'), [
    ('mcap', 'mot', 'detections.mcap'), ('mcap,coco', 'mcap,mot', 'coco.json'),
    ('mcap,coco', 'mot', 'coco.json, detections.mcap'),
])
def test_finished_files_are_not_lost_to_another_format(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], before: str, now: str, lost: str,
) -> None:
    words = ['replay', str(bag), '-o', str(tmp_path), '--no-report', '--formats']
    assert main([*words, before]) == 0
    files = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert main([*words, now]) == 2
    assert f'{tmp_path}: holds {lost}, which --formats does not name; --force removes it' in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == files


def test_finished_pictures_are_not_lost_to_another_format(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    words = ['replay', str(bag), '-o', str(tmp_path), '--no-report', '--formats']
    assert main([*words, 'mcap', '--overlay']) == 0
    assert main([*words, 'mcap,mot']) == 2
    assert f'{tmp_path}: holds the pictures of --overlay, which is not given; --force removes them' in (
        capsys.readouterr().err)


@pytest.mark.parametrize(('text', 'formats'), [
    ('csv,mcap', DEFAULT_FORMATS), ('mcap', ('csv', 'mcap')), ('coco, mot', ('csv', 'mot', 'coco')), ('csv', ('csv',)),
])
def test_formats_are_parsed(text: str, formats: tuple[str, ...]) -> None:
    assert parse_formats(text) == formats


@pytest.mark.parametrize(('text', 'got'), [('xml,mcap,yaml', 'xml,yaml'), ('', 'nothing'), ('csv,', 'nothing')])
def test_unknown_formats_are_refused(text: str, got: str) -> None:
    with pytest.raises(SourceError) as caught:
        parse_formats(text)
    assert str(caught.value) == f'--formats: expected some of csv,mcap,parquet,mot,coco, got {got}'


@pytest.mark.parametrize(('words', 'message'), [
    (['--formats', 'xml'], '--formats: expected some of csv,mcap,parquet,mot,coco, got xml'),
    (['--formats', 'mot', '--overlay'], '--overlay: expected mcap among --formats, got mot'),
    (['--formats', 'mot', '--live'], '--live: expected neither --overlay nor other --formats than csv,mcap'),
    (['--overlay', '--live'], '--live: expected neither --overlay nor other --formats than csv,mcap'),
])
def test_options_that_contradict_are_refused(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str,
) -> None:
    assert main(['replay', str(bag), '-o', str(tmp_path / 'out'), *words]) == 2
    assert capsys.readouterr().err == f'error: {message}\n'
    assert not (tmp_path / 'out').exists()
