"""Frame decimation: the first m of every n frames are processed."""

from __future__ import annotations


class FrameDecimation:
    """Decides for each frame in turn whether it is processed: the first ``keep`` of every ``of``.

    Dropped frames are ignored altogether; velocities are per second of the stamps, not per frame.
    """

    def __init__(self, keep: int, of: int) -> None:
        self._keep, self._of = keep, of
        self._seen = 0

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
