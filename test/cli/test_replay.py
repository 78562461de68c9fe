"""replay: every frame, the same bytes each time, readable by others."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import time
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_contents import contents
from mcap.reader import make_reader

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.batch.jobs import Job
from motion_detect_ros.cli.batch.one_input import replay
from motion_detect_ros.cli.batch.processes import share_cores
from motion_detect_ros.core.clustering_stage import ClusteringStage
from motion_detect_ros.core.config import LoadConfig, PipelineConfig
from motion_detect_ros.core.pipeline import Measured, MotionPipeline
from motion_detect_ros.core.threads import limited, threads, use
from motion_detect_ros.core.types import DETECTION_DTYPE, Result
from motion_detect_ros.presets import find_config
from motion_detect_ros.sources.bags import BagWriter

FRAMES = 14


def scene(index: int) -> np.ndarray:
    """A textured plane seen by a camera that drifts 3 px a frame, with a textured block that crosses it."""
    ground = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (300, 460), np.uint8), (0, 0), 1.5)
    ground = cv2.normalize(ground, None, 0, 255, cv2.NORM_MINMAX)
    picture = ground[20:260, 3 * index:320 + 3 * index].copy()
    block = cv2.normalize(cv2.GaussianBlur(np.random.default_rng(2).integers(0, 256, (50, 60), np.uint8), (0, 0), 2),
                          None, 0, 255, cv2.NORM_MINMAX)
    left = 30 + 6 * index
    picture[90:140, left:left + 60] = block
    return cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('replay') / 'scene.mcap'
    with BagWriter(path, compress=False) as writer:
        for index in range(FRAMES):
            writer.write_image(scene(index), 10**9 + index * 40_000_000)
    return path


@pytest.fixture(scope='module')
def replayed(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp('out')
    assert main(['replay', str(bag), '-o', str(out)]) == 0
    return out


def test_two_runs_are_byte_identical(bag: Path, replayed: Path, tmp_path: Path) -> None:
    assert main(['replay', str(bag), '-o', str(tmp_path)]) == 0
    first = (replayed / 'detections.csv').read_bytes()
    assert first == (tmp_path / 'detections.csv').read_bytes()
    assert (replayed / 'frames.csv').read_bytes() == (tmp_path / 'frames.csv').read_bytes()
    assert first.count(b'\n') > 1, 'the scene must give detections, or the comparison says nothing'


def test_an_input_is_known_by_its_absolute_path(bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parquet = pytest.importorskip('pyarrow.parquet', reason="pip install 'motion_detect_ros[parquet]'")
    monkeypatch.chdir(bag.parent)
    assert main(['replay', bag.name, '-o', str(tmp_path), '--formats', 'parquet', '--no-report']) == 0
    assert set(parquet.read_table(tmp_path / 'detections.parquet')['input'].to_pylist()) == {str(bag)}
    summary = json.loads((tmp_path / 'summary.json').read_text())
    assert summary['input'] == str(bag)
    schema = json.loads(find_config('summary.schema.json').read_text())['$defs']['replay']['properties']['input']
    assert schema['description'].startswith('its absolute path')


def test_csv_and_bag_hold_what_the_pipeline_finds(replayed: Path) -> None:
    pipeline = MotionPipeline(PipelineConfig())
    expected = [pipeline.process(scene(index), 10**9 + index * 40_000_000).detections for index in range(FRAMES)]
    read = contents(replayed / 'detections.mcap')['/detections']
    assert [stamp for stamp, _ in read] == [10**9 + index * 40_000_000 for index in range(FRAMES)]
    clouds = [np.frombuffer(cloud.data.tobytes(), DETECTION_DTYPE) for _, cloud in read]
    assert [cloud.tobytes() for cloud in clouds] == [records.tobytes() for records in expected]
    with (replayed / 'detections.csv').open() as stream:
        rows = list(csv.DictReader(stream))
    flat = [(index, record) for index, records in enumerate(expected) for record in records]
    assert [(int(row['frame']), int(row['id'])) for row in rows] == [(index, record['id']) for index, record in flat]
    for row, (_, record) in zip(rows, flat, strict=True):
        assert float(row['x']) + float(row['w']) / 2 == pytest.approx(float(record['u']), abs=1e-4)
        assert float(row['vel_u']) == pytest.approx(float(record['vel_u']), abs=1e-4)


def test_summary(replayed: Path) -> None:
    summary = json.loads((replayed / 'summary.json').read_text())
    assert (summary['frames'], summary['bad_frames'], summary['complete']) == (FRAMES, 0, True)
    assert summary['image_size'] == [320, 240]
    assert [summary[name] for name in ('fps', 'topic', 'start_s', 'duration_s', 'every')] == [None] * 5
    assert summary['ego_status']['first_frame'] == 1
    assert summary['last_stamp_ns'] - summary['first_stamp_ns'] == 13 * 40_000_000
    assert set(summary['stage_ms']) == {'preprocessing', 'ego_motion', 'optical_flow', 'clustering', 'total'}
    for times in summary['stage_ms'].values():
        assert 0 <= times['p50'] <= times['p95']
    assert 'preprocessing.max_width_px' in summary['settings']
    with (replayed / 'detections.csv').open() as stream:
        rows = list(csv.DictReader(stream))
    assert summary['detections'] == len(rows)
    assert summary['objects'] == len({row['id'] for row in rows})
    assert not list(replayed.glob('*.part'))


def test_frames_csv_says_what_became_of_every_frame(replayed: Path) -> None:
    """The camera of the scene drifts 3 px a frame to the right: what is at x was at x + 3."""
    with (replayed / 'frames.csv').open() as stream:
        rows = list(csv.DictReader(stream))
    with (replayed / 'detections.csv').open() as stream:
        found = Counter(row['frame'] for row in csv.DictReader(stream))
    assert [int(row['frame']) for row in rows] == list(range(FRAMES))
    assert [int(row['stamp_ns']) for row in rows] == [10**9 + index * 40_000_000 for index in range(FRAMES)]
    assert [int(row['detections']) for row in rows] == [found[row['frame']] for row in rows]
    assert (rows[0]['ego_status'], rows[0]['m00'], rows[0]['m12']) == ('first_frame', '', '')
    for row in rows[1:]:
        assert row['ego_status'] == 'ok'
        assert [float(row[f'm{name}']) for name in ('00', '01', '10', '11')] == pytest.approx([1, 0, 0, 1], abs=5e-3)
        assert (float(row['m02']), float(row['m12'])) == pytest.approx((-3, 0), abs=0.3)


def test_times_csv_adds_up(replayed: Path) -> None:
    with (replayed / 'times.csv').open() as stream:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(stream)]
    assert [row['frame'] for row in rows] == list(range(FRAMES))
    for row in rows:
        stages = row['preprocessing'] + row['ego_motion'] + row['optical_flow'] + row['clustering']
        assert row['total'] == pytest.approx(stages, abs=0.003)
        assert row['decode'] > 0
    totals = sorted(row['total'] for row in rows)
    median = json.loads((replayed / 'summary.json').read_text())['stage_ms']['total']['p50']
    assert median == pytest.approx((totals[6] + totals[7]) / 2, abs=0.002)


def test_several_inputs_get_a_folder_each_and_workers_change_nothing(
    bag: Path, replayed: Path, tmp_path: Path,
) -> None:
    copy = tmp_path / 'again' / 'scene.mcap'
    copy.parent.mkdir()
    copy.write_bytes(bag.read_bytes())
    assert main(['replay', str(bag), str(copy), '-o', str(tmp_path / 'out'), '--workers', '2']) == 0
    expected = (replayed / 'detections.csv').read_bytes()
    for name in ('scene', 'scene-2'):
        assert (tmp_path / 'out' / name / 'detections.csv').read_bytes() == expected


def threads_of(config: LoadConfig) -> int:
    """As a job has them."""
    use(config.threads)
    return threads()


@pytest.mark.parametrize('workers', [1, 2, 3])
def test_workers_share_the_cores_unless_told_how_many_threads(workers: int) -> None:
    cores = len(os.sched_getaffinity(0))
    with multiprocessing.get_context('spawn').Pool(1, share_cores, (workers,)) as pool:
        assert pool.apply(threads_of, (LoadConfig(),)) == max(1, cores // workers)
        assert pool.apply(threads_of, (LoadConfig(threads=3),)) == 3


def test_one_bad_input_among_several_is_partial(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(['replay', str(tmp_path / 'no.mcap'), str(bag), '-o', str(tmp_path / 'out')]) == 3
    assert (tmp_path / 'out' / 'scene' / 'detections.csv').is_file()
    assert capsys.readouterr().err == f'error: {tmp_path}/no.mcap: no such file or folder\n'


@pytest.mark.parametrize(('option', 'message'), [
    (['--workers', '2'], 'error: --live: expected no --workers, as one graph plays one bag at a time, got 2\n'),
    (['--fps', '30'], 'error: --live: expected no --fps, as a bag has stamps of its own, got 30\n'),
])
def test_options_that_say_nothing_to_nodes_are_refused(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: list[str], message: str,
) -> None:
    assert main(['replay', str(bag), '-o', str(tmp_path / 'out'), '--live', *option]) == 2
    assert capsys.readouterr().err == message
    assert not (tmp_path / 'out').exists()


def test_a_rate_without_nodes_is_refused(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['replay', str(bag), '-o', str(tmp_path / 'out'), '--rate', '2']) == 2
    assert capsys.readouterr().err == 'error: --rate: expected --live beside it, which plays in time, got 2\n'
    assert not (tmp_path / 'out').exists()


def test_a_file_of_settings_replaces_the_preset_and_says_so(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    words = ['replay', str(bag), '--no-report', '--every', '20', '-o']
    assert main([*words, str(tmp_path / 'both'), '--preset', 'visdrone', '--config', 'kitti']) == 0
    assert '--preset visdrone: not used, as --config kitti replaces it\n' in capsys.readouterr().err
    assert main([*words, str(tmp_path / 'one'), '--preset', 'kitti']) == 0
    assert 'not used' not in capsys.readouterr().err
    both, one = (json.loads((tmp_path / name / 'summary.json').read_text())['settings'] for name in ('both', 'one'))
    assert both == one


def test_a_topic_of_pictures_is_refused_and_beside_a_bag_is_not(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    pictures, out = tmp_path / 'pictures', tmp_path / 'out'
    pictures.mkdir()
    for index in range(2):
        cv2.imwrite(str(pictures / f'{index}.png'), scene(index))
    words = ['-o', str(out), '--topic', 'image_raw', '--no-report']
    assert main(['replay', str(pictures), *words]) == 2
    assert capsys.readouterr().err == 'error: --topic: expected a bag among the inputs, got image_raw\n'
    assert not out.exists()
    assert main(['replay', str(pictures), str(bag), *words]) == 0


def test_a_rate_is_refused_where_all_inputs_have_stamps(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    pictures, out, drive = tmp_path / 'pictures', tmp_path / 'out', tmp_path / 'drive'
    (drive / 'image_02' / 'data').mkdir(parents=True)
    pictures.mkdir()
    for index in range(2):
        cv2.imwrite(str(pictures / f'{index}.png'), scene(index))
    words = ['-o', str(out), '--no-report', '--fps', '5']
    refused = ('error: --fps: expected an input without stamps of its own (video, pictures), got bags or KITTI drives '
               'only\n')
    for inputs in ([bag], [drive], [bag, drive]):
        assert main(['replay', *map(str, inputs), *words]) == 2
        assert capsys.readouterr().err == refused
        assert main(['tune', *map(str, inputs), *words[:2], '--fps', '5']) == 2
        assert capsys.readouterr().err == refused
    assert not out.exists()
    assert main(['replay', str(pictures), *words]) == 0
    assert json.loads((out / 'summary.json').read_text())['last_stamp_ns'] == 1_200_000_000
    assert main(['replay', str(pictures), '-o', str(out), '--no-report']) == 2
    assert 'fps 5.0, now not given' in capsys.readouterr().err
    assert main(['replay', str(pictures), str(bag), '-o', str(tmp_path / 'both'), '--no-report', '--fps', '5']) == 0


def test_an_unset_variable_is_not_the_current_folder(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(bag.parent)
    for words in ([''], [str(bag), '']):
        assert main(['replay', *words, '-o', str(tmp_path / 'out')]) == 2
        assert capsys.readouterr().err == 'error: inputs: expected a path, got nothing\n'
    assert not (tmp_path / 'out').exists()


def test_a_cut_bag_is_partial_and_its_frames_are_kept(bag: Path, tmp_path: Path) -> None:
    cut = tmp_path / 'cut.mcap'
    content = bag.read_bytes()
    cut.write_bytes(content[:int(0.8 * len(content))])
    assert main(['replay', str(cut), '-o', str(tmp_path / 'out')]) == 3
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert 'the end is missing' in summary['damaged']
    assert 0 < summary['frames'] < FRAMES


@pytest.mark.parametrize('wanted', [1, 5])
def test_one_thread_does_all_of_a_frame_in_each_of_the_steps_that_go_on_at_once(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wanted: int,
) -> None:
    detect, seen = MotionPipeline.detect, set[int]()
    monkeypatch.setattr(MotionPipeline, 'detect', lambda self, measured: (
        seen.add(threads()), detect(self, measured))[1])
    with limited(0):
        replay(Job(str(bag), tmp_path, PipelineConfig(load=LoadConfig(threads=wanted))))
        assert threads() == wanted, 'for the report'
    assert seen == {1}


def test_times_of_a_frame_are_not_longer_because_others_are_in_work(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    process = ClusteringStage.process
    monkeypatch.setattr(ClusteringStage, 'process', lambda *given: (time.sleep(0.2), process(*given))[1])
    summary = replay(Job(str(bag), tmp_path / 'waits', PipelineConfig()))
    assert summary.stage_ms['clustering'].p50 < 150.0

    def busy(*given: object) -> object:
        end = time.thread_time() + 0.2
        while time.thread_time() < end:
            pass
        return process(*given)

    monkeypatch.setattr(ClusteringStage, 'process', busy)
    summary = replay(Job(str(bag), tmp_path / 'works', PipelineConfig()))
    assert summary.stage_ms['clustering'].p50 >= 200.0


def test_an_interrupted_run_keeps_what_it_wrote(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    detect = MotionPipeline.detect

    def interrupted(self: MotionPipeline, measured: Measured) -> Result:
        if measured.frame.stamp_ns == 10**9 + 10 * 40_000_000:
            raise KeyboardInterrupt
        return detect(self, measured)

    monkeypatch.setattr(MotionPipeline, 'detect', interrupted)
    with pytest.raises(KeyboardInterrupt):
        replay(Job(str(bag), tmp_path, PipelineConfig()))
    summary = json.loads((tmp_path / 'summary.json').read_text())
    assert (summary['complete'], summary['frames']) == (False, 10)
    assert (tmp_path / 'detections.csv.part').read_text().startswith('frame,stamp_ns,id')
    with (tmp_path / 'detections.mcap.part').open('rb') as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages(['/detections'])) == 10
