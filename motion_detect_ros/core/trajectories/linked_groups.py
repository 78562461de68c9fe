"""What links hold together."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.kernels import kernel


def linked_groups(count: int, links: npt.NDArray[np.intp], least: int = 1) -> list[npt.NDArray[np.intp]]:
    """Connected components of the numbers 0 .. count - 1, those of at least so many, each in ascending order, the one
    with the smallest number first. links: (n, 2). Source: union-find with path halving (Tarjan and van Leeuwen 1984).
    """
    order, ends = np.empty(count, np.intp), np.empty(count, np.intp)
    groups = _group(links, least, np.arange(count), np.zeros(count, np.intp), order, ends)
    bounds = [0, *ends[:groups].tolist()]
    return [order[first:last] for first, last in pairwise(bounds)]


@kernel()
def _group(links, least, above, size, order, ends):  # type: ignore[no-untyped-def]
    """Writes the members of all groups one after the other, and where each ends; returns the number of groups.

    above: (count,) each itself, becomes the smallest number of its group; size: (count,) zeros.
    """
    for link in range(len(links)):
        one, other = _smallest(above, links[link, 0]), _smallest(above, links[link, 1])
        above[max(one, other)] = min(one, other)
    for number in range(len(above)):
        above[number] = above[above[number]]
        size[above[number]] += 1
    groups = placed = 0
    for number in range(len(above)):
        if above[number] == number and size[number] >= least:
            placed += size[number]
            ends[groups] = placed
            groups += 1
            size[number] = placed - size[number]  # where its next member goes
        elif above[number] == number:
            size[number] = -1
        at = size[above[number]]
        if at >= 0:
            order[at] = number
            size[above[number]] = at + 1
    return groups


@kernel()
def _smallest(above, number):  # type: ignore[no-untyped-def]
    while above[number] != number:
        above[number] = above[above[number]]
        number = above[number]
    return number
