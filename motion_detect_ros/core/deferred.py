"""Work of a frame that its answer does not wait for: done behind it, while the next frame is awaited."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, wait
from functools import partial
from typing import Generic, TypeVar

from motion_detect_ros.core.threads import ApartPool, threads

Outcome = TypeVar('Outcome')

#: What is found behind a frame comes a frame later; where frames are longer than this, seconds, it is not put off.
LATER_S = 0.06


class Deferred(Generic[Outcome]):
    """One job at a time, in a thread of its own; at once, in the caller's, where there is no other (``core.threads``).

    What is taken is the same either way, and so is when.
    """

    def __init__(self, name: str) -> None:
        """name: of the thread."""
        self._pool = ApartPool(1, name)
        self._future: Future[Outcome] | None = None

    def start(self, job: Callable[[], Outcome]) -> bool:
        """Returns whether it is done beside the caller. The job before it has been taken or dropped."""
        if threads() > 1:
            self._future = self._pool.submit(job)
            return True
        self._future = Future()
        try:
            self._future.set_result(job())
        except Exception as error:
            self._future.set_exception(error)
        return False

    def take(self) -> Outcome | None:
        """What the last job returned, once: None where there was none. Waits for it. Raises: what the job raised."""
        future, self._future = self._future, None
        return None if future is None else future.result()

    @property
    def outcome(self) -> Callable[[], Outcome | None]:
        """Waits for the job that there is now, in any thread, and returns what it does, which can still be taken; None
        where there is none, or where it raises.
        """
        return partial(_outcome_of, self._future)

    def wait(self) -> None:
        """Until the job is done; it can still be taken."""
        if self._future is not None:
            wait([self._future])

    def drop(self) -> None:
        """Wait for the job and forget it, whatever came of it."""
        self.wait()
        self._future = None


def _outcome_of(future: Future[Outcome] | None) -> Outcome | None:
    return None if future is None or future.exception() else future.result()
