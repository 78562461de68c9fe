"""Frame decimation: the first m of every n frames are processed."""

from __future__ import annotations

from motion_detect_ros.core.config import LoadConfig


class FrameDecimation:
    """Decides for each frame in turn whether it is processed: the first ``keep`` of every ``of``.

    Dropped frames are ignored altogether; velocities are per second of the stamps, not per frame.
    """

    def __init__(self, keep: int, of: int) -> None:
        self._keep, self._of = keep, of
        self._seen = 0

    @classmethod
    def by(cls, load: LoadConfig, step_of: int = 1) -> FrameDecimation:
        """As the settings say. step_of: a step of ``load.adapt`` leaves one frame of so many."""
        return cls(load.decimation_keep, load.decimation_of * step_of)

    @property
    def active(self) -> bool:
        """Whether any frame is dropped at all."""
        return self._keep < self._of

    def keep_next(self) -> bool:
        """Whether the next frame is processed; call once for every frame."""
        kept = self._seen % self._of < self._keep
        self._seen += 1
        return kept

    def kept_at_least(self, run: int) -> int:
        """Of so many frames in a row, wherever in their groups, how many are processed at least."""
        groups, rest = divmod(run, self._of)
        keep = min(self._keep, self._of)
        return groups * keep + max(0, rest - (self._of - keep))

    def reset(self) -> None:
        """Start with a new group."""
        self._seen = 0
