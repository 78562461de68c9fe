"""Writes docs/reliability.md from the tests that show what it says: ``pytest --reliability docs/reliability.md``."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

Shown = Callable[[str, str, str], None]
Row = tuple[str, str, str, str]

HEAD = """# Reliability

What was done to the nodes and commands from outside, what they have to do then, and what they did in the last test run
(`make reliability`): real processes over DDS, real files. A row is there only where its test passed.
"""
TABLE = '| fault | criterion | figure | test |\n|---|---|---|---|\n'
#: What stands below the table is written by hand and stays.
MARK = '\n## Not tried\n'
ROWS = pytest.StashKey[list[Row]]()
_failed: set[str] = set()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption('--reliability', metavar='PAGE', help='write the table of faults to this page')


def pytest_configure(config: pytest.Config) -> None:
    config.stash[ROWS] = []


@pytest.fixture
def shown(request: pytest.FixtureRequest) -> Shown:
    """``shown(fault, criterion, figure)``: a row of the page, where the test passes; the first two are literals."""
    def add(fault: str, criterion: str, figure: str) -> None:
        request.config.stash[ROWS].append((fault, criterion, figure, request.node.nodeid))
    return add


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed:
        _failed.add(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    page = session.config.getoption('--reliability')
    if page:
        path = Path(page)
        kept = path.read_text(encoding='utf-8').partition(MARK)[2] if path.is_file() else ''
        path.write_text(f'{HEAD}\n{TABLE}{"".join(table(session.config.stash[ROWS]))}{MARK}{kept}', encoding='utf-8')


def table(rows: list[Row]) -> Iterator[str]:
    """The rows of tests that passed; the figures of one fault and criterion in one row."""
    merged: dict[tuple[str, str, str], list[str]] = {}
    for fault, criterion, figure, test in rows:
        if test not in _failed:
            file = test.partition('::')[0].removeprefix('test/')
            figures = merged.setdefault((fault, criterion, file), [])
            figures += [figure] * (figure not in figures)
    for (fault, criterion, file), figures in merged.items():
        yield f'| {fault} | {criterion} | {"; ".join(figures)} | `{file}` |\n'


def rows_of_tests(folder: Path) -> set[tuple[str, str]]:
    """(fault, criterion) of every call of ``shown`` in the tests."""
    found = set()
    for path in folder.rglob('test_*.py'):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'shown':
                fault, criterion = (ast.literal_eval(word) for word in node.args[:2])
                found.add((fault, criterion))
    return found
