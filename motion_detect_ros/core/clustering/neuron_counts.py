"""Numbers of neurons that follow the scene (``self_tuning.neurons``)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from motion_detect_ros.core.clustering.art2_network import LabelArray
from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.self_tuning import Follower, SelfTuningConfig, within_reach

#: Initial neurons over those in use, so that there is room for one motion in two that is new.
ROOM = 1.5
#: Neurons the network may grow to over the initial ones: the report's 15 -> 25 (and about its 5 -> 10).
GROWTH = 5.0 / 3.0


class NeuronCounts:
    """ART2's settings with the numbers of the moment."""

    def __init__(self, given: Art2Config, tuning: SelfTuningConfig) -> None:
        self._follows = tuning.neurons
        self._used = Follower()
        self.use_config(given)

    def use_config(self, given: Art2Config) -> None:
        """Other settings around which they move; the numbers seen stay."""
        self._given = given
        self._update()

    def reset(self) -> None:
        """The settings as given."""
        self._used.reset()
        self._update()

    def follow(self, labels: LabelArray, dt_s: float) -> None:
        """Take one frame's labels: how many neurons won something, the background's included.

        labels: as ``Art2Network.partial_fit`` returns them, any shape; dt_s: since the frame before.
        """
        if self._follows:
            self._used.follow(int(np.count_nonzero(np.bincount(labels[labels >= 0]))), dt_s)
            self._update()

    def _update(self) -> None:
        usual, given = self._used.value, self._given
        if usual is None:
            self.config = given
            return
        initial = math.ceil(within_reach(given, 'initial_neurons', ROOM * usual))
        most = math.ceil(within_reach(given, 'max_neurons', GROWTH * initial))
        self.config = replace(given, initial_neurons=min(initial, most), max_neurons=most)
