"""The search itself, by optuna: seeded, and gone on with where it stopped."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motion_detect_ros.core.errors import BackendError, ConfigError, SourceError
from motion_detect_ros.tuning.space import Dimension

STORAGE_NAME, STUDY_NAME = 'trials.sqlite3', 'tune'
#: What a study is about, in its own attributes.
_TASK = 'task'
#: Marks trials whose values contradict each other, unlike those that were interrupted.
_REFUSED = 'refused'
#: So many of those in a row end the search.
MOST_REFUSED = 100


@dataclass(frozen=True)
class Trial:
    """Values that were tried, and by how much they were better than the start on what is searched on."""

    number: int
    values: Mapping[str, float]
    gain: float


class Study:
    """Trials in a file of the output folder. The same seed gives the same trials, interrupted or not."""

    def __init__(self, folder: Path, dimensions: Sequence[Dimension], task: Mapping[str, Any], seed: int) -> None:
        """task: what the trials are of; a file of another task is refused.

        Raises: BackendError where optuna is missing; SourceError for a file that is of another task or unreadable.
        """
        self._optuna, self._seed = _optuna(), seed
        self._ranges = {one.name: self._optuna.distributions.FloatDistribution(one.low, one.high, log=one.log)
                        for one in dimensions}
        self._path = path = folder / STORAGE_NAME
        try:
            # As an address, 'sqlite:///' and the path, ? and % in it would mean something else.
            storage = self._optuna.storages.RDBStorage(
                'sqlite://', engine_kwargs={'creator': lambda: sqlite3.connect(path)})
            self._study = self._optuna.create_study(
                storage=storage, study_name=STUDY_NAME, direction='maximize', load_if_exists=True)
            self._claim(path, json.loads(json.dumps(task)))
        except SourceError:
            raise
        except Exception as error:  # SQLAlchemy's own, of which there are many
            reason = str(error).splitlines()[0]
            raise SourceError(
                f'{path}: expected the trials of an earlier search, or a writable folder: {reason}') from None

    def _claim(self, path: Path, task: Mapping[str, Any]) -> None:
        """Raises: SourceError where the file holds trials of another task."""
        known = self._study.user_attrs.get(_TASK)
        if known is None or not self._study.get_trials(deepcopy=False):
            self._study.set_user_attr(_TASK, task)
        elif known != task:
            odd = sorted(name for name in {*known, *task} if known.get(name) != task.get(name))
            raise SourceError(f'{path}: holds the trials of another search ({", ".join(odd)} differ); use another '
                              'folder, or --force to begin anew')
        for trial in self._study.get_trials(states=(self._optuna.trial.TrialState.RUNNING,)):
            self._study.tell(trial.number, state=self._optuna.trial.TrialState.FAIL)  # it was interrupted

    @property
    def trials(self) -> list[Trial]:
        """Those that ended, in their order."""
        done = self._study.get_trials(states=(self._optuna.trial.TrialState.COMPLETE,))
        return [Trial(number, rounded(one.params), float(one.value)) for number, one in enumerate(done)]

    @property
    def best(self) -> Trial | None:
        """The one with the largest gain, the earliest of equals; None before the first."""
        return max(self.trials, key=lambda trial: trial.gain, default=None)

    def note_start(self, values: Mapping[str, float]) -> None:
        """The start as a trial without gain, unless it lies outside of what is searched or is there already."""
        inside = all(self._ranges[name].low <= value <= self._ranges[name].high for name, value in values.items())
        if inside and not self.trials:
            self._study.add_trial(self._optuna.trial.create_trial(
                params=dict(values), distributions=self._ranges, value=0.0))

    def run(self, gain_of: Callable[[Mapping[str, float]], float], trials: int) -> Iterator[Trial]:
        """Trials until there are so many; yields each that ends. Values that contradict each other cost a trial only.

        Raises: ConfigError where ``MOST_REFUSED`` in a row do, OSError where the file cannot be written any more.
        """
        refused = 0
        while (done := len(self.trials)) < trials:
            self._study.sampler = self._optuna.samplers.TPESampler(seed=self._next_seed())
            with self._writing():
                trial = self._study.ask(self._ranges)
            try:
                gain = gain_of(rounded(trial.params))
            except ConfigError:
                with self._writing():
                    trial.set_user_attr(_REFUSED, True)
                    self._study.tell(trial, state=self._optuna.trial.TrialState.FAIL)
                if (refused := refused + 1) >= MOST_REFUSED:
                    raise
                continue
            refused = 0
            with self._writing():
                self._study.tell(trial, gain)
            yield Trial(done, rounded(trial.params), gain)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Raises: OSError where the file cannot be written, as on a full disk."""
        try:
            yield
        except self._optuna.exceptions.StorageInternalError as error:
            reason = str(error.__cause__ or error).splitlines()[0]
            raise OSError(f'{self._path}: cannot be written: {reason}; the trials until then are kept') from None

    def _next_seed(self) -> int:
        """From the seed and the trials so far, refused ones too, so that a search that goes on draws what it would
        have; mixed, as neighbouring seeds would give nearly the same searches.
        """
        tried = [trial for trial in self._study.get_trials(deepcopy=False) if _REFUSED in trial.user_attrs
                 or trial.state == self._optuna.trial.TrialState.COMPLETE]
        return int(np.random.SeedSequence([self._seed, len(tried)]).generate_state(1)[0])


def rounded(values: Mapping[str, float]) -> dict[str, float]:
    """The values as they are used and written: four digits."""
    return {name: float(f'{value:.4g}') for name, value in values.items()}


def _optuna() -> Any:
    try:
        import optuna
    except ImportError as error:
        raise BackendError(f'tune needs optuna ({error}): pip install optuna') from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return optuna
