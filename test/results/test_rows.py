"""The rows of the CSV files, against lines worked by hand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.types import EgoMotion, EgoStatus, FlowField, Result, StageTimes, empty_detections
from motion_detect_ros.results.rows import affine_part, csv_rows, frames_row, times_row


def result(matrix: np.ndarray, status: EgoStatus = EgoStatus.OK) -> Result:
    ego = EgoMotion(matrix, np.full((6, 6), np.nan), status, 40, 0)
    flow = FlowField(np.zeros((3, 4, 2), np.float32), 400, 300, 40)
    return Result(40, ego, flow, empty_detections(2), StageTimes(1.5, 2.25, 4.0, 0.125))


def test_csv_rows_by_hand() -> None:
    records = empty_detections(2)
    records[['u', 'v', 'width', 'height', 'score', 'id']] = [(50.5, 20, 11, 4, 0.25, 7), (1, 2, 3, 4, 1, 4294967295)]
    records['ttc'] = np.inf, np.nan
    records['vel_v'] = 0.0, -1.5
    assert csv_rows(3, 99, records) == [
        '3,99,7,45.00000,18.00000,11.00000,4.00000,0.25000,0.00000,0.00000,inf',
        '3,99,4294967295,-0.50000,0.00000,3.00000,4.00000,1.00000,0.00000,-1.50000,nan']
    assert csv_rows(3, 99, records[:0]) == []


def test_frames_row_by_hand() -> None:
    matrix = np.array([[1.5, 0.25, -3.0], [0.0, 0.75, 2.0], [0.0, 0.0, 1.0]])
    assert frames_row(3, result(matrix)) == (
        '3,40,ok,1.500000000,0.250000000,-3.000000000,0.000000000,0.750000000,2.000000000,2')


def test_a_frame_without_ego_motion_has_empty_cells() -> None:
    assert frames_row(0, result(np.eye(3), EgoStatus.LOW_TEXTURE)) == '0,40,low_texture,,,,,,,2'


def test_times_row_by_hand() -> None:
    assert times_row(3, 10.0, result(np.eye(3))) == '3,10.000,1.500,2.250,4.000,0.125,7.875'


def test_affine_part_of_a_homography_maps_its_neighbourhood_of_the_centre() -> None:
    """OpenCV's perspectiveTransform of points 1 px around the centre of a 401 x 301 image."""
    matrix = np.array([[1.02, 0.01, -3.0], [-0.02, 0.97, 2.0], [1e-4, -2e-4, 1.0]])
    ego = EgoMotion(matrix, np.full((6, 6), np.nan), EgoStatus.OK, 40, 0)
    near = np.array([[200.0, 150.0], [201.0, 150.0], [200.0, 151.0], [199.0, 149.0]])
    affine = affine_part(ego, 401, 301)
    mapped = cv2.perspectiveTransform(near[None], matrix)[0]
    assert near @ affine[:, :2].T + affine[:, 2] == pytest.approx(mapped, abs=1e-3)
    assert affine[:, :2] @ near[0] + affine[:, 2] == pytest.approx(mapped[0], abs=1e-9)
