"""What points tell of the objects that flow shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from motion_detect_ros.core.detection.candidate import Candidate
from motion_detect_ros.core.trajectories.points import Points
from motion_detect_ros.core.trajectories.soft_shadows import SoftShadows, without_shadow
from motion_detect_ros.core.trajectories.standing import NOT_DENIED_LOG_ODDS, StandingPoints


@dataclass(frozen=True)
class PointEvidence:
    """Of one frame. ``standing``: what was last measured; ``shape``: height and width of the working resolution;
    ``scale``: its pixels per full-resolution pixel.
    """

    points: Points
    standing: StandingPoints
    shadows: SoftShadows
    shape: tuple[int, ...]
    scale: float

    def without_standing(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Candidates of flow less those where the points stand still, which is evidence for the others."""
        denied = self.standing.denied(candidates, self.points, self.scale)
        return [replace(each, log_odds=each.log_odds + NOT_DENIED_LOG_ODDS)
                for each, still in zip(candidates, denied, strict=True) if not still]

    def without_shadows(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Candidates of flow, their boxes without soft shadows."""
        height, width = self.shape
        return [without_shadow(each, self.shadows, self.scale, width, height) for each in candidates]
