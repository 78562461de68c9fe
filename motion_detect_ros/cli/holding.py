"""A player that waits for the stages: paused while many of its images have no answer yet, so that none is lost."""

from __future__ import annotations

import threading
import time
from typing import Any

from motion_detect_ros.cli.planner import Planner

#: So many images under way pause the player, and so few let it go on; the three stages work on one each.
HOLD_AT, GO_ON_AT = 6, 3
#: A player is let go where no answer has come for so long, until the next one comes, seconds.
STALL_S = 5.0
#: A request that is not answered is made again after this; how long the end of the last pause may take, seconds.
ASK_AGAIN_S, RELEASE_S = 1.0, 5.0
POLL_S = 0.02


class Holding:
    """Pauses and resumes the bag player; the planner looks after each message that it hears, any thread may."""

    def __init__(self, planner: Planner) -> None:
        self._planner, self._lock = planner, threading.Lock()
        self._services = {True: planner.service('/bag_player/pause'), False: planner.service('/bag_player/resume')}
        self._paused, self._since_s, self._past_s = False, 0.0, 0.0
        self._request: tuple[bool, Any, float] | None = None
        self._answers, self._answer_s, self._stalled = 0, 0.0, False
        planner.watch = self.look

    @property
    def held_s(self) -> float:
        """How long the player has waited so far, seconds."""
        with self._lock:
            return self._past_s + (time.monotonic() - self._since_s if self._paused else 0.0)

    def look(self) -> None:
        """Ask for a pause, or for its end, where that is due."""
        with self._lock:
            now_s = time.monotonic()
            self._steer(self._is_due(now_s), now_s)

    def release(self) -> None:
        """Let the player go on to the end of its bag; returns once it does, or does not answer."""
        self._planner.watch = lambda: None
        deadline_s = time.monotonic() + RELEASE_S
        while time.monotonic() < deadline_s:
            with self._lock:
                self._steer(False, time.monotonic())
                if not self._paused and self._request is None:
                    return
            time.sleep(POLL_S)

    def _is_due(self, now_s: float) -> bool:
        """Whether the player is to wait now."""
        if (answers := self._planner.answers) != self._answers:
            self._answers, self._answer_s, self._stalled = answers, now_s, False
        self._stalled |= self._paused and now_s - max(self._answer_s, self._since_s) > STALL_S
        backlog = self._planner.backlog
        return not self._stalled and (backlog > GO_ON_AT if self._paused else backlog >= HOLD_AT)

    def _steer(self, paused: bool, now_s: float) -> None:
        """One request at a time, as two could overtake each other."""
        if self._request is not None:
            asked, answer, asked_s = self._request
            if answer.done():
                self._note(asked, now_s)
            elif now_s - asked_s < ASK_AGAIN_S:
                return
            self._request = None
        if paused != self._paused and (answer := self._services[paused].ask()) is not None:
            self._request = paused, answer, now_s

    def _note(self, paused: bool, now_s: float) -> None:
        if self._paused and not paused:
            self._past_s += now_s - self._since_s
        elif paused and not self._paused:
            self._since_s = now_s
        self._paused = paused
