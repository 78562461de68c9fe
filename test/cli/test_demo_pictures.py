"""Contact sheet, video and annotated pictures, by geometry worked out by hand and by reading the files back."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.cli.contact_sheet import Tile, contact_sheet, spread_over
from motion_detect_ros.cli.demo_pictures import annotate, caption
from motion_detect_ros.cli.video import VideoWriter
from motion_detect_ros.core.errors import BackendError, FrameError
from motion_detect_ros.core.types import TRUTH_DTYPE, ByteArray, RecordArray, empty_detections

RED, GREEN, BLUE = (0, 0, 255), (0, 255, 0), (255, 0, 0)


def plain(color: tuple[int, int, int], width: int = 200, height: int = 100) -> ByteArray:
    return np.full((height, width, 3), color, np.uint8)


def detection(u: float, v: float, width: float, height: float, ident: int = 1) -> RecordArray:
    record = empty_detections(1)
    record['u'], record['v'], record['width'], record['height'], record['id'] = u, v, width, height, ident
    return record


def truth_box(x: float, y: float, w: float, h: float) -> RecordArray:
    return np.array([(0, 1, x, y, w, h, 1)], TRUTH_DTYPE)


class TestContactSheet:
    def test_tiles_lie_row_by_row(self) -> None:
        """200x100 pictures as 50x25 tiles, strips of 22, gaps of 6: pitch 56 x 53, two columns, two rows."""
        sheet = contact_sheet([Tile(plain(color), '') for color in (RED, GREEN, BLUE)], columns=2, tile_width_px=50)
        assert sheet.shape == (2 * 53 + 6, 2 * 56 + 6, 3)
        for left, top, color in ((6, 6, RED), (62, 6, GREEN), (6, 59, BLUE)):
            tile = sheet[top:top + 25, left:left + 50]
            assert (tile == color).all()
            assert not (sheet[top - 1, left:left + 50] == color).all(axis=-1).any()
            assert not (sheet[top:top + 25, left + 50] == color).all(axis=-1).any()
        assert len(np.unique(sheet[59:84, 62:112].reshape(-1, 3), axis=0)) == 1, 'the fourth place is empty'

    def test_caption_is_written_under_its_picture(self) -> None:
        bare, named = (contact_sheet([Tile(plain(RED), text)], tile_width_px=100) for text in ('', 'frame 7'))
        rows = np.flatnonzero((bare != named).any(axis=(1, 2)))
        assert rows.min() >= 6 + 50 and rows.max() < 6 + 50 + 22

    @pytest.mark.parametrize(('tiles', 'message'), [
        ([], 'expected at least one picture, got none'),
        ([Tile(plain(RED), ''), Tile(plain(RED, 100), '')], 'expected BGR pictures of one shape, got .*100, 100, 3'),
        ([Tile(np.zeros((4, 4), np.uint8), '')], r'expected BGR pictures of one shape, got \[\(4, 4\)\]'),
    ])
    def test_refuses(self, tiles: list[Tile], message: str) -> None:
        with pytest.raises(FrameError, match=message):
            contact_sheet(tiles)

    def test_choice_is_even_and_ends_with_the_last(self) -> None:
        assert spread_over(120, 12) == [9, 19, 29, 39, 49, 59, 69, 79, 89, 99, 109, 119]
        assert spread_over(5, 12) == [0, 1, 2, 3, 4]
        assert spread_over(0, 12) == []


class TestVideo:
    def test_plays_back_what_was_written(self, tmp_path: Path) -> None:
        path = tmp_path / 'film.mp4'
        levels = list(range(20, 220, 10))
        with VideoWriter(path, fps=12.5) as video:
            for level in levels:
                video.write(plain((level, level, level), 320, 180))
        assert not video.part_path.exists()
        assert path.read_bytes()[4:8] == b'ftyp', 'an MP4 begins with a file type box (ISO 14496-12)'
        film = cv2.VideoCapture(str(path))
        assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(12.5)
        seen = []
        while (frame := film.read()[1]) is not None:
            assert frame.shape == (180, 320, 3)
            seen.append(float(frame.mean()))
        assert seen == pytest.approx(levels, abs=4.9), 'every frame, in order: levels are 10 apart'

    def test_interrupted_part_stays_and_plays(self, tmp_path: Path) -> None:
        path = tmp_path / 'film.mp4'
        with pytest.raises(KeyboardInterrupt), VideoWriter(path, fps=10) as video:
            for _ in range(5):
                video.write(plain(GREEN))
            raise KeyboardInterrupt
        assert not path.exists()
        assert int(cv2.VideoCapture(str(tmp_path / 'film.part.mp4')).get(cv2.CAP_PROP_FRAME_COUNT)) == 5

    def test_refuses_another_shape(self, tmp_path: Path) -> None:
        with pytest.raises(FrameError, match=r'expected a picture of shape \(100, 200, 3\), got \(50, 200, 3\)'), \
                VideoWriter(tmp_path / 'film.mp4', fps=10) as video:
            video.write(plain(RED))
            video.write(plain(RED, 200, 50))

    def test_refuses_grey(self, tmp_path: Path) -> None:
        with pytest.raises(FrameError, match=r'expected a picture of shape \(H, W, 3\), got \(9, 9\)'), \
                VideoWriter(tmp_path / 'film.mp4', fps=10) as video:
            video.write(np.zeros((9, 9), np.uint8))

    def test_folder_that_is_not_there(self, tmp_path: Path) -> None:
        with pytest.raises(BackendError, match='cannot write mp4v video, or not to this folder'), \
                VideoWriter(tmp_path / 'nowhere' / 'film.mp4', fps=10) as video:
            video.write(plain(RED))


class TestPicture:
    def test_truth_white_and_detection_coloured_each_where_it_is(self) -> None:
        image = plain((90, 90, 90), 640, 360)
        picture = annotate(image, detection(u=420.0, v=130.0, width=80.0, height=60.0), truth_box(100, 50, 60, 40))
        assert (image == 90).all(), 'the image itself is left alone'
        for row, column in ((50, 130), (90, 130), (70, 100), (70, 160)):
            assert picture[row, column].min() > 200, 'white side of the truth box'
        for row, column in ((100, 400), (160, 400), (130, 380), (130, 460)):
            color = picture[row, column].astype(int)
            assert color.max() - color.min() > 60, 'coloured side of the detection'
        assert (picture[70, 130] == 90).all() and (picture[110, 440] == 90).all(), 'boxes are not filled'

    def test_caption_counts(self) -> None:
        """One box exactly on the mover, one far from it; the second mover is missed."""
        truth = np.concatenate([truth_box(100, 50, 60, 40), truth_box(300, 50, 60, 40)])
        found = np.concatenate([detection(130, 70, 60, 40), detection(500, 300, 60, 40, 2)])
        assert caption(7, found, truth) == 'frame 7: 1 of 2 found, 1 false'
        assert caption(8, empty_detections(), truth) == 'frame 8: 0 of 2 found, 0 false'
        assert caption(9, None, truth) == 'frame 9: no answer'
