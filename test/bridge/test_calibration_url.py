"""Calibrations where camera drivers look for them."""

from __future__ import annotations

from pathlib import Path

import pytest
from std_msgs.msg import Header

from motion_detect_ros.bridge.calibration_url import calibration_at, calibration_to_msg
from motion_detect_ros.core.errors import SourceError

GOOD = """
image_width: 640
image_height: 480
camera_matrix: {data: [1, 0, 2, 0, 3, 4, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {data: [0.1, 0.2, 0, 0, 0.3]}
rectification_matrix: {data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {data: [5, 0, 6, 0, 0, 7, 8, 0, 0, 0, 1, 0]}
"""


def test_files_and_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    share = tmp_path / 'share'
    (share / 'my_robot').mkdir(parents=True)
    (share / 'ament_index' / 'resource_index' / 'packages').mkdir(parents=True)
    (share / 'ament_index' / 'resource_index' / 'packages' / 'my_robot').touch()
    (share / 'my_robot' / 'lens.yaml').write_text(GOOD)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    found = calibration_at(f'file://{share}/my_robot/lens.yaml')
    assert calibration_at('package://my_robot/lens.yaml') == found
    info = calibration_to_msg(found, Header(frame_id='eye'))
    assert (info.header.frame_id, info.width, info.height, list(info.d)) == ('eye', 640, 480, [0.1, 0.2, 0, 0, 0.3])
    assert (list(info.k), info.p[2]) == ([1, 0, 2, 0, 3, 4, 0, 0, 1], 6.0)


@pytest.mark.parametrize(('url', 'content', 'words'), [
    ('http://a/lens.yaml', GOOD, 'camera_info_url: expected file:// or package://'),
    ('package://no_such_package/lens.yaml', GOOD, "expected an installed package, got 'no_such_package'"),
    ('file:///nowhere.yaml', GOOD, '^/nowhere.yaml: expected a calibration, got No such file or directory$'),
    ('file://{}', 'x', r'expected a calibration \(image_width'),
    ('file://{}', GOOD.replace('image_width: 640', ''), 'calibration with image_width, which is missing$'),
    ('file://{}', GOOD.replace('[1, 0, 2, 0, 3, 4, 0, 0, 1]', '[1, 2]'), 'camera_matrix: expected 9 values, got 2'),
    ('file://{}', '{', 'expected a calibration'),
    *[('file://{}', GOOD.replace('640', width), rf'image_width: expected a whole number of pixels, got {got}$')
      for width, got in (('.inf', 'inf'), ('.nan', 'nan'), ('-5', '-5'), ('99999999999', '99999999999'),
                         ('1.5', '1.5'), ('wide', "'wide'"), ('1' + '0' * 400, '10+'), ('[640]', r'\[640\]'))],
    ('file://{}', GOOD.replace('640', '0001-99-99'), 'expected a calibration, got month must be in 1..12'),
    ('file://{}', '[' * 2000 + ']' * 2000, 'expected a calibration, got maximum recursion depth exceeded'),
    ('file://{}', GOOD.replace('[5, 0, 6', '[1' + '0' * 400 + ', 0, 6'), 'OverflowError: int too large'),
])
def test_what_is_no_calibration_is_refused_in_one_line(url: str, content: str, words: str, tmp_path: Path):
    file = tmp_path / 'lens.yaml'
    file.write_text(content)
    with pytest.raises(SourceError, match=words) as caught:
        calibration_at(url.format(file))
    assert '\n' not in str(caught.value)
