"""Threads of this package and of OpenCV."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import cv2
import pytest

from motion_detect_ros.core import threads as core_threads
from motion_detect_ros.core.threads import ApartPool, Helpers, limited, threads, use

Outcome = TypeVar('Outcome')


@pytest.mark.parametrize(('count', 'opencv'), [(1, 1), (2, 1), (4, 4)])
def test_up_to_two_threads_opencv_keeps_to_its_callers(count: int, opencv: int) -> None:
    before = threads(), cv2.getNumThreads()
    with limited(count):
        assert (threads(), cv2.getNumThreads()) == (count, opencv)
        use(0)
        assert (threads(), cv2.getNumThreads()) == (count, opencv), '0 leaves them as they are'
    assert (threads(), cv2.getNumThreads()) == before


def test_they_are_as_before_after_an_error() -> None:
    before = threads(), cv2.getNumThreads()
    with pytest.raises(ValueError), limited(1):
        raise ValueError
    assert (threads(), cv2.getNumThreads()) == before


@pytest.mark.parametrize(('count', 'size', 'parts'), [
    (1, 100, 1), (2, 100, 2), (2, 39, 1), (2, 40, 2), (2, 0, 1), (4, 100, 1)])
def test_what_is_small_or_opencv_s_is_one_part(count: int, size: int, parts: int) -> None:
    with limited(count):
        assert Helpers.parts(size, 20) == parts


def test_parts_are_done_side_by_side_and_told_in_their_order() -> None:
    """Each waits for the other to have begun."""
    begun = threading.Barrier(2, timeout=60.0)
    with limited(2):
        done = Helpers('test').share(lambda part: (begun.wait(), threading.current_thread(), part)[1:], range(2))
    assert [part for _, part in done] == [0, 1]
    assert done[0][0] is threading.current_thread()
    assert done[1][0] is not threading.current_thread()


def test_who_waits_for_a_busy_thread_does_its_work() -> None:
    helpers, go_on, busy = Helpers('test'), threading.Event(), threading.Event()

    def wait_for_it(part: int) -> None:
        if part == 1:
            busy.set()
            assert go_on.wait(60.0)

    other = threading.Thread(target=lambda: helpers.share(wait_for_it, range(2)))
    other.start()
    assert busy.wait(60.0)
    done = helpers.share(lambda part: threading.current_thread(), range(2))
    go_on.set()
    other.join()
    assert done == [threading.current_thread()] * 2


@pytest.mark.parametrize('failing', [0, 1])
def test_what_a_part_raises_is_raised(failing: int) -> None:
    with pytest.raises(ZeroDivisionError):
        Helpers('test').share(lambda part: 1 / (part - failing), range(2))


def test_threads_of_numpy_do_not_wait_in_a_loop() -> None:
    """Those of NumPy 1.26 did, 25 ms after every inverse of a small matrix; here 20 are made in a second."""
    code = """if 1:
        import motion_detect_ros
        import time
        import numpy
        numpy.linalg.inv(numpy.eye(3))
        time.sleep(0.2)
        began = time.process_time()
        for _ in range(20):
            numpy.linalg.inv(numpy.eye(3))
            time.sleep(0.05)
        print(time.process_time() - began)
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith(('OPENBLAS', 'OMP'))}
    done = subprocess.run([sys.executable, '-c', code], env=environment, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 0.15


PROCESSORS = os.sched_getaffinity(0)
ONE = max(PROCESSORS)
needs_two = pytest.mark.skipif(len(PROCESSORS) < 2, reason='one processor only: nowhere to be apart')


def kept_to_one(function: Callable[[], Outcome]) -> Outcome:
    """What it returns to a thread that may run on the processor ``ONE`` only."""
    with ThreadPoolExecutor(1, initializer=lambda: os.sched_setaffinity(0, {ONE})) as caller, limited(2):
        return caller.submit(function).result(60.0)


def allowed() -> set[int]:
    return os.sched_getaffinity(0)


@needs_two
def test_work_is_done_on_another_processor_than_its_caller_s() -> None:
    pool = ApartPool(1, 'test')
    seen = kept_to_one(lambda: [pool.submit(allowed).result(60.0) for _ in range(3)])
    assert seen[1:] == [PROCESSORS - {ONE}] * 2
    assert allowed() == PROCESSORS, 'other threads are left alone'


@needs_two
def test_a_thread_that_is_kept_apart_shares_out_to_all_processors_but_its_own() -> None:
    """Not to those only that it may run on itself."""
    outer, inner = ApartPool(1, 'outer'), ApartPool(1, 'inner')

    def share_out() -> list[set[int]]:
        return [allowed(), *(inner.submit(allowed).result(60.0) for _ in range(2))]

    own, _, seen = kept_to_one(lambda: [outer.submit(share_out).result(60.0) for _ in range(2)])[1]
    assert own == PROCESSORS - {ONE}
    assert ONE in seen and len(seen) == len(PROCESSORS) - 1


@needs_two
def test_threads_that_came_later_are_kept_apart_too() -> None:
    pool, both = ApartPool(2, 'test'), threading.Barrier(2, timeout=60.0)

    def seen() -> set[int]:
        both.wait()
        return allowed()

    def two() -> list[set[int]]:
        return [each.result(60.0) for each in [pool.submit(seen), pool.submit(seen)]]

    kept_to_one(lambda: [pool.submit(int).result(60.0) for _ in range(2)])
    assert kept_to_one(lambda: (two(), two()))[1] == [PROCESSORS - {ONE}] * 2


def test_with_one_processor_it_is_done_there() -> None:
    try:
        os.sched_setaffinity(0, {ONE})
        pool = ApartPool(1, 'test')
        with limited(2):
            assert [pool.submit(allowed).result(60.0) for _ in range(3)] == [{ONE}] * 3
    finally:
        os.sched_setaffinity(0, PROCESSORS)


def refuse(*_: object) -> None:
    raise PermissionError('not permitted')


def test_where_the_system_says_no_it_is_done_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(core_threads, 'sched_setaffinity', refuse)
    pool = ApartPool(1, 'test')
    with limited(2):
        assert [pool.submit(int, 7).result(60.0) for _ in range(3)] == [7] * 3
        monkeypatch.setattr(core_threads, '_LIBRARY', object())  # one without the function
        assert pool.submit(int, 8).result(60.0) == 8


@needs_two
def test_threads_that_opencv_starts_beside_a_caller_may_run_on_every_processor() -> None:
    """They inherit what the thread that starts them may run on, for good. In a process of its own: OpenCV starts its
    threads once.
    """
    code = """if True:
        import os, cv2, numpy
        from motion_detect_ros.core.threads import ApartPool, use
        use(4)
        pool, flow = ApartPool(1, 'test'), cv2.DISOpticalFlow_create(1)
        image = numpy.random.default_rng(1).integers(0, 255, (600, 800), numpy.uint8)
        before = len(os.listdir('/proc/self/task'))
        for _ in range(3):
            pool.submit(flow.calc, image, image, None).result(60.0)
        threads = [int(each) for each in os.listdir('/proc/self/task')]
        print(len(threads) - before, {len(os.sched_getaffinity(each)) for each in threads})
    """
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.split(maxsplit=1)[1].strip() == str({len(PROCESSORS)})
    assert int(done.stdout.split()[0]) > 1, 'OpenCV has started some'
