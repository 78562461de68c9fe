"""Settings that follow the scene by themselves: which, how slowly, and how far from what the user set.

The next step that the published report names. All of it is off by default; what it is worth: docs/accuracy.md.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, Generic, TypeVar

from motion_detect_ros.core.forgetting import kept
from motion_detect_ros.core.settings import setting

#: Time constant with which a followed value forgets, seconds: many frames, so that one odd frame changes little.
MEMORY_S = 2.0
#: A followed setting stays within this factor of what the user set, either way.
REACH = 4.0

Config = TypeVar('Config')


@dataclass(frozen=True)
class SelfTuningConfig:
    """What follows the scene."""

    noise_floor: bool = setting(
        False, 'background.noise_floor_px follows the noise measured over the last seconds, within a factor of 4')
    neurons: bool = setting(
        False, 'art2.initial_neurons and art2.max_neurons follow how many neurons were in use over the last seconds, '
        'within a factor of 4')


@dataclass(frozen=True)
class Tuned:
    """Values in use of the settings that may follow the scene; those that the user set where they do not."""

    noise_floor_px: float
    initial_neurons: int
    max_neurons: int


class Follower:
    """Slow geometric mean of a positive value, so that twice and half as much weigh the same at every scale."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._log: float | None = None

    @property
    def value(self) -> float | None:
        """The mean, in the unit of what was given; None before the first value."""
        return None if self._log is None else math.exp(self._log)

    def follow(self, value: float, dt_s: float) -> None:
        """Take one frame's value; one that is not positive and finite says nothing. dt_s: since the one before."""
        if not (math.isfinite(value) and value > 0.0):
            return
        remembered = 0.0 if self._log is None else kept(dt_s, MEMORY_S)
        self._log = remembered * (self._log or 0.0) + (1.0 - remembered) * math.log(value)


class FollowingSettings(ABC, Generic[Config]):
    """Settings that may follow a value of the scene; ``config``: those of the moment."""

    def __init__(self, given: Config, follows: bool) -> None:
        """follows: else they stay as given."""
        self._follows = follows
        self._follower = Follower()
        self.use_config(given)

    def use_config(self, given: Config) -> None:
        """Other settings around which they move; what was seen of the scene stays."""
        self._given = given
        self._update()

    def reset(self) -> None:
        """The settings as given."""
        self._follower.reset()
        self._update()

    def _take(self, value: float, dt_s: float) -> None:
        """Follow one frame's value. dt_s: since the frame before."""
        self._follower.follow(value, dt_s)
        self._update()

    def _update(self) -> None:
        usual = self._follower.value
        self.config = self._given if usual is None else self._moved(self._given, usual)

    @abstractmethod
    def _moved(self, given: Config, usual: float) -> Config:
        """The settings where the value of the last seconds is ``usual``."""


def within_reach(config: Any, name: str, wanted: float) -> float:
    """``wanted``, or how far towards it the field ``name`` of ``config`` goes: by ``REACH``, within its own range."""
    given, (limits,) = getattr(config, name), [each.metadata for each in fields(config) if each.name == name]
    return min(max(wanted, given / REACH, limits['low']), given * REACH, limits['high'])
