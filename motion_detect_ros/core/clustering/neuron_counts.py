"""Numbers of neurons that follow the scene (``self_tuning.neurons``)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from motion_detect_ros.core.clustering.art2_network import LabelArray
from motion_detect_ros.core.config import Art2Config
from motion_detect_ros.core.self_tuning import FollowingSettings, SelfTuningConfig, within_reach

#: Initial neurons over those in use, so that there is room for one motion in two that is new.
ROOM = 1.5
#: Neurons the network may grow to over the initial ones: the report's 15 -> 25 (and about its 5 -> 10).
GROWTH = 5.0 / 3.0


class NeuronCounts(FollowingSettings[Art2Config]):
    """ART2's settings with the numbers of the moment."""

    def __init__(self, given: Art2Config, tuning: SelfTuningConfig) -> None:
        super().__init__(given, tuning.neurons)

    def follow(self, labels: LabelArray, dt_s: float) -> None:
        """Take one frame's labels: how many neurons won something, the background's included.

        labels: as ``Art2Network.partial_fit`` returns them, any shape; dt_s: since the frame before.
        """
        if self._follows:
            self._take(int(np.count_nonzero(np.bincount(labels[labels >= 0]))), dt_s)

    def _moved(self, given: Art2Config, usual: float) -> Art2Config:
        initial = math.ceil(within_reach(given, 'initial_neurons', ROOM * usual))
        most = math.ceil(within_reach(given, 'max_neurons', GROWTH * initial))
        return replace(given, initial_neurons=min(initial, most), max_neurons=most)
