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

# How long an example takes says nothing on a machine that others use too.
settings.register_profile('busy machine', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('busy machine')

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope='session')
def clips() -> Path:
    """The folder of real clips; tests that need it are skipped where it is missing."""
    folder = Path(os.environ.get('MOTION_DETECT_DATA', REPOSITORY.parent / 'shared' / 'data'))
    if not (folder / 'clips.json').is_file():
        pytest.skip(f'no clips in {folder}: set MOTION_DETECT_DATA')
    return folder
