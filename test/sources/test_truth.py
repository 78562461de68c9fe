"""Truth readers, against lines written by hand in the published formats."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import TRUTH_DTYPE
from motion_detect_ros.sources.numbered_pictures import truth_of_input
from motion_detect_ros.sources.truth import load_truth, read_truth, write_truth

KITTI_TAIL = '1.7 0.8 1.8 1.6 1.7 5.8 -1.7'


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_visdrone_counts_frames_from_one_and_has_ignored_regions(tmp_path: Path) -> None:
    truth = load_truth(write(tmp_path / 'a.txt', (
        '1,0,73.6,250.6,59.5,26.2,1,4,0,0\n'     # a car
        '3,8,10,20,30,40,1,0,0,0\n'              # category 0: ignored region
        '3,9,11,21,31,41,0,1,0,0\n')))           # score 0: not evaluated
    assert truth.boxes.tolist() == [
        (0, 0, 73.6, 250.6, 59.5, 26.2, 1), (2, 8, 10, 20, 30, 40, -1), (2, 9, 11, 21, 31, 41, -1)]
    assert (truth.form, truth.says_what_moves) == ('VisDrone MOT annotation', False)


def test_kitti_boxes_are_left_top_right_bottom(tmp_path: Path) -> None:
    truth = load_truth(write(tmp_path / 'a.txt', (
        '0 -1 DontCare -1 -1 -10 219.5 188.25 245.5 218.25 -1000 -1000 -1000 -10 -1 -1 -1\n'
        f'2 1 Cyclist 0 0 -1.9 737.5 161.5 931.0 374.0 {KITTI_TAIL}\n')))
    assert truth.boxes.tolist() == [(0, -1, 219.5, 188.25, 26, 30, -1), (2, 1, 737.5, 161.5, 193.5, 212.5, 1)]
    assert (truth.form, truth.says_what_moves) == ('KITTI tracking labels', False)


def test_mot_counts_from_one_and_leaves_out_what_its_own_evaluation_does(tmp_path: Path) -> None:
    truth = load_truth(write(tmp_path / 'gt.txt', (
        '1,3,794.27,247.59,71.245,174.88,1,1,0.86\n'  # a pedestrian
        '2,4,11,21,30,40,0,3,1\n'                     # flag 0: a car, not evaluated
        '2,5,11,21,30,40,1,7,1\n'                     # class 7: a person who stands
        '2,6,11,21,30,40,0,11,1\n')))                 # class 11: what hides others is no object
    assert [tuple(row) for row in truth.boxes.tolist()] == [
        (0, 3, pytest.approx(793.27), pytest.approx(246.59), 71.245, 174.88, 1),
        (1, 4, 10, 20, 30, 40, -1), (1, 5, 10, 20, 30, 40, -1)]
    assert (truth.form, truth.says_what_moves) == ('MOT Challenge annotation', False)


@pytest.mark.parametrize('place', ['-1,-1,-1', '4.1671,2.0413,0', '-10.6,-8.2,0'])
def test_mot_of_2015_has_places_in_space_and_no_classes(tmp_path: Path, place: str) -> None:
    truth = load_truth(write(tmp_path / 'gt.txt', f'1,1,11,21,30,40,1,{place}\n2,1,11,21,30,40,0,{place}\n'))
    assert truth.boxes.tolist() == [(0, 1, 10, 20, 30, 40, 1), (1, 1, 10, 20, 30, 40, -1)]
    assert truth.form == 'MOT Challenge annotation'


def test_mot_lines_may_end_with_a_comma(tmp_path: Path) -> None:
    """Of 9 columns and a comma the eighth is the class still: 7 is a person who stands."""
    truth = load_truth(write(tmp_path / 'gt.txt', '1,3,11,21,30,40,1,1,0.86,\n2,5,11,21,30,40,1,7,1,\n'))
    assert truth.boxes['moving'].tolist() == [1, -1]


def test_mot_flag_is_a_confidence_above_zero(tmp_path: Path) -> None:
    """Trackers that write this format put their confidence there."""
    truth = load_truth(write(tmp_path / 'gt.txt', '1,3,11,21,30,40,0.87\n2,5,11,21,30,40,0.0\n'))
    assert truth.boxes['moving'].tolist() == [1, -1]


@pytest.mark.parametrize('cells', ['nan,1,1', 'inf,1,1', '1,nan,1', '1,-inf,1'])
def test_mot_flags_and_classes_are_finite(tmp_path: Path, cells: str) -> None:
    with pytest.raises(SourceError, match=r'gt.txt, line 2: '):
        load_truth(write(tmp_path / 'gt.txt', f'1,1,11,21,30,40,1,1,1\n1,1,11,21,30,40,{cells}\n'))


def test_mot_names_the_line_that_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r'gt.txt, line 3: expected a box of four numbers, got '):
        load_truth(write(tmp_path / 'gt.txt', '1,1,11,21,30,40,1,9,1\n1,1,11,21,30,40,1,1,1\n1,1,1,b,30,40,1,1,1\n'))


def test_csv_with_and_without_moving(tmp_path: Path) -> None:
    labelled = load_truth(write(tmp_path / 'a.csv', 'frame,id,x,y,w,h,moving\n4,7,1.5,2,3,4,0\n5,7,1,2,3,4,-1\n'))
    assert labelled.boxes.tolist() == [(4, 7, 1.5, 2, 3, 4, 0), (5, 7, 1, 2, 3, 4, -1)]
    assert labelled.says_what_moves
    bare = load_truth(write(tmp_path / 'b.csv', 'frame,id,x,y,w,h\n4,7,1,2,3,4\n'))
    assert bare.boxes['moving'].tolist() == [1]
    assert not bare.says_what_moves
    header = 'frame,id,x,y,w,h,moving\n'
    for cells, says in (('4,7,1,2,3,4,\n4,8,1,2,3,4,-1\n', False), ('4,7,1,2,3,4,\n4,8,1,2,3,4,0\n', True),
                        ('', True), ('4,7,1,2,3,4,-1\n', True)):
        assert load_truth(write(tmp_path / 'c.csv', header + cells)).says_what_moves == says


@pytest.mark.parametrize('text', [
    '"frame","id","x","y","w","h"\n4,7,1,2,3,4\n', 'frame, id, x, y, w, h\n4, 7, 1, 2, 3, 4\n',
    '\r\nframe,id,x,y,w,h\r\n4.0,7.0,1,2,3,4\r\n', 'x,y,w,h,"id","frame"\n1,2,3,4,7,"4"\n'])
def test_csv_as_other_programs_write_it(tmp_path: Path, text: str) -> None:
    truth = load_truth(write(tmp_path / 'a.csv', text))
    assert (truth.boxes.tolist(), truth.form) == ([(4, 7, 1, 2, 3, 4, 1)], 'CSV')


def test_written_truth_reads_back_exactly(tmp_path: Path) -> None:
    boxes = np.array([(0, 1, 73.6, 0.1, 1 / 3, 26.2, -1), (9, 2, -4.0, 1e-7, 5, 6, 0)], TRUTH_DTYPE)
    write_truth(tmp_path / 'a.csv', boxes)
    assert read_truth(tmp_path / 'a.csv').tolist() == boxes.tolist()


@pytest.mark.parametrize(('text', 'message'), [
    ('', 'expected a VisDrone annotation'),
    ('hello world\n', "first line 'hello world'; expected a VisDrone annotation"),
    ('1,0,1,2,3,4,1,4,0,0\n2,0,1,2,x,4,1,4,0,0\n', "line 2: expected a box of four numbers, got '1', '2', 'x', '4'"),
    ('1,0,1,2,3,4,1,4,0,0\n2,0,1\n', 'line 2: '),
    ('frame,id,x,y,w\n', 'column h is missing'),
    ('frame,id,x,y,w,h\n1,1,1,1,1\n', 'line 2: '),
    ('frame,id,x,y,w,h\n1,1,1,1,1,1\n1,1,nan,1,1,1\n', 'line 3: expected a box of finite numbers, got nan, 1, 1, 1'),
    ('1,1,11,21,inf,40,1,1,1\n', 'line 1: expected a box of finite numbers, got 11, 21, inf, 40'),
    (f'frame,id,x,y,w,h\n1,1,{"9" * 131073},1,1,1\n', 'line 2: field larger than field limit'),
    (f'frame,{"i" * 131073},x,y,w,h\n', 'line 1: field larger than field limit'),
    ('frame,id,x,y,w,h\n0,1,1,1,1,1\n0.04,1,1,1,1,1\n', 'line 3: frame: expected a whole number, got 0.04'),
    ('frame,id,x,y,w,h\nnan,1,1,1,1,1\n', 'line 2: frame: expected a whole number, got nan'),
    ('frame,id,x,y,w,h\n0,1.5,1,1,1,1\n', 'line 2: id: expected a whole number, got 1.5'),
    ('frame,id,x,y,w,h\n-1,1,1,1,1,1\n', 'line 2: expected frame 0 or later, got -1'),
    ('frame,id,x,y,w,h\n0,1,1,1,-1,1\n', 'line 2: expected a width and height of 0 or more, got -1, 1'),
    ('frame,id,x,y,w,h,moving\n0,1,1,1,1,1,0.9\n', 'line 2: moving: expected a whole number, got 0.9'),
    ('frame,id,x,y,w,h,moving\n0,1,1,1,1,1,2\n', 'line 2: moving: expected 1, 0 or -1, got 2'),
    ('\n\nframe,id,x,y,w,h\n\n0,1,1,1,1,x\n', "line 5: expected a box of four numbers, got '1', '1', '1', 'x'"),
    ('1,1,11,21,30,40,1,1,1\n0,1,11,21,30,40,1,1,1\n', 'line 2: expected frame 1 or later, got 0'),
    ('1.5,1,11,21,30,40,1,1,1\n', 'line 1: frame: expected a whole number, got 1.5'),
    ('0,0,1,2,3,4,1,4,0,0\n', 'line 1: expected frame 1 or later, got 0'),
    (f'0 1 Car 0 0 -1.9 50 10 40 20 {KITTI_TAIL}\n', 'line 1: expected a width and height of 0 or more, got -10, 10'),
])
def test_malformed_truth_names_the_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SourceError, match=message):
        load_truth(write(tmp_path / 'a.txt', text))


def test_real_annotations(clips: Path) -> None:
    folder = clips / 'visdrone/VisDrone2019-MOT-val'
    name = 'uav0000086_00000_v'
    truth = load_truth(folder / f'annotations/{name}.txt')
    # grep -c '^1,' and grep -c '^464,' of the file; its last frame is 464
    assert np.sum(truth.boxes['frame'] == 0) == 36
    assert truth.boxes['frame'].max() == 463
    excerpt = truth_of_input(folder / f'annotations/{name}.txt', folder / 'sequences' / name)
    assert set(excerpt.boxes['frame']) == set(range(12))
    kitti = load_truth(clips / 'kitti/label_02/0000.txt')
    van = kitti.boxes[(kitti.boxes['frame'] == 0) & (kitti.boxes['id'] == 0)][0]
    assert (van['x'], van['y']) == (296.744956, 161.752147)
    assert (van['w'], van['h']) == pytest.approx((158.481086, 130.620657), abs=1e-9)
