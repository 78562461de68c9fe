"""Fixtures that every part of the tests may use."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from reliability import (  # noqa: F401 hooks and a fixture
    pytest_addoption,
    pytest_configure,
    pytest_runtest_logreport,
    pytest_sessionfinish,
    shown,
)

from motion_detect_ros.cli.compiled_kernels import compile_missing
from motion_detect_ros.presets import load_preset

# How long an example takes says nothing on a machine that others use too.
settings.register_profile('busy machine', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('busy machine')

REPOSITORY = Path(__file__).resolve().parent.parent


#: Files that take minutes: begun last, they would leave the other processors idle at the end.
LONG = (
    'test_source_nodes.py', 'test_silence.py', 'test_examples.py', 'test_kernel_compiler.py', 'test_live_replay.py',
    'test_pipeline.py', 'test_nodes.py', 'test_demo.py', 'test_tune.py', 'test_console.py', 'test_brightness.py',
    'test_runner.py', 'test_rtsp.py', 'test_imu_topic.py', 'test_selftest.py', 'test_two_writers.py')


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first, the others in their order."""
    order = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: order.get(item.path.name, len(LONG)))


def pytest_sessionstart(session: pytest.Session) -> None:
    """Kernels are compiled before the first test: commands say so on stderr when they have to."""
    if not hasattr(session.config, 'workerinput'):
        compile_missing(load_preset('visdrone'), load_preset('default'))


@pytest.fixture(scope='session')
def clips() -> Path:
    """The folder of real clips; tests that need it are skipped where it is missing."""
    folder = Path(os.environ.get('MOTION_DETECT_DATA', REPOSITORY.parent / 'shared' / 'data'))
    if not (folder / 'clips.json').is_file():
        pytest.skip(f'no clips in {folder}: set MOTION_DETECT_DATA')
    return folder
