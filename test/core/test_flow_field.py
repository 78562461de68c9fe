"""Flow that is computed where it is first asked for."""

import threading
import time

import numpy as np
import pytest

from motion_detect_ros.core.types import FlowField

SHIFTS = np.full((2, 3, 2), 1.5, np.float32)


def test_a_known_flow_is_never_pending():
    field = FlowField(SHIFTS, 12, 8, 40)
    assert not field.pending
    assert field.flow is SHIFTS
    assert (field.width, field.height, field.stamp_ns, field.took_ms) == (12, 8, 40, 0.0)


def test_it_is_computed_once_by_who_asks_first_while_the_others_wait():
    computed, got, begun = [], [], threading.Event()

    def compute():
        computed.append(threading.current_thread().name)
        begun.set()
        time.sleep(0.2)
        return SHIFTS

    field = FlowField(compute, 12, 8, 40)
    assert field.pending
    first = threading.Thread(target=lambda: got.append(field.flow), name='first')
    first.start()
    assert begun.wait(60.0)
    got.append(field.flow)
    first.join()
    assert computed == ['first']
    assert [each is SHIFTS for each in got] == [True, True]
    assert not field.pending
    assert field.took_ms >= 200.0


@pytest.mark.parametrize(('shifts', 'known'), [(SHIFTS, True), (np.full_like(SHIFTS, np.nan), False)])
def test_whether_it_is_known_is_asked_of_the_computed_one(shifts, known):
    field = FlowField(lambda: shifts, 12, 8, 40)
    assert field.measured == known
    assert not field.pending


def test_what_computing_raises_is_raised_to_each_who_asks():
    computed = []
    field = FlowField(lambda: computed.append(1) or 1 / 0, 12, 8, 40)
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            field.flow.sum()
    assert computed == [1]
