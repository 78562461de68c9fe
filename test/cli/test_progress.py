"""Bars on a terminal, lines elsewhere."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from motion_detect_ros.cli.progress import PLAIN_EVERY, Board, track


def test_lines_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]):
    count = 2 * PLAIN_EVERY + 3
    assert list(track(range(count), count, 'draw')) == list(range(count))
    assert capsys.readouterr().err == f'draw: {PLAIN_EVERY} of {count}\ndraw: {2 * PLAIN_EVERY} of {count}\n'
    with Board(2) as board:
        for done in range(1, count + 1):
            board.advance('flight', done, None)
        board.end('flight')
        board.say('flight: done')
    captured = capsys.readouterr()
    assert captured.err == f'flight: {PLAIN_EVERY}\nflight: {2 * PLAIN_EVERY}\n'
    assert captured.out == 'flight: done\n'


def test_few_items_say_nothing(capsys: pytest.CaptureFixture[str]):
    assert len(list(track(range(20), 20, 'draw'))) == 20
    assert capsys.readouterr() == ('', '')


def test_frames_that_a_window_skips_do_not_hide_lines(capsys: pytest.CaptureFixture[str]):
    with Board(1) as board:
        for done in (7, PLAIN_EVERY + 7, 3 * PLAIN_EVERY + 1):
            board.advance('flight', done, 3 * PLAIN_EVERY + 1)
    assert [line.split()[1] for line in capsys.readouterr().err.splitlines()] == [
        str(PLAIN_EVERY), str(3 * PLAIN_EVERY)]


def test_a_bar_for_each_input_and_one_over_all():
    console = Console(file=io.StringIO(), force_terminal=True, width=100, color_system=None)
    with Board(3, console) as board:
        board.advance('first', 10, 40)
        board.advance('second', 39, 40)
        board._bars.refresh()
        shown = console.file.getvalue().splitlines()[-3:]
        assert ['inputs' in shown[0], 'first' in shown[1], 'second' in shown[2]] == [True] * 3
        assert ['0/3' in shown[0], '10/40' in shown[1], '39/40' in shown[2]] == [True] * 3
        board.end('second')
        board._bars.refresh()
        last = console.file.getvalue().splitlines()[-2:]
        assert '1/3' in last[0] and '10/40' in last[1]
        board.restart('first')
        board.advance('first', 2, 40)
        board._bars.refresh()
        assert '2/40' in console.file.getvalue().splitlines()[-1]


def test_one_input_has_one_bar():
    console = Console(file=io.StringIO(), force_terminal=True, width=100, color_system=None)
    with Board(1, console) as board:
        board.advance('[red]odd[/red]', 1, 4)
        board._bars.refresh()
    assert 'inputs' not in console.file.getvalue()
    assert '[red]odd[/red]' in console.file.getvalue()


def test_late_news_of_an_input_that_has_ended_is_ignored(capsys: pytest.CaptureFixture[str]):
    with Board(2) as board:
        board.advance('flight', PLAIN_EVERY, None)
        board.end('flight')
        board.advance('flight', 2 * PLAIN_EVERY, None)
        board.advance('other', PLAIN_EVERY, None)
    assert capsys.readouterr().err == f'flight: {PLAIN_EVERY}\nother: {PLAIN_EVERY}\n'
