"""The noise floor that follows the scene (``self_tuning.noise_floor``).

A frame's measured noise may be too small by luck, or because the fit followed a mover; the floor is what keeps it from
making everything else move. It is taken as a multiple of the noise of the last seconds, whatever the resolution.
"""

from __future__ import annotations

from dataclasses import replace

from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.self_tuning import FollowingSettings, SelfTuningConfig, within_reach

#: Floor over the usual noise: the default floor, 0.2 px, over the median noise of the clips of docs/accuracy.md.
FLOOR_OVER_NOISE = 1.6


class NoiseFloor(FollowingSettings[BackgroundConfig]):
    """The background's settings with the floor of the moment."""

    def __init__(self, given: BackgroundConfig, tuning: SelfTuningConfig) -> None:
        super().__init__(given, tuning.noise_floor)

    def follow(self, spread_px: float, dt_s: float) -> None:
        """Take one frame's noise, one deviation, pixels. dt_s: since the frame before."""
        if self._follows:
            self._take(spread_px, dt_s)

    def _moved(self, given: BackgroundConfig, usual: float) -> BackgroundConfig:
        return replace(given, noise_floor_px=within_reach(given, 'noise_floor_px', FLOOR_OVER_NOISE * usual))
