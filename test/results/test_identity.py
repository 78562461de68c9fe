"""Tracking figures against cases worked by hand; TrackEval itself is an optional package."""

from __future__ import annotations

import numpy as np
import pytest

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import TRUTH_DTYPE, RecordArray, empty_detections
from motion_detect_ros.results.identity import TrackScore, score_tracks, sequence, table
from motion_detect_ros.results.metrics import frame_count

FRAMES = 10


def truth_of(*rows: tuple[int, int, float, int]) -> RecordArray:
    """Squares of 10 px in one row of the image, from (frame, id, x, moving)."""
    return np.array([(frame, ident, x, 0, 10, 10, moving) for frame, ident, x, moving in rows], TRUTH_DTYPE)


def detection(ident: int, x: float) -> RecordArray:
    record = empty_detections(1)
    record['id'], record['u'], record['v'], record['width'], record['height'] = ident, x + 5, 5, 10, 10
    return record


ONE_MOVER = truth_of(*((frame, 7, 20.0 * frame, 1) for frame in range(FRAMES)))


def scored(truth: RecordArray, found: dict[int, RecordArray], skip: int = 0) -> TrackScore:
    pytest.importorskip('trackeval', reason='pip install --no-deps trackeval')
    return score_tracks(sequence(truth, found, range(skip, frame_count(truth, found)), (1,)))


class TestSequence:
    def test_numbers_and_counts(self) -> None:
        """Skipped frames, standing and ignored objects, and what lies on them, are left out."""
        truth = truth_of((0, 9, 0, 1), (1, 5, 0, 1), (1, 8, 100, 0), (1, 6, 200, -1), (2, 5, 0, 1))
        found = {0: detection(1, 0), 1: np.concatenate([detection(40, 0), detection(41, 200)]), 2: detection(42, 5)}
        data = sequence(truth, found, range(1, 3), (1,))
        assert data['num_timesteps'] == 2
        assert (data['num_gt_ids'], data['num_tracker_ids']) == (1, 2), 'id 9 only in a skipped frame, 41 ignored'
        assert (data['num_gt_dets'], data['num_tracker_dets']) == (2, 2)
        assert [ids.tolist() for ids in data['tracker_ids']] == [[0], [1]]
        assert data['similarity_scores'][0].tolist() == [[1.0]]
        assert data['similarity_scores'][1].tolist() == [[pytest.approx(1 / 3)]]

    def test_empty_frames_have_empty_matrices(self) -> None:
        data = sequence(truth_of((0, 1, 0, 1), (2, 1, 0, 1)), {1: detection(1, 0)}, range(3), (1,))
        assert [matrix.shape for matrix in data['similarity_scores']] == [(1, 0), (0, 1), (1, 0)]


    @pytest.mark.parametrize('rows', [[(0, 4, 0, 1), (0, 4, 100, 1)], [(0, -1, 0, 1)]])
    def test_truth_whose_ids_do_not_tell_objects_apart(self, rows: list[tuple[int, int, float, int]]) -> None:
        with pytest.raises(SourceError, match=r'id from 0 on for each object of the truth.*, got (4 2|-1 1) times in'):
            sequence(truth_of(*rows), {}, range(1), (1,))

    def test_detections_with_an_id_twice_in_a_frame(self) -> None:
        found = {3: np.concatenate([detection(40, 0), detection(40, 200)])}
        with pytest.raises(SourceError, match='detections, each once in a frame, got 40 2 times in frame 3'):
            sequence(ONE_MOVER, found, range(FRAMES), (1,))

    def test_ids_count_from_0(self) -> None:
        truth, found = truth_of((0, 0, 0, 1), (0, 1, 100, 1)), np.concatenate([detection(0, 0), detection(1, 100)])
        data = sequence(truth, {0: found}, range(1), (1,))
        assert (data['num_gt_ids'], data['num_tracker_ids']) == (2, 2)
        assert (data['gt_ids'][0].tolist(), data['tracker_ids'][0].tolist()) == ([0, 1], [0, 1])

    def test_an_id_twice_where_it_does_not_count(self) -> None:
        truth = truth_of((0, 4, 0, 1), (0, 4, 100, -1), (0, 4, 200, -1))
        assert sequence(truth, {}, range(1), (1,))['num_gt_ids'] == 1


class TestScore:
    def test_perfect(self) -> None:
        found = {frame: detection(3, 20.0 * frame) for frame in range(FRAMES)}
        assert scored(ONE_MOVER, found) == TrackScore(1, 1, 1, 1, 1, 0, 1, 1)

    def test_a_new_id_half_way(self) -> None:
        """Each half is a track of 5 of 10 frames: AssA = 5 / 10, HOTA = sqrt(1 * 0.5), IDF1 = 2 * 5 / (10 + 10)."""
        found = {frame: detection(3 if frame < 5 else 4, 20.0 * frame) for frame in range(FRAMES)}
        score = scored(ONE_MOVER, found)
        assert (score.detection, score.association, score.switches) == (1.0, 0.5, 1)
        assert score.hota == pytest.approx(0.5 ** 0.5)
        assert (score.idf1_30, score.idf1_50) == (0.5, 0.5)

    def test_missed_in_half_of_the_frames(self) -> None:
        """DetA = 5 / 10, AssA = 5 / 10; IDF1 = 2 * 5 / (10 + 5)."""
        score = scored(ONE_MOVER, {frame: detection(3, 20.0 * frame) for frame in range(5)})
        assert (score.detection, score.association, score.mostly) == (0.5, 0.5, 0)
        assert score.idf1_30 == pytest.approx(2 / 3)

    def test_loose_boxes_count_at_the_loose_iou_only(self) -> None:
        """Shifted by half: IoU 1/3."""
        score = scored(ONE_MOVER, {frame: detection(3, 20.0 * frame + 5) for frame in range(FRAMES)})
        assert (score.idf1_30, score.idf1_50) == (1.0, 0.0)


def test_table_has_the_mean() -> None:
    rows = table({
        'a': TrackScore(0.4, 0, 0, 0.5, 0.1, 3, 1, 4), 'b': TrackScore(0.6, 0, 0, 0.7, 0.3, 4, 2, 6)})
    assert rows[2] == '| `a` | 0.40 | 0.00 | 0.00 | 0.50 | 0.10 | 3 | 1 of 4 |'
    assert rows[4] == '| mean of 2 | 0.50 | 0.00 | 0.00 | 0.60 | 0.20 | 3.5 | 1.5 of 5 |'
