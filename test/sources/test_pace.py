"""When recorded messages are due: the order of things, whatever the speed of the machine."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from motion_detect_ros.core.types import NANOSECONDS
from motion_detect_ros.sources.pace import Pace

START_NS = 1_600_000_000 * NANOSECONDS
#: Far longer than any test may take.
HOUR_NS = 3600 * NANOSECONDS
PATIENCE_S = 300.0


def later(action: Callable[[], None]) -> threading.Timer:
    timer = threading.Timer(0.05, action)
    timer.start()
    return timer


def begun(rate: float = 1.0) -> Pace:
    pace = Pace(rate)
    pace.begin(START_NS)
    return pace


class Clock:
    """In place of the steady clock of the module, moved by hand; waits pass at once and move it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._now_ns = 77 * NANOSECONDS
        monkeypatch.setattr('motion_detect_ros.sources.pace.time', self)

    def monotonic_ns(self) -> int:
        return self._now_ns

    def go_on(self, seconds: float) -> None:
        self._now_ns += round(seconds * NANOSECONDS)

    def begun(self, rate: float = 1.0) -> Pace:
        pace = begun(rate)
        pace._changed.wait = self.go_on
        return pace


def test_what_lies_in_the_past_is_due_and_late():
    assert begun().wait(START_NS - HOUR_NS) == pytest.approx(3600.0, abs=PATIENCE_S)
    assert begun(rate=2.0).wait(START_NS - HOUR_NS) == pytest.approx(1800.0, abs=PATIENCE_S)


def test_a_message_is_not_due_before_its_time():
    pace = begun()
    for ms in (10, 20, 30):
        late_s = pace.wait(START_NS + ms * 1_000_000)
        assert late_s is not None
        assert late_s >= 0.0


def test_a_higher_rate_shortens_a_wait_that_has_begun():
    pace = begun()
    later(lambda: pace.steer(rate=1e6))
    assert pace.wait(START_NS + HOUR_NS) is not None


def test_nothing_is_due_while_paused():
    pace = begun()
    pace.steer(paused=True)
    assert pace.paused
    resumed = threading.Event()
    later(lambda: (resumed.set(), pace.steer(paused=False)))
    assert pace.wait(START_NS - 1) is not None
    assert resumed.is_set()


def test_a_rate_set_while_paused_holds_after_it():
    pace = begun()
    pace.steer(paused=True)
    pace.steer(rate=1e6)
    later(lambda: pace.steer(paused=False))
    assert pace.wait(START_NS + HOUR_NS) is not None


def test_an_interrupt_ends_waits_until_the_next_beginning():
    pace = begun()
    later(pace.interrupt)
    assert pace.wait(START_NS + HOUR_NS) is None
    assert pace.wait(START_NS - 1) is None
    pace.begin(START_NS)
    assert pace.wait(START_NS - 1) is not None


def test_after_a_change_of_the_rate_it_goes_on_from_where_it_is(monkeypatch: pytest.MonkeyPatch):
    """The next ten seconds of the recording take one, and no message between is late or left out."""
    clock = Clock(monkeypatch)
    pace = clock.begun()
    clock.go_on(10.0)
    pace.steer(rate=10.0)
    assert pace.wait(START_NS + 10 * NANOSECONDS) == 0.0
    before_ns = clock.monotonic_ns()
    assert pace.wait(START_NS + 20 * NANOSECONDS) == 0.0
    assert clock.monotonic_ns() - before_ns == 1 * NANOSECONDS
    clock.go_on(3.0)
    assert pace.wait(START_NS + 20 * NANOSECONDS) == pytest.approx(3.0)


def test_the_time_of_a_pause_does_not_count(monkeypatch: pytest.MonkeyPatch):
    clock = Clock(monkeypatch)
    pace = clock.begun(rate=2.0)
    clock.go_on(5.0)
    pace.steer(paused=True)
    clock.go_on(5.0)
    pace.steer(paused=False)
    assert pace.wait(START_NS + 10 * NANOSECONDS) == 0.0
    before_ns = clock.monotonic_ns()
    assert pace.wait(START_NS + 12 * NANOSECONDS) == 0.0
    assert clock.monotonic_ns() - before_ns == 1 * NANOSECONDS
