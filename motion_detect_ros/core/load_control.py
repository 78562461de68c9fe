"""Less work a frame while there is too much of it (``load.adapt``), by known steps, and back."""

from __future__ import annotations

from dataclasses import dataclass

#: Compute time over the period from which the load is too high, and under which the next larger step would have to be.
TOO_HIGH, LOW_ENOUGH = 0.95, 0.85
#: More is done after so many decisions with room for it; where that was too much within so many decisions, patience is
#: doubled, up to the last number; it is forgotten where it then holds for longer than that.
PATIENCE, RELAPSE, MAX_PATIENCE = 3, 10, 48
#: So many decisions in a row find the load too high before a next step that leaves more images out: a single one loses
#: a few, and the step every other one for ``PATIENCE``.
OVERLOADS = 2


@dataclass(frozen=True)
class Step:
    """``width_share``: of ``preprocessing.max_width_px``; ``of``: one image of so many is processed; ``cost``: of a
    received image against the first step.
    """

    width_share: float
    of: int
    cost: float

    @property
    def reduced(self) -> str:
        """In a few words what is left out; empty at full work."""
        if self == STEPS[0]:
            return ''
        images = 'every image' if self.of == 1 else f'1 image of {self.of}'
        return f'load reduced: {self.width_share:.0%} of the working width, {images}'


#: Costs as measured on four clips, means: an image less saves less than its share, since flow and small objects go by
#: time.
STEPS = (Step(1.0, 1, 1.0), Step(0.75, 1, 0.75), Step(0.5, 1, 0.5), Step(0.5, 2, 0.34), Step(0.5, 3, 0.25))


class LoadControl:
    """Decides once a second, say, which of ``STEPS`` is worked at."""

    def __init__(self) -> None:
        self._number, self._with_room, self._patience = 0, 0, PATIENCE
        self._since_more, self._overloads = RELAPSE, 0

    @property
    def number(self) -> int:
        """Of the present step, from 0 on."""
        return self._number

    @property
    def step(self) -> Step:
        """The present one."""
        return STEPS[self._number]

    def decide(self, compute_s: float, period_s: float) -> bool:
        """Whether the step has changed.

        compute_s: mean time for a processed image since the last decision; period_s: between those that the settings do
        not leave out, over 0.
        """
        load = compute_s / (self.step.of * period_s)
        self._since_more += 1
        self._overloads = self._overloads + 1 if load > TOO_HIGH else 0
        if self._overloads:
            return self._do_less(load)
        larger = STEPS[max(0, self._number - 1)]
        has_room = self._number > 0 and load * larger.cost / self.step.cost < LOW_ENOUGH
        self._with_room = self._with_room + 1 if has_room else 0
        if self._with_room < self._patience:
            return False
        self._number, self._with_room, self._since_more = self._number - 1, 0, 0
        return True

    def _do_less(self, load: float) -> bool:
        """As many steps down as the load is expected to need; only back where a try of more has just failed."""
        before, last, full = self._number, len(STEPS) - 1, load / self.step.cost
        smaller, self._with_room = min(before + 1, last), 0
        if STEPS[smaller].of > self.step.of and self._overloads < OVERLOADS:
            return False
        self._number = smaller
        if self._since_more <= RELAPSE:
            self._patience, self._since_more = min(MAX_PATIENCE, 2 * self._patience), RELAPSE
        else:
            self._patience = PATIENCE if self._since_more > MAX_PATIENCE else self._patience
            while self._number < last and full * self.step.cost > TOO_HIGH:
                self._number += 1
        return self._number != before
