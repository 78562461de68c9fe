"""coco.json, as pycocotools reads and evaluates it, and whole whatever ends the replay."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from result_samples import FOUND, SIZE, UNKNOWN, interrupted, write

IMAGE = {'file_name': '000001.jpg', 'width': SIZE[0], 'height': SIZE[1], 'id': 1, 'stamp_ns': 1_050_000_000}
BOX = {'id': 3, 'image_id': 1, 'category_id': 1, 'bbox': [284.0, 192.0, 32.0, 16.5], 'area': 528.0, 'iscrowd': 0,
       'score': 0.75, 'track_id': 9}


def truth(folder: Path, *boxes: tuple[int, list[float]]) -> Any:
    """Ground truth of pycocotools from (image, box)."""
    coco = pytest.importorskip('pycocotools.coco', reason='pip install pycocotools')
    annotations = [{'id': number, 'image_id': image, 'category_id': 1, 'bbox': box, 'area': box[2] * box[3],
                    'iscrowd': 0} for number, (image, box) in enumerate(boxes, 1)]
    path = folder / 'truth.json'
    path.write_text(json.dumps({'images': [{'id': image, 'width': 640, 'height': 480} for image in (0, 1, 3)],
                                'categories': [{'id': 1, 'name': 'moving'}], 'annotations': annotations}))
    return coco.COCO(str(path))


def test_content_by_hand(tmp_path: Path) -> None:
    write(tmp_path, 'coco', found=[*FOUND, UNKNOWN])
    content = json.loads((tmp_path / 'coco.json').read_text(), parse_constant=pytest.fail)
    assert sorted(content) == ['annotations', 'categories', 'images', 'info']
    assert content['categories'] == [{'id': 1, 'name': 'moving', 'supercategory': 'object'}]
    assert [image['id'] for image in content['images']] == [0, 1, 3, 4]
    assert content['images'][1] == IMAGE
    assert [(box['id'], box['image_id'], box['track_id']) for box in content['annotations']] == [
        (1, 0, 7), (2, 1, 7), (3, 1, 9)]
    assert content['annotations'][2] == BOX
    assert content['info']['description'] == 'moving objects in flight.mcap'


def test_nothing_found_and_no_frames_at_all_are_whole_files(tmp_path: Path) -> None:
    write(tmp_path, 'coco', found=[FOUND[2]])
    content = json.loads((tmp_path / 'coco.json').read_text())
    assert (content['annotations'], [image['id'] for image in content['images']]) == ([], [3])
    write(tmp_path, 'coco', found=[])
    content = json.loads((tmp_path / 'coco.json').read_text())
    assert (content['annotations'], content['images']) == ([], [])


def test_what_an_interrupted_run_leaves_is_whole(tmp_path: Path) -> None:
    interrupted(tmp_path, 'coco')
    assert [path.name for path in tmp_path.iterdir()] == ['coco.json.part']
    content = json.loads((tmp_path / 'coco.json.part').read_text())
    assert (len(content['annotations']), len(content['images'])) == (3, 3)


def test_pycocotools_reads_it_as_a_data_set(tmp_path: Path) -> None:
    coco = pytest.importorskip('pycocotools.coco', reason='pip install pycocotools')
    write(tmp_path, 'coco')
    read = coco.COCO(str(tmp_path / 'coco.json'))
    assert read.getImgIds() == [0, 1, 3]
    assert read.getCatIds(catNms=['moving']) == [1]
    assert read.loadAnns(read.getAnnIds(imgIds=[1])) == [{**BOX, 'id': 2, 'bbox': [47, 18, 11, 4], 'area': 44,
                                                          'score': 0.5, 'track_id': 7}, BOX]


def test_pycocotools_evaluates_its_annotations_as_results(tmp_path: Path) -> None:
    """Two of the three boxes are in the truth and the false one has the lowest score: precision 1 up to full recall."""
    evaluation = pytest.importorskip('pycocotools.cocoeval', reason='pip install pycocotools')
    wanted = truth(tmp_path, (1, [47, 18, 11, 4]), (1, [284, 192, 32, 16.5]))
    write(tmp_path, 'coco')
    results = wanted.loadRes(json.loads((tmp_path / 'coco.json').read_text())['annotations'])
    evaluator = evaluation.COCOeval(wanted, results, 'bbox')
    evaluator.evaluate()
    evaluator.accumulate()
    evaluator.summarize()
    precision, recall = evaluator.stats[0], evaluator.stats[8]
    assert (precision, recall) == (pytest.approx(1.0), pytest.approx(1.0))
    missing = truth(tmp_path, (0, [284, 192, 32, 16.5]))
    evaluator = evaluation.COCOeval(missing, missing.loadRes(results.dataset['annotations']), 'bbox')
    evaluator.evaluate()
    evaluator.accumulate()
    evaluator.summarize()
    assert evaluator.stats[8] == 0.0
