"""``replay`` ends with a report, unless told not to or where it cannot be made."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
from results_by_hand import FRAMES, write_pictures

from motion_detect_ros.__main__ import main
from motion_detect_ros.report import embedding, make


@pytest.fixture(scope='module')
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pictures(tmp_path_factory.mktemp('input') / 'pictures')


def test_report_is_there_at_the_end(source: Path, tmp_path: Path):
    for library in embedding.NEEDED:
        pytest.importorskip(library, reason=f'{library} is not installed (extra "report")')
    assert main(['replay', str(source), '-o', str(tmp_path / 'out'), '--start', '1', '--every', '2']) == 0
    page = (tmp_path / 'out' / 'report.html').read_text(encoding='utf-8')
    assert 'id="film-bytes"' in page, 'the pictures were found again'
    assert 'from 1 s' in page
    assert 'one of 2 frames' in page


def test_no_report_on_request(source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out' / 'report.html').write_text('of an earlier replay')
    assert main(['replay', str(source), '-o', str(tmp_path / 'out'), '--no-report', '--duration', '1']) == 0
    assert (tmp_path / 'out' / 'summary.json').is_file()
    assert not (tmp_path / 'out' / 'report.html').exists()
    assert 'report' not in capsys.readouterr().err


def test_missing_library_costs_the_report_only(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setitem(embedding.NEEDED, 'no_such_library', 'no-such-library')
    assert main(['replay', str(source), '-o', str(tmp_path / 'out'), '--duration', '1']) == 0
    printed = capsys.readouterr()
    (line,) = [line for line in printed.err.splitlines() if 'report' in line]
    assert line.startswith('no report.html: expected ')
    assert line.partition(', not installed: pip install ')[2].split()[-1] == 'no-such-library'
    assert ': 25 frames' in printed.out, 'a second of 25 frames'
    assert not (tmp_path / 'out' / 'report.html').exists()


@pytest.mark.parametrize(('error', 'said'), [
    (OSError(errno.ENOSPC, 'No space left on device'), '[Errno 28] No space left on device'),
    (KeyError('defect'), "KeyError: 'defect'")])
def test_report_that_cannot_be_made_costs_no_results(
    error: Exception, said: str, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    for library in embedding.NEEDED:
        pytest.importorskip(library, reason=f'{library} is not installed (extra "report")')

    def full(path: Path, text: str) -> None:
        raise error

    monkeypatch.setattr(make, 'write_whole', full)
    assert main(['replay', str(source), '-o', str(tmp_path / 'out')]) == 0
    assert (tmp_path / 'out' / 'detections.csv').is_file()
    line = capsys.readouterr().out
    assert f'{FRAMES} frames' in line
    assert line.endswith(f'; no report.html: {said}\n')
