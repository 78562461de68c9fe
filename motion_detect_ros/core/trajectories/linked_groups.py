"""What links hold together."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def linked_groups(count: int, links: npt.NDArray[np.intp]) -> list[npt.NDArray[np.intp]]:
    """Connected components of the numbers 0 .. count - 1, count > 0, each in ascending order; links: (n, 2)."""
    graph = coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(count, count))
    groups, labels = connected_components(graph, directed=False)
    order = np.argsort(labels, kind='stable')
    return np.split(order, np.cumsum(np.bincount(labels, minlength=groups))[:-1])
