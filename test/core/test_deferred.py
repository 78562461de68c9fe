"""Work done behind an answer: in a thread of its own or at once, with the same outcome at the same time."""

from __future__ import annotations

import threading

import pytest

from motion_detect_ros.core import deferred as deferred_module
from motion_detect_ros.core.deferred import Deferred


@pytest.fixture(params=[1, 2], ids=['one thread', 'two threads'])
def deferred(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Deferred[int]:
    monkeypatch.setattr(deferred_module, 'threads', lambda: request.param)
    return Deferred('test')


def failing() -> int:
    raise ValueError('broken')


def test_each_outcome_is_taken_once(deferred: Deferred[int]) -> None:
    assert deferred.take() is None
    deferred.start(lambda: 3)
    assert deferred.take() == 3
    assert deferred.take() is None


def test_what_a_job_raises_is_raised_where_its_outcome_is_taken(deferred: Deferred[int]) -> None:
    deferred.start(failing)
    with pytest.raises(ValueError, match='broken'):
        deferred.take()
    deferred.start(lambda: 4)
    assert deferred.take() == 4


def test_a_dropped_job_leaves_nothing(deferred: Deferred[int]) -> None:
    done = []
    deferred.start(lambda: done.append(1) or failing())
    deferred.drop()
    assert done == [1]
    assert deferred.take() is None


def test_a_job_runs_beside_its_caller_only_with_several_threads(deferred: Deferred[int]) -> None:
    where = []
    beside = deferred.start(lambda: where.append(threading.current_thread()) or 1)
    deferred.wait()
    assert beside == (deferred_module.threads() > 1)
    assert (where[0] is threading.main_thread()) == (deferred_module.threads() == 1)
    assert deferred.take() == 1


def test_others_may_wait_for_an_outcome_that_is_still_taken(deferred: Deferred[int]) -> None:
    assert deferred.outcome() is None
    deferred.start(lambda: 5)
    outcome = deferred.outcome
    assert (outcome(), deferred.take(), outcome()) == (5, 5, 5)


def test_what_a_job_raises_is_raised_to_none_but_who_takes_it(deferred: Deferred[int]) -> None:
    deferred.start(failing)
    assert deferred.outcome() is None
    with pytest.raises(ValueError, match='broken'):
        deferred.take()
