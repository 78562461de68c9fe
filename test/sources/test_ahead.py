"""Iterating ahead in a thread."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from motion_detect_ros.sources.ahead import Ahead


def test_items_come_in_order_and_then_the_end() -> None:
    with Ahead(range(1000)) as items:
        assert list(items) == list(range(1000))


def test_an_error_comes_after_the_items_before_it() -> None:
    def failing() -> Iterator[int]:
        yield from range(5)
        raise OSError('gone')

    seen = []
    with Ahead(failing()) as items, pytest.raises(OSError, match='gone'):
        for item in items:
            seen.append(item)
    assert seen == [0, 1, 2, 3, 4]


def test_it_is_never_further_ahead_than_its_depth() -> None:
    made: list[int] = []

    def counted() -> Iterator[int]:
        for number in range(20):
            made.append(number)
            yield number

    with Ahead(counted(), depth=3) as items:
        for item in items:
            assert len(made) <= item + 1 + 3 + 1  # three wait, one is in hand


def test_leaving_ends_the_thread_of_an_endless_iteration() -> None:
    def endless() -> Iterator[int]:
        number = 0
        while True:
            yield number
            number += 1

    before = threading.active_count()
    with Ahead(endless()) as items:
        assert next(iter(items)) == 0
    assert threading.active_count() == before


def test_two_run_at_once() -> None:
    """Each of the two waits for the other's next item: one after the other they would never end."""
    met = threading.Barrier(2, timeout=60)

    def meeting() -> Iterator[int]:
        for number in range(10):
            met.wait()
            yield number

    with Ahead(meeting()) as items:
        for expected in range(10):
            met.wait()
            assert next(iter(items)) == expected
