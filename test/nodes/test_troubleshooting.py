"""docs/troubleshooting.md: what it quotes stands in the code, and the symptoms come when they are provoked.

Provoked elsewhere: lost links (test_rtsp.py), drops, lag, damaged bags and waiting players (test_health.py), devices
that do not open (test/integration/test_nodes.py), stamps that go back (test_stage_nodes.py).
"""

from __future__ import annotations

import ast
import itertools
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from peers import image_message, picture, ready, small
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from motion_detect_ros.bridge.images import camera_to_msg, header_of, image_to_msg
from motion_detect_ros.bridge.records import read_detections
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import settings, with_settings
from motion_detect_ros.core.types import CameraModel, EgoStatus

pytestmark = pytest.mark.messages

REPOSITORY = Path(__file__).resolve().parents[2]
PAGE = (REPOSITORY / 'docs' / 'troubleshooting.md').read_text(encoding='utf-8')
#: Names of values, topics and files; not what a node says.
NO_MESSAGE = re.compile(r'[\w.~/*-]+(:=.*|: .*)?|OK')


def templates() -> Iterator[str]:
    """Every text in the package, with a zero character for each thing that is filled in."""
    for path in (REPOSITORY / 'motion_detect_ros').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield node.value
            elif isinstance(node, ast.JoinedStr):
                yield ''.join(part.value if isinstance(part, ast.Constant) else '\0' for part in node.values)


def messages() -> list[str]:
    """What the page says that a node says: quoted words in the first column, less names."""
    cells = [line.split('|')[1] for line in PAGE.splitlines() if line.startswith('| ')]
    return [quoted for cell in cells for quoted in re.findall(r'`([^`]+)`', cell) if not NO_MESSAGE.fullmatch(quoted)]


def test_the_page_quotes_messages():
    assert {'nothing received yet', 'N dropped since the last report'} <= set(messages())
    assert len(messages()) > 12


@pytest.mark.parametrize('message', [each for each in messages() if each != 'Failed to create segment'])
def test_quoted_message_stands_in_the_code(message: str):
    """Whole, or as the beginning of a longer one."""
    filled = re.compile(re.sub(r'\b(N|NAME|SOURCE|TEXT|TOPICS)\b', '\0', re.escape(message)))
    assert any(filled.match(template) or re.fullmatch(re.escape(template).replace('\0', '.+'), message)
               for template in templates() if len(re.sub(r'\W', '', template)) > 5), message


def test_settings_named_by_the_page_exist():
    known = {name for name, _, _ in settings(PipelineConfig())}
    groups = {name.split('.')[0] for name in known}
    named = {name for name in re.findall(r'`(\w+\.\w+)', PAGE) if name.split('.')[0] in groups}
    assert {'background.model', 'preprocessing.max_width_px'} <= named
    assert named - known == set()
    statuses = re.findall(r'`([A-Z]+_[A-Z]+)`', PAGE)
    assert statuses
    assert set(statuses) <= {each.name for each in EgoStatus}


def test_silence_wrong_qos_missing_calibration_and_blank_images(peer, start):
    start('pipeline', *small('image_reliability:=reliable'))
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    answers = peer.subscribe(PointCloud2, 'detections')
    status = lambda: reports[-1].status[0] if reports else DiagnosticStatus()  # noqa: E731

    assert peer.until(lambda: status().message == 'nothing received yet')
    weak = peer.advertise(Image, 'image_raw', best_effort=True)
    assert peer.until(lambda: peer.node.count_subscribers('image_raw') == 1)
    for index in range(5):
        weak.publish(image_message(index))
        peer.rest(0.3)
    assert len(answers) == 0
    assert 'a publisher of /image_raw offers another reliability than RELIABLE' in status().message

    publisher, infos = peer.advertise(Image, 'image_raw'), peer.advertise(CameraInfo, 'camera_info')
    assert ready(peer, 'image_raw')

    def detection_of(index: int) -> np.ndarray:
        wanted = len(answers) + 1
        publisher.publish(image_message(index))
        assert peer.until(lambda: len(answers) >= wanted)
        return read_detections(answers[-1])

    found = [detection_of(index) for index in range(12)]
    assert len(found[-1]) == 1
    assert math.isnan(found[-1]['bearing_z'][0])
    infos.publish(camera_to_msg(CameraModel(320, 240, 300.0, 300.0, 160.0, 120.0), 320, 240, header_of(0, 'front')))
    later = itertools.count(12)
    while not np.isfinite(detection_of(index := next(later))['bearing_z']).all():
        assert index < 35

    for after in range(1, 4):
        publisher.publish(image_to_msg(np.full((240, 320, 3), 90, np.uint8),
                                       header_of((index + 1 + after) * 100_000_000, 'front')))
    assert peer.until(lambda: ('status', 'LOW_TEXTURE') in {(pair.key, pair.value) for pair in status().values})


def objects_per_frame(images: list[np.ndarray], **values: object) -> float:
    """Objects in each of ``images``, 10 a second, after the first ten; values: settings, ``__`` for the point."""
    given = {name.replace('__', '.'): value for name, value in values.items()}
    pipeline = MotionPipeline(with_settings(PipelineConfig(), given))
    counts = [len(pipeline.process(image, (index + 1) * 100_000_000).detections) for index, image in enumerate(images)]
    return float(np.mean(counts[10:]))


def hide_block(image: np.ndarray, index: int) -> None:
    """Ground in place of the block of ``picture(index)``."""
    image[90:140, 30 + 5 * index:90 + 5 * index] = image[160:210, 30 + 5 * index:90 + 5 * index]


def test_what_is_fixed_to_the_camera_moves_until_it_is_masked():
    """The block, drawn at one place while the ground drifts: landing gear."""
    gear = picture(0)[90:140, 30:90]
    images = [picture(index) for index in range(25)]
    for index, image in enumerate(images):
        hide_block(image, index)
        image[20:70, 200:260] = gear
    assert objects_per_frame(images) > 0.8
    assert objects_per_frame(images, preprocessing__ignore_regions='190,10,80,70') < 0.3


def test_a_mast_moves_for_a_planar_background_only():
    """The camera travels to the right: the ground drifts by 2 px a frame, a mast by 6, as near things do."""
    mast = np.kron(np.random.default_rng(3).integers(0, 256, (48, 12), np.uint8), np.ones((5, 5), np.uint8))
    images = []
    for index in range(25):
        image = picture(index)
        hide_block(image, index)
        image[:, 240 - 6 * index:300 - 6 * index] = mast[:, :, None]
        images.append(image)
    planar, epipolar = (objects_per_frame(images, background__model=model) for model in ('planar', 'epipolar'))
    assert planar > 0.8
    assert epipolar < planar / 2
