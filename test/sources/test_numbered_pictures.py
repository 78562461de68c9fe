"""Labels that number pictures, of excerpts, which keep the names that their pictures had in the whole."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import RecordArray
from motion_detect_ros.sources.numbered_pictures import truth_of_input
from motion_detect_ros.sources.truth import write_truth

KITTI_TAIL = '1.7 0.8 1.8 1.6 1.7 5.8 -1.7'


def pictures(folder: Path, *names: str) -> Path:
    folder.mkdir(parents=True)
    for name in names:
        assert cv2.imwrite(str(folder / name), np.zeros((4, 4), np.uint8))
    return folder


def visdrone(path: Path, *numbers: int) -> Path:
    """A box in each of these pictures, ``number`` pixels from the left."""
    path.write_text(''.join(f'{number},5,{number},0,9,9,1,4,0,0\n' for number in numbers))
    return path


def places(boxes: RecordArray) -> list[tuple[int, float]]:
    """Frame and left edge of each box."""
    return list(zip(boxes['frame'].tolist(), boxes['x'].tolist(), strict=True))


def test_visdrone(tmp_path: Path) -> None:
    folder = pictures(tmp_path / 'excerpt', '0000102.jpg', '0000104.jpg')
    truth = truth_of_input(visdrone(tmp_path / 'a.txt', 101, 102, 103, 104, 105), folder)
    assert places(truth.boxes) == [(0, 102), (1, 104)]
    assert truth.form == 'VisDrone MOT annotation'


def test_mot_challenge(tmp_path: Path) -> None:
    folder = pictures(tmp_path / 'img1', '000102.jpg', '000103.jpg')
    labels = tmp_path / 'gt.txt'
    labels.write_text('1,1,2,2,9,9,1,1,1\n103,1,104,2,9,9,1,1,1\n')  # pixels from 1
    assert places(truth_of_input(labels, folder).boxes) == [(1, 103)]


@pytest.mark.parametrize('given', ['.', 'image_02/data'])
def test_kitti(tmp_path: Path, given: str) -> None:
    pictures(tmp_path / 'drive' / 'image_02' / 'data', '0000000040.png', '0000000041.png')
    labels = tmp_path / '0000.txt'
    labels.write_text(''.join(f'{number} 1 Car 0 0 -1.9 {number} 20 90 60 {KITTI_TAIL}\n' for number in (0, 39, 41)))
    assert places(truth_of_input(labels, tmp_path / 'drive' / given).boxes) == [(1, 41)]


def test_labels_that_were_counted_anew_for_an_excerpt(tmp_path: Path) -> None:
    """By names, two of the four would be of the first pictures."""
    folder = pictures(tmp_path / 'excerpt', *(f'{number:07d}.jpg' for number in (3, 4, 5, 6)))
    assert places(truth_of_input(visdrone(tmp_path / 'a.txt', 1, 2, 3, 4), folder).boxes) == [
        (0, 1), (1, 2), (2, 3), (3, 4)]


def test_a_picture_that_is_missing_moves_no_label(tmp_path: Path) -> None:
    folder = pictures(tmp_path / 'whole', *(f'{number:07d}.jpg' for number in (1, 2, 4, 5)))
    assert places(truth_of_input(visdrone(tmp_path / 'a.txt', 1, 2, 3, 4), folder).boxes) == [(0, 1), (1, 2), (2, 4)]


@pytest.mark.parametrize('names', [
    ('a1.png', 'a2.png', 'a3.png'),                     # no numbers
    ('0.png', '1.png', '2.png'),                        # not counted as the labels are, from 1
    ('1403636579763.png', '1403636579813.png', '1403636579863.png'),  # times; no label is of one of them
    ('2.png', '02.png', '3.png'),                       # one number twice
])
def test_names_that_say_nothing_to_the_labels(tmp_path: Path, names: tuple[str, ...]) -> None:
    folder = pictures(tmp_path / 'flight', *names)
    assert places(truth_of_input(visdrone(tmp_path / 'a.txt', 1, 3), folder).boxes) == [(0, 1), (2, 3)]


def test_what_is_no_folder_of_pictures(tmp_path: Path) -> None:
    labels = visdrone(tmp_path / 'a.txt', 1, 3)
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'metadata.yaml').touch()
    pictures(tmp_path / 'bag' / 'thumbnails', '0000002.jpg')
    for source in (tmp_path / 'gone', labels, tmp_path / 'bag', None):
        assert places(truth_of_input(labels, source).boxes) == [(0, 1), (2, 3)]


def test_csv_counts_as_the_input_does(tmp_path: Path) -> None:
    folder = pictures(tmp_path / 'excerpt', '0000002.jpg', '0000003.jpg')
    write_truth(tmp_path / 'a.csv', truth_of_input(visdrone(tmp_path / 'a.txt', 2), folder).boxes)
    assert places(truth_of_input(tmp_path / 'a.csv', folder).boxes) == [(0, 2)]


def test_labels_of_other_pictures_are_refused(tmp_path: Path) -> None:
    folder = pictures(tmp_path / 'excerpt', '0000101.jpg', '0000102.jpg')
    labels = visdrone(tmp_path / 'a.txt', 1, 60)
    with pytest.raises(SourceError, match=r'a\.txt: expected labels of pictures 101 to 102 .*excerpt\), got 1 to 60'):
        truth_of_input(labels, folder)


def test_no_labels_at_all(tmp_path: Path) -> None:
    (tmp_path / 'a.csv').write_text('frame,id,x,y,w,h\n')
    assert len(truth_of_input(tmp_path / 'a.csv', pictures(tmp_path / 'excerpt', '0000101.jpg')).boxes) == 0
