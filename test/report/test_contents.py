"""What a report says, against folders written by hand."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from results_by_hand import (
    BIT_CENTRES,
    FRAMES,
    HEIGHT,
    WIDTH,
    box_of,
    number_of,
    picture,
    stamp_ns,
    write_pictures,
    write_results,
    write_truth,
)

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.report import objects as objects_module
from motion_detect_ros.report.index import make_index
from motion_detect_ros.report.judged import judge
from motion_detect_ros.report.make import make_report
from motion_detect_ros.report.objects import listed, tracked_objects
from motion_detect_ros.report.pictures import Cutout, cut_out
from motion_detect_ros.report.replayed import read_replayed
from motion_detect_ros.results.evaluation import evaluate_clip, figure_of
from motion_detect_ros.results.summary import STAGES, Percentiles, read_summary, write_summary
from motion_detect_ros.sources.frames import SourceFrame
from motion_detect_ros.sources.opening import open_source


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return write_results(tmp_path / 'results', 'nowhere')


def test_folder_is_read_back(results: Path):
    replayed = read_replayed(results)
    assert len(replayed.frames) == len(replayed.times) == FRAMES
    assert replayed.frames['stamp_ns'].tolist() == [stamp_ns(frame) for frame in range(FRAMES)]
    assert replayed.duration_s == pytest.approx(3.9)
    assert replayed.interval_s == pytest.approx(0.1)
    assert replayed.usable().tolist() == [False] + [True] * (FRAMES - 1)
    assert replayed.of_frame(21)['id'].tolist() == [7, 12, 3]
    assert [*replayed.of_frame(21)[0]][3:7] == [*box_of(7, 21)]
    assert len(replayed.of_frame(2)) == 0


def test_interrupted_replay_is_read_from_its_parts(results: Path):
    for name in ('detections.csv', 'frames.csv', 'times.csv'):
        (results / name).rename(results / f'{name}.part')
    with (results / 'frames.csv.part').open('a') as stream:
        stream.write('40,50')
    assert len(read_replayed(results).frames) == FRAMES


def test_what_is_wrong_with_a_folder_is_said(results: Path, tmp_path: Path):
    with pytest.raises(SourceError, match='expected the summary of a replay'):
        read_replayed(tmp_path)
    (results / 'frames.csv').write_text('frame,stamp_ns\n1,2\n')
    with pytest.raises(SourceError, match=r'frames.csv: column ego_status, .* is missing; expected frame,stamp_ns,'):
        read_replayed(results)
    (results / 'detections.csv').write_text((results / 'detections.csv').read_text() + 'x' + ',1' * 10 + '\n')
    with pytest.raises(SourceError, match=r'detections.csv, line 58: invalid literal'):
        read_replayed(results)
    (results / 'detections.csv').unlink()
    with pytest.raises(SourceError, match=r'detections.csv: expected a file of a replay: No such file'):
        read_replayed(results)


def test_stamps_that_go_back_do_not_turn_time_around(results: Path):
    """The clock was set by an hour at frame 20: that step is as long as the others."""
    for name in ('frames.csv', 'detections.csv'):
        header, *rows = (results / name).read_text().splitlines()
        cells = [row.split(',') for row in rows]
        rows = [','.join([frame, str(int(stamp) - (3600 * 10**9 if int(frame) >= 20 else 0)), *rest])
                for frame, stamp, *rest in cells]
        (results / name).write_text('\n'.join([header, *rows, '']))
    replayed = read_replayed(results)
    assert (replayed.interval_s, replayed.duration_s) == (pytest.approx(0.1), pytest.approx(3.9))
    assert replayed.seconds(replayed.frames['frame']) == pytest.approx(0.1 * np.arange(FRAMES))
    assert [each.first_s for each in tracked_objects(replayed)] == pytest.approx([0.5, 1.2, 2.0])


@pytest.mark.parametrize('wrong', [
    {'frames': 'many'}, {'frames': None}, {'damaged': 7}, {'first_stamp_ns': '1'}, {'input': 3}, {'objects': [1]},
    {'stage_ms': {'total': {'p50': 'x', 'p95': 1}}}, {'image_size': 5}])
def test_a_summary_of_wrong_types_is_trouble_of_that_folder(results: Path, tmp_path: Path, wrong: dict[str, Any]):
    pytest.importorskip('jinja2', reason='jinja2 is not installed (extra "report")')
    odd = write_results(tmp_path / 'odd', 'nowhere') / 'summary.json'
    odd.write_text(json.dumps({**json.loads(odd.read_text()), **wrong}))
    page = make_index(tmp_path).read_text()
    assert f'{odd}: expected the summary of a replay, got TypeError: ' in page or 'got ValueError: ' in page
    assert f'{FRAMES}' in page, 'the other is there as it was'


def test_warnings_of_the_replay_are_told(results: Path, tmp_path: Path):
    pytest.importorskip('jinja2', reason='jinja2 is not installed (extra "report")')
    file = results / 'summary.json'
    file.write_text(json.dumps({**json.loads(file.read_text()), 'warnings': ['camera_info refused: <1 px', 'no end']}))
    page, index = make_report(results).read_text(), make_index(tmp_path).read_text()
    assert 'Warning: camera_info refused: &lt;1 px' in page
    assert 'Warning: no end' in page
    assert 'camera_info refused: &lt;1 px; no end' in index


def test_objects(results: Path):
    first, second, third = tracked_objects(read_replayed(results))
    assert (first.identity, second.identity, third.identity) == (7, 12, 3)
    assert first.first_s == pytest.approx(0.5)
    assert first.last_s == pytest.approx(2.9)
    assert first.life_s == pytest.approx(2.4)
    assert first.frames == 25
    assert first.speed == pytest.approx(50.0), 'hypot(40, 30)'
    assert (first.width, first.height) == (40, 30)
    assert first.ttc_s == 2.5
    assert np.isnan(second.ttc_s)
    assert len({first.color, second.color, third.color}) == 3


def test_gap_parts_a_life_in_two(tmp_path: Path):
    seen = [*range(5, 10), *range(20, 25)]
    (one,) = tracked_objects(read_replayed(write_results(tmp_path / 'r', 'nowhere', {7: seen})))  # type: ignore[dict-item]
    assert [value for part in one.parts for value in part] == pytest.approx([0.5, 1.0, 2.0, 2.5])


def test_those_seen_longest_are_listed(results: Path, monkeypatch: pytest.MonkeyPatch):
    found = tracked_objects(read_replayed(results))
    monkeypatch.setattr(objects_module, 'MAX_LISTED', 2)
    assert [each.identity for each in listed(found)] == [7, 12]
    assert [each.identity for each in listed([replace(found[2], frames=99), *found[:2]])] == [12, 3]


def test_truth(results: Path, tmp_path: Path):
    """7 and 12 are found whenever counted (frames 10 on), 3 is false in its four frames, 50 is missed in all 30."""
    judged = judge(read_replayed(results), write_truth(tmp_path / 'truth.csv'))
    hits, total = (30 - 10) + 27, (30 - 10) + 27 + 30
    assert judged.main.true_positives == hits
    assert judged.main.false_positives == 4
    assert judged.main.wanted == total
    assert judged.main.precision == pytest.approx(hits / (hits + 4))
    assert judged.misses.tolist() == [0] * 10 + [1] * 30
    assert judged.false_boxes.nonzero()[0].tolist() == [20, 21, 22, 23]
    assert [(each.missed, each.identity, each.count, each.frames) for each in judged.mistakes] == [
        (True, 50, 30, 30), (False, 3, 4, 4)]
    assert judged.found.sum() == 25 + 27, 'the first frames are shown as found too'
    boxes = judged.truth.boxes
    assert judged.counts.tolist() == [frame >= 10 and moving == 1 for frame, moving in zip(
        boxes['frame'].tolist(), boxes['moving'].tolist(), strict=True)]
    assert 0 < judged.counts.sum() < len(boxes)
    assert judged.mistakes[0].box == (200, 200, 20, 20)


@pytest.mark.parametrize('window', [{}, {'every': 2}, {'start_s': 1.0}, {'start_s': 0.5, 'every': 2},
                                    {'settings': {'load.decimation_keep': 1, 'load.decimation_of': 2}}])
def test_scores_are_those_of_evaluate(tmp_path: Path, window: dict[str, Any]):
    folder = write_results(tmp_path / 'results', 'nowhere', source_frames=50, **window)
    for name in ('frames.csv', 'detections.csv') if window else ():
        header, *rows = (folder / name).read_text().splitlines()
        kept = [row for row in rows if int(row.split(',')[0]) in range(5, 35, int(window.get('every', 1)))]
        (folder / name).write_text('\n'.join([header, *kept, '']))
    truth = write_truth(tmp_path / 'truth.csv')
    judged = judge(read_replayed(folder), truth)
    clip = evaluate_clip('a', truth, {'run': folder / 'detections.csv'})
    assert judged.scores == {
        (counting, iou): figure_of([clip], counting, iou).scores['a']['run'] for counting, iou in judged.scores}
    assert judged.main.frames == (len(read_replayed(folder).frames) - 10 if window else 40)


@pytest.mark.parametrize('box', [(100, 100, 20, 10), (-30, -30, 40, 40), (300, 220, 90, 90), (-900, 5000, 10, 10),
                                 (0, 0, 320, 240), (float('nan'), 5, 10, 10), (50, 50, 0, 0)])
def test_cutout_is_a_piece_of_the_picture_wherever_the_box_is(box: tuple[float, float, float, float]):
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    piece = cut_out(image, Cutout('key', 0, box, 0.5, (136, 92)))
    assert piece.ndim == 3
    assert 1 <= piece.shape[1] <= 136
    assert 1 <= piece.shape[0] <= 92


def test_cutout_shows_the_object_in_its_middle():
    x, y, w, h = box_of(7, 20)
    piece = cut_out(picture(20), Cutout('key', 20, (x, y, w, h), 0.35, (136, 92)))
    assert piece[piece.shape[0] // 2, piece.shape[1] // 2].tolist() == [255, 255, 255]
    assert piece[2, 2].tolist() == picture(20)[0, 0].tolist()


#: What the summary says as long as a replay runs.
BEGUN = {'complete': False, 'frames': 0, 'source_frames': 0, 'detections': 0, 'objects': 0, 'ego_status': {},
         'image_size': (0, 0), 'first_stamp_ns': 0, 'last_stamp_ns': 0, 'decode_ms': Percentiles(),
         'stage_ms': {stage: Percentiles() for stage in STAGES}}


def killed(folder: Path) -> Path:
    write_summary(folder, replace(read_summary(folder), **BEGUN))  # type: ignore[arg-type]
    return folder


@pytest.mark.parametrize(('rows', 'told'), [(True, f'{FRAMES}</'), (False, 'interrupted; no frames')])
def test_the_index_counts_the_rows_of_a_replay_that_was_killed(results: Path, rows: bool, told: str):
    pytest.importorskip('jinja2', reason='jinja2 is not installed (extra "report")')
    killed(results)
    if not rows:
        (results / 'detections.csv').unlink()
    page = make_index(results).read_text()
    assert told in page
    assert ('no frames' in page) != rows


def test_a_replay_that_was_killed_is_told_by_its_rows(results: Path):
    whole, told = read_summary(results), read_replayed(killed(results)).summary
    assert told == replace(whole, complete=False, image_size=(0, 0), stage_ms=told.stage_ms)
    assert told.stage_ms['total'] == Percentiles(14.0, 14.0), 'as the rows say'


@pytest.mark.parametrize(('complete', 'name'), [
    (True, 'left out on request'), (False, 'left out on request, or read ahead when it was interrupted')])
def test_nothing_was_requested_of_a_replay_that_was_interrupted(results: Path, complete: bool, name: str):
    pytest.importorskip('plotly', reason='plotly is not installed (extra "report")')
    from motion_detect_ros.report.page import _counts
    summary = read_summary(results)
    write_summary(results, replace(summary, complete=complete, source_frames=summary.source_frames + 5))
    assert dict(_counts(read_replayed(results)))[name] == 5


class TestPictures:
    """One more pass over the input."""

    @pytest.fixture(autouse=True)
    def needs(self) -> None:
        pytest.importorskip('av', reason='av is not installed (extra "report")')

    def test_film_shows_every_frame_in_order(self, tmp_path: Path):
        from motion_detect_ros.report.pictures import plan_film, take_pictures
        source = write_pictures(tmp_path / 'pictures')
        replayed = read_replayed(write_results(tmp_path / 'results', str(source)))
        plan = plan_film(replayed)
        assert plan.fps == pytest.approx(10)
        cutout = Cutout('key', 21, box_of(12, 21), 0.3, (80, 60))
        pictures = take_pictures(replayed, plan, [cutout])
        assert pictures.missing == ''
        assert pictures.film_frames == tuple(range(FRAMES))
        assert pictures.background.startswith('data:image/jpeg;base64,')
        assert [*pictures.cutouts] == ['key']
        (tmp_path / 'film.webm').write_bytes(pictures.film)
        film = cv2.VideoCapture(str(tmp_path / 'film.webm'))
        shown = [number_of([image[y, x, 1] for x, y in BIT_CENTRES]) for _, image in iter(film.read, (False, None))]
        assert shown == [*range(FRAMES)]
        assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(10)

    def test_input_that_ends_early_gives_a_shorter_film(self, tmp_path: Path):
        from motion_detect_ros.report.pictures import plan_film, take_pictures
        source = write_pictures(tmp_path / 'pictures')
        replayed = read_replayed(write_results(tmp_path / 'results', str(source)))
        for frame in range(25, FRAMES):
            (source / f'{frame:04d}.png').unlink()
        assert take_pictures(replayed, plan_film(replayed), []).film_frames == tuple(range(25))

    def test_input_that_breaks_gives_a_shorter_film(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        from motion_detect_ros.report import pictures as module
        replayed = read_replayed(write_results(tmp_path / 'results', str(write_pictures(tmp_path / 'pictures'))))

        def breaking(*words: Any) -> Iterator[SourceFrame]:
            yield from islice(open_source(*words), 12)
            raise SourceError('the disk was pulled out')

        monkeypatch.setattr(module, 'open_source', breaking)
        pictures = module.take_pictures(replayed, module.plan_film(replayed), [])
        assert pictures.film_frames == tuple(range(12))
        (tmp_path / 'film.webm').write_bytes(pictures.film)
        film = cv2.VideoCapture(str(tmp_path / 'film.webm'))
        assert len([*iter(lambda: film.read()[0], False)]) == 12

    @pytest.mark.parametrize('gone', [False, True])
    def test_a_replay_that_was_killed_is_shown_in_the_size_of_its_pictures(self, tmp_path: Path, gone: bool):
        for library in ('jinja2', 'plotly'):
            pytest.importorskip(library, reason=f'{library} is not installed (extra "report")')
        source = write_pictures(tmp_path / 'pictures')
        folder = killed(write_results(tmp_path / 'results', str(source)))
        if gone:
            shutil.rmtree(source)
        page = make_report(folder).read_text(encoding='utf-8')
        assert (f'{WIDTH} x {HEIGHT} px' in page, '0 x 0 px' in page) == (not gone, False)
        assert f'boxes in {FRAMES} frames' in page

    @pytest.mark.parametrize('fps', [None, 7.0])
    def test_other_input_gives_no_pictures(self, tmp_path: Path, fps: float | None):
        """Gone, or with other stamps than those replayed."""
        from motion_detect_ros.report.pictures import plan_film, take_pictures
        source = write_pictures(tmp_path / 'pictures')
        replayed = read_replayed(write_results(tmp_path / 'results', str(source)))
        if fps is None:
            shutil.rmtree(source)
        for path in (None, str(tmp_path / 'elsewhere')) if fps is None else ():
            assert 'no such file or folder' in take_pictures(replayed, plan_film(replayed), [], path).missing
        if fps:
            other = replace(replayed, summary=replace(replayed.summary, fps=fps))
            assert 'film' not in take_pictures(other, plan_film(other), []).missing
            assert take_pictures(other, plan_film(other), []).film_frames == (0,), 'only the first stamp is the same'

    def test_film_of_a_minute_stays_small(self):
        """A fifth of a minute, hard to compress: a texture that glides and turns."""
        from motion_detect_ros.report.film import Film, film_size
        assert film_size(1920, 1080) == (960, 540)
        assert film_size(321, 241) == (320, 240)
        texture = cv2.GaussianBlur(np.random.default_rng(3).integers(0, 256, (700, 1400, 3), np.uint8), (0, 0), 1.5)
        with Film((960, 540), 25, 1500) as film:
            for frame in range(150):
                turn = cv2.getRotationMatrix2D((480, 270), 0.2 * frame, 1.0 + 0.001 * frame)
                turn[:, 2] -= 2.0 * frame / 3, 10
                film.add(cv2.warpAffine(texture, turn, (960, 540)))
        minute = len(film.content) * 10
        assert minute * 4 / 3 < 12_000_000, 'as base64, with 3 MB left for all the rest'


def test_folders_whose_names_are_no_utf8(tmp_path: Path):
    """They are shown with what cannot be, and their links lead to them."""
    pytest.importorskip('jinja2', reason='jinja2 is not installed (extra "report")')
    folder = tmp_path / os.fsdecode(b'day\xff')
    results = write_results(folder / os.fsdecode(b'out\xfe 1'), 'nowhere')
    (results / 'report.html').write_text('')
    page = make_index(folder).read_text(encoding='utf-8')
    assert '>out\\udcfe 1</a>' in page
    assert 'href="out%FE%201/report.html"' in page
    assert '<h1>day\\udcff</h1>' in page
