"""A report against the labels of the whole sequence, of a replay that had a part of its pictures."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest
from results_by_hand import FRAMES, OBJECTS, box_of, picture, write_results

from motion_detect_ros.report.judged import judge
from motion_detect_ros.report.replayed import read_replayed

FIRST = 101


@pytest.mark.parametrize('moved', [False, True])
def test_labels_go_by_the_names_of_the_pictures(tmp_path: Path, moved: bool) -> None:
    """All three objects are labelled wherever they are detected, and one more after the last picture."""
    (tmp_path / 'excerpt').mkdir()
    for frame in range(FRAMES):
        assert cv2.imwrite(str(tmp_path / 'excerpt' / f'{FIRST + frame:07d}.png'), picture(frame))
    rows = [(FIRST + frame, identity, *box_of(identity, frame))
            for identity, (frames, _) in OBJECTS.items() for frame in frames]
    rows.append((FIRST + FRAMES, 50, 0, 0, 9, 9))
    labels = tmp_path / 'annotation.txt'
    labels.write_text(''.join(f'{",".join(map(str, row))},1,4,0,0\n' for row in rows))
    results = write_results(tmp_path / 'results', str(tmp_path / ('earlier' if moved else 'excerpt')))
    judged = judge(read_replayed(results), labels, str(tmp_path / 'excerpt') if moved else None)
    assert (judged.main.wanted, judged.main.f1) == (20 + 27 + 4, 1.0), 'of the frames from 10 on'
    assert judged.main.frames == FRAMES - 10
