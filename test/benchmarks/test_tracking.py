"""The command of the tracking figures; the figures themselves: test/results/test_identity.py."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from motion_detect_ros.benchmarks import tracking


def test_without_the_package(
        monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, 'trackeval', None)
    monkeypatch.delitem(sys.modules, 'trackeval.metrics', raising=False)
    assert tracking.main(['--data', str(tmp_path)]) == 2
    assert 'pip install --no-deps trackeval' in capsys.readouterr().err
