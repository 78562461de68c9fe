"""What a report is made of, damaged: one line that names the file."""

from __future__ import annotations

from pathlib import Path

import pytest
from results_by_hand import write_results

from motion_detect_ros.__main__ import main
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.report.replayed import read_replayed


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return write_results(tmp_path / 'results', 'nowhere')


@pytest.mark.parametrize('name', ['detections.csv', 'frames.csv', 'times.csv'])
@pytest.mark.parametrize(('damage', 'message'), [
    (b'\xff\xfe', r"line \d+: 'utf-8' codec can't decode byte 0xff"),
    (b'9' * 131073, r'line 3: field larger than field limit'),
])
def test_tables(results: Path, name: str, damage: bytes, message: str) -> None:
    header, first, *rest = (results / name).read_bytes().splitlines()
    (results / name).write_bytes(b'\n'.join([header, first, damage, *rest]))
    with pytest.raises(SourceError, match=rf'{name}, {message}') as caught:
        read_replayed(results)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('damage', [b'\xff\xfe', b'9' * 131073])
def test_headers(results: Path, damage: bytes) -> None:
    (results / 'detections.csv').write_bytes(damage + (results / 'detections.csv').read_bytes())
    with pytest.raises(SourceError, match=r'detections\.csv, line [01]: '):
        read_replayed(results)


def test_summary_without_times(tmp_path: Path) -> None:
    folder = write_results(tmp_path / 'results', 'nowhere', stage_ms={})
    with pytest.raises(SourceError, match=r"summary\.json: expected the summary of a replay, got KeyError: 'prep"):
        read_replayed(folder)


def test_summary_nested_too_deep(results: Path) -> None:
    (results / 'summary.json').write_text('[' * 100_000)
    with pytest.raises(SourceError, match=r'summary\.json: expected the summary of a replay, got RecursionError'):
        read_replayed(results)


def test_a_byte_order_mark_is_nothing_wrong(results: Path) -> None:
    whole = read_replayed(results)
    for name in ('detections.csv', 'frames.csv', 'times.csv'):
        (results / name).write_text((results / name).read_text(), encoding='utf-8-sig')
    read = read_replayed(results)
    assert read.boxes['x'].tolist() == whole.boxes['x'].tolist()
    assert (len(read.frames), len(read.times)) == (len(whole.frames), len(whole.times))


@pytest.mark.parametrize('words', [[], ['index']], ids=['report', 'index'])
def test_a_report_replaces_reports_only(
    results: Path, tmp_path: Path, words: list[str], capsys: pytest.CaptureFixture[str],
):
    pytest.importorskip('plotly', reason="pip install 'motion_detect_ros[report]'")
    mine = tmp_path / 'mine.html'
    mine.write_text('<!DOCTYPE html><html><head><title>Flights: moving objects</title></head></html>')
    for file in (mine, results / 'summary.json', results / 'detections.csv'):
        before = file.read_bytes()
        assert main(['report', *words, str(results), '-o', str(file)]) == 2
        assert capsys.readouterr().err == f'error: {file}: exists and is no earlier report; choose another --output\n'
        assert file.read_bytes() == before
    assert main(['report', *words, str(results), '-o', str(tmp_path)]) == 2
    assert capsys.readouterr().err == f'error: {tmp_path}: expected a file to write, got a folder\n'
    for _ in range(2):
        assert main(['report', *words, str(results), '-o', str(tmp_path / 'page.html')]) == 0


def test_a_page_of_ones_own_is_not_replaced_by_default(results: Path, capsys: pytest.CaptureFixture[str]):
    pytest.importorskip('plotly', reason="pip install 'motion_detect_ros[report]'")
    for name, words in (('report.html', []), ('index.html', ['index'])):
        (results / name).write_text('<title>mine</title>')
        assert main(['report', *words, str(results)]) == 2
        assert capsys.readouterr().err.startswith(f'error: {results / name}: exists and is no earlier report')
        assert (results / name).read_text() == '<title>mine</title>'
