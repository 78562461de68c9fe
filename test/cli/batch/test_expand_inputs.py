"""What the words of the command line mean."""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.batch.inputs import expand_inputs, size_of
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.mcap_file import MAGIC
from motion_detect_ros.sources.opening import open_source


def touch(root: Path, *names: str) -> None:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(MAGIC if name.endswith(('.mcap', '.bag', '.db3')) else b'text')


def expanded(root: Path, *words: str) -> tuple[list[str], bool]:
    inputs = expand_inputs([str(root / word) for word in words], root / 'out')
    return [str(Path(path).relative_to(root)) for path in inputs.paths], inputs.several


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    touch(tmp_path, 'flights/b10.mcap', 'flights/b2.mcap', 'flights/old.bag', 'flights/clip.mp4', 'flights/notes.txt',
          'flights/.hidden.mcap', 'flights/day/rec/rec_0.mcap', 'flights/day/rec/rec_1.mcap',
          'flights/day/rec/metadata.yaml', 'flights/day/cut/cut_0.db3', 'flights/day/cut/cut_1.db3',
          'flights/done/detections.mcap', 'flights/done/summary.json')
    return tmp_path


def test_one_input_is_itself(tree: Path):
    assert expanded(tree, 'flights/b2.mcap') == (['flights/b2.mcap'], False)
    assert expanded(tree, 'flights/day/rec') == (['flights/day/rec'], False)
    assert expanded(tree, 'flights/day/cut') == (['flights/day/cut'], False), 'cut off before metadata.yaml was written'


def test_a_folder_of_bags_is_every_bag_within_but_results(tree: Path):
    assert expanded(tree, 'flights') == (
        ['flights/b2.mcap', 'flights/b10.mcap', 'flights/clip.mp4', 'flights/day/cut', 'flights/day/rec',
         'flights/old.bag'], True)


def test_trials_of_a_search_are_no_input(tree: Path):
    before = expanded(tree, 'flights')
    (tree / 'flights' / 'tuned').mkdir()
    with closing(sqlite3.connect(tree / 'flights' / 'tuned' / 'trials.sqlite3')) as trials:
        trials.execute('CREATE TABLE trials (number)')
    assert expanded(tree, 'flights') == before == expanded(tree, 'flights/**')


def test_results_may_lie_among_the_inputs(tree: Path):
    touch(tree, 'flights/results/b2/detections.mcap')
    inputs = expand_inputs([str(tree / 'flights')], tree / 'flights' / 'results')
    assert not [path for path in inputs.paths if 'flights/results' in path]


@pytest.mark.parametrize(('pattern', 'expected'), [
    ('flights/*.mcap', ['flights/b2.mcap', 'flights/b10.mcap']),
    ('flights/b?.mcap', ['flights/b2.mcap']),
    ('flights/[a-c]*', ['flights/b2.mcap', 'flights/b10.mcap', 'flights/clip.mp4']),
    ('flights/**/*.mcap', ['flights/b2.mcap', 'flights/b10.mcap', 'flights/day/rec/rec_0.mcap',
                           'flights/day/rec/rec_1.mcap']),
    ('flights/d*', ['flights/day/cut', 'flights/day/rec']),
    ('flights/**', ['flights/b2.mcap', 'flights/b10.mcap', 'flights/clip.mp4', 'flights/day/cut', 'flights/day/rec',
                    'flights/old.bag']),
    ('flights/day/*/', ['flights/day/cut', 'flights/day/rec']),
])
def test_patterns(tree: Path, pattern: str, expected: list[str]):
    found, several = expanded(tree, pattern)
    assert sorted(found) == sorted(expected)
    assert several, 'of one match too, as tomorrow there may be two'


def test_a_file_whose_name_looks_like_a_pattern_is_itself(tmp_path: Path):
    touch(tmp_path, 'a[1].mcap')
    assert expanded(tmp_path, 'a[1].mcap') == (['a[1].mcap'], False)


def test_the_same_input_twice_is_one(tree: Path):
    (tree / 'link.mcap').symlink_to(tree / 'flights' / 'b2.mcap')
    assert expanded(tree, 'flights/b2.mcap', 'flights/*.mcap', 'link.mcap', 'flights/day/../b2.mcap') == (
        ['flights/b2.mcap', 'flights/b10.mcap'], True)


def test_what_does_not_exist_stays_so_that_it_is_said_with_the_others(tmp_path: Path):
    touch(tmp_path, 'a.mcap')
    assert expanded(tmp_path, 'a.mcap', 'no.mcap') == (['a.mcap', 'no.mcap'], True)


def test_what_pictures_keep_from_being_an_input_is_told(tmp_path: Path):
    touch(tmp_path, 'flights/cover.png', 'flights/seq/1.png', 'flights/seq/2.png', 'flights/clip/a.mp4',
          'flights/.hidden/1.png', 'videos/a.mp4', 'videos/b.mcap', 'videos/1.jpg', 'videos/2.jpg', 'plain/1.png',
          'demo/flight.mcap', 'demo/demo.json', 'demo/contact_sheet.png')

    def told(*words: str) -> tuple[str, ...]:
        return expand_inputs([str(tmp_path / word) for word in words], tmp_path / 'out').left_out

    flights, videos = tmp_path / 'flights', tmp_path / 'videos'
    assert expanded(tmp_path, 'flights') == (['flights'], False)
    of_flights = (f'{flights}: its pictures are one input, so the folders in it are not looked into; '
                  'left out: clip/a.mp4 and 1 more')
    assert told('flights') == (of_flights,)
    assert told('videos') == (f'{videos}: 2 pictures beside recordings are left out',)
    assert told('.') == (of_flights, f'{videos}: 2 pictures beside recordings are left out')
    assert told('plain', 'demo', 'flights/seq', 'videos/a.mp4', 'videos/*.mcap') == ()
    assert main(['replay', str(tmp_path / 'flights'), '-o', str(tmp_path / 'out'), '--no-report']) == 1


def test_patterns_without_matches(tree: Path):
    with pytest.raises(SourceError, match=r'flights/\*.avi: no file or folder matches$'):
        expanded(tree, 'flights/*.avi')
    with pytest.raises(SourceError, match=r'\*.txt: expected bags, videos or folders of pictures, got 1 other'):
        expanded(tree, 'flights/*.txt')


def test_trees_of_visdrone_and_kitti(tmp_path: Path):
    touch(tmp_path, 'val/sequences/uav10/0000001.jpg', 'val/sequences/uav9/0000001.jpg', 'val/annotations/uav9.txt',
          'kitti/2011_09_26/calib_cam_to_cam.txt', 'kitti/2011_09_26/drive_0001_sync/image_02/data/0000000000.png',
          'kitti/2011_09_26/drive_0001_sync/image_03/data/0000000000.png',
          'kitti/2011_09_26/drive_0001_sync/image_02/timestamps.txt')
    assert expanded(tmp_path, 'val') == (['val/sequences/uav9', 'val/sequences/uav10'], True)
    assert expanded(tmp_path, 'kitti') == (['kitti/2011_09_26/drive_0001_sync'], True)
    assert expanded(tmp_path, 'val/sequences/uav9') == (['val/sequences/uav9'], False)
    assert expanded(tmp_path, 'val', 'kitti')[0] == [
        'val/sequences/uav9', 'val/sequences/uav10', 'kitti/2011_09_26/drive_0001_sync']


@pytest.mark.parametrize('output', ['.', 'flights'])
@pytest.mark.parametrize('word', ['flights', 'flights/**'])
def test_an_output_folder_that_contains_the_inputs_is_no_result(tree: Path, word: str, output: str):
    expected = expanded(tree, word)[0]
    inputs = expand_inputs([str(tree / word)], tree / output)
    assert [str(Path(path).relative_to(tree)) for path in inputs.paths] == expected
    assert len(expected) == 6 and inputs.several


def test_bags_beside_the_results_of_an_earlier_replay_are_inputs(tree: Path):
    touch(tree, 'flights/summary.json', 'flights/detections.mcap', 'flights/detections.csv')
    assert expanded(tree, 'flights')[0] == [
        'flights/b2.mcap', 'flights/b10.mcap', 'flights/clip.mp4', 'flights/day/cut', 'flights/day/rec',
        'flights/old.bag']


def test_a_folder_named_detections_is_no_recording_for_that(tmp_path: Path):
    touch(tmp_path, 'detections/detections.mcap', 'detections/summary.json', 'a.mcap')
    assert expanded(tmp_path, '.')[0] == ['a.mcap']


def test_a_folder_whose_bags_are_all_left_out_says_what_to_do(tree: Path):
    touch(tree, 'hidden/.a.mcap', 'hidden/.b.mcap')
    for folder in ('flights/done', 'hidden'):
        with pytest.raises(SourceError, match=rf'{folder}: expected bags, .* name the file itself to replay it$'):
            expanded(tree, folder)


def test_several_bags_are_never_opened_as_one(tree: Path):
    with pytest.raises(SourceError, match=r'flights: 3 bags .* that are not parts of one recording .*; name one'):
        open_source(tree / 'flights')


def test_an_output_folder_that_is_the_input_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    touch(tmp_path, 'flights/rec/rec_0.mcap', 'flights/rec/metadata.yaml', 'flights/b.mcap')
    for words in (['flights', '-o', 'flights'], ['flights/rec', '-o', 'flights/rec']):
        assert main(['replay', *[word if word == '-o' else str(tmp_path / word) for word in words]]) == 2
        assert capsys.readouterr().err == (
            f'error: {tmp_path}/flights/rec: expected another folder for the outputs than the input itself; '
            'choose another --output\n')


@pytest.mark.parametrize('name', ['detections.mcap', 'detections.mcap.part'])
@pytest.mark.parametrize('options', [[], ['--force'], ['--formats', 'csv']])
def test_an_input_that_an_output_would_overwrite_is_refused(
    name: str, options: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    touch(tmp_path, f'out/{name}', f'out/a/{name}', 'a.mcap')
    (tmp_path / 'link.mcap').symlink_to(tmp_path / 'out' / name)
    for inputs, refused in ((['out/' + name], 'out/' + name), (['link.mcap'], 'link.mcap'),
                            (['a.mcap', 'out/a/' + name], 'out/a/' + name)):
        words = [*(str(tmp_path / word) for word in inputs), '-o', str(tmp_path / 'out'), *options]
        assert main(['replay', *words]) == 2
        assert capsys.readouterr().err == (
            f'error: {tmp_path}/{refused}: expected an input that no output replaces; choose another --output\n')
    assert (tmp_path / 'out' / name).exists() and (tmp_path / 'out' / 'a' / name).exists()


def test_links_that_lead_back_are_followed_once(tree: Path):
    expected = expanded(tree, 'flights')
    for name in ('day/up', 'day/again', 'zz/one', 'zz/two'):
        (tree / 'flights' / name).parent.mkdir(exist_ok=True)
        (tree / 'flights' / name).symlink_to(tree / 'flights')
    assert expanded(tree, 'flights') == expected


def test_a_file_that_cannot_be_read_is_in_nobodys_way(tree: Path):
    """Memory of this process has no first byte: reading there is an error, for root too."""
    expected = expanded(tree, 'flights')
    (tree / 'flights' / 'notes').symlink_to('/proc/self/mem')
    assert expanded(tree, 'flights') == expected
    (tree / 'flights' / 'a.mcap').symlink_to('/proc/self/mem')
    assert expanded(tree, 'flights')[0] == ['flights/a.mcap', *expected[0]]
    with pytest.raises(SourceError, match=r'a.mcap: cannot be read: Input/output error$'):
        open_source(tree / 'flights' / 'a.mcap')


def test_a_folder_that_cannot_be_read_is_listed_with_its_error(
    tree: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
):
    expected, iterate = expanded(tree, 'flights')[0], Path.iterdir
    (tree / 'flights' / 'closed').mkdir()

    def closed(self: Path) -> Iterator[Path]:
        if self.name == 'closed':
            raise PermissionError(errno.EACCES, 'Permission denied', str(self))
        return iterate(self)

    monkeypatch.setattr(Path, 'iterdir', closed)
    assert sorted(expanded(tree, 'flights')[0]) == sorted([*expected, 'flights/closed'])
    assert main(['replay', str(tree / 'flights' / 'closed'), '-o', str(tree / 'out')]) == 2
    assert capsys.readouterr().err == f'error: {tree}/flights/closed: cannot be read: Permission denied\n'


def test_the_flight_of_a_demo_is_an_input_and_what_was_found_in_it_is_none(tmp_path: Path) -> None:
    touch(tmp_path, *(f'demo/{name}' for name in ('flight.mcap', 'detections.mcap', 'demo.mp4', 'demo.json')),
          'mine/demo.mp4', 'mine/detections.mcap')
    for word in (str(tmp_path), f'{tmp_path}/*/*'):
        paths = expand_inputs([word], tmp_path / 'out').paths
        assert [str(Path(path).relative_to(tmp_path)) for path in paths] == [
            'demo/flight.mcap', 'mine/demo.mp4', 'mine/detections.mcap']


def test_links_to_what_is_not_there_are_inputs_that_fail(tree: Path):
    """A disk that is not mounted: a batch may not end well without them."""
    (tree / 'flights' / 'b3.mcap').symlink_to('/mnt/disk/b3.mcap')
    (tree / 'flights' / 'b4.txt').symlink_to('/mnt/disk/b4.txt')
    names = ['flights/b2.mcap', 'flights/b3.mcap', 'flights/b10.mcap']
    assert expanded(tree, 'flights')[0][:3] == names
    assert expanded(tree, 'flights/*.mcap') == (names, True)
    with pytest.raises(SourceError, match='no such file'):
        open_source(str(tree / 'flights' / 'b3.mcap'))


def test_the_list_of_a_batch_is_no_part_of_an_input(tmp_path: Path):
    """Of results inside of an input, the input has not changed."""
    touch(tmp_path, 'p/0.png', 'p/1.png')
    before = size_of(str(tmp_path / 'p'))
    touch(tmp_path, 'p/out/replay.json', 'p/out/a/summary.json', 'p/out/a/detections.csv')
    assert before == size_of(str(tmp_path / 'p')) == 8
