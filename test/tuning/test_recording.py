"""What is tuned on: the frames that ``replay`` would process, and the labels of its pictures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.tuning.objective import AgreementObjective, TruthObjective
from motion_detect_ros.tuning.recording import Recording, load


def pictures(folder: Path, numbers: range) -> Path:
    """Grey pictures named by their numbers; nothing moves in them."""
    folder.mkdir()
    for number in numbers:
        assert cv2.imwrite(str(folder / f'{number:07d}.png'), np.full((96, 128), 90, np.uint8))
    return folder


def test_labels_of_an_excerpt_go_by_the_names_of_its_pictures(tmp_path: Path) -> None:
    folder = pictures(tmp_path / 'excerpt', range(101, 121))
    labels = tmp_path / 'annotation.txt'
    labels.write_text(''.join(f'{number},1,10,20,8,8,1,4,0,0\n' for number in range(114, 200)))
    counts = TruthObjective('moving', 0.3).measure(Recording(str(folder), labels), PipelineConfig())
    assert counts.tolist() == [[0, 0, 0]] * 3 + [[0, 0, 1]] * 7, 'from picture 111 on, after the warm-up'


@pytest.mark.parametrize('objective', [TruthObjective('moving', 0.3), AgreementObjective(0.3)])
def test_frames_that_the_settings_leave_out_do_not_count(
    tmp_path: Path, objective: TruthObjective | AgreementObjective,
) -> None:
    """2 of 5: of 60 pictures 24, without the 10 of each warm-up."""
    folder = pictures(tmp_path / 'flight', range(60))
    labels = tmp_path / 'truth.csv'
    labels.write_text('frame,id,x,y,w,h,moving\n' + ''.join(f'{frame},1,10,20,8,8,1\n' for frame in range(60)))
    config = with_settings(PipelineConfig(), {'load.decimation_keep': 2, 'load.decimation_of': 5})
    counts = objective.measure(Recording(str(folder), labels), config)
    assert len(counts) == (24 - 10 if isinstance(objective, TruthObjective) else 24 - 10 - 10)
    assert [picture.index for picture in load(Recording(str(folder)), config).pictures] == [
        frame for frame in range(60) if frame % 5 < 2]
