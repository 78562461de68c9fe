"""Tracks in one another's place: two views of one object, of which one is reported."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from motion_detect_ros.core.geometry.boxes import shared_areas
from motion_detect_ros.core.geometry.vectors import magnitude
from motion_detect_ros.core.tracking.track import Track

#: Two boxes are in the same place where so much of the smaller one is in the other.
INSIDE_SHARE = 0.7


def known_longest(tracks: list[Track]) -> list[Track]:
    """In their order, those that are in no older one's place, which has often been found whole.

    What differs from it in velocity by more than the faster one's speed crosses it: another object.
    """
    if len(tracks) < 2:
        return tracks
    centre, size = np.array([track.centre for track in tracks]), np.array([track.size for track in tracks])
    edges, area = (centre - size / 2.0, centre + size / 2.0), size.prod(axis=1)
    inside = shared_areas(edges, edges) > INSIDE_SHARE * np.minimum(area[:, None], area)
    ones, others = np.nonzero(np.triu(inside, 1))
    if not len(ones):
        return tracks
    velocity = np.array([track.velocity for track in tracks])
    speed, difference = magnitude(velocity), magnitude(velocity[ones] - velocity[others])
    alike = difference <= np.maximum(speed[ones], speed[others])
    return _older(tracks, list(zip(ones[alike].tolist(), others[alike].tolist(), strict=True)))


def _older(tracks: list[Track], pairs: list[tuple[int, int]]) -> list[Track]:
    """Without those that make a pair, of indices, with an older one that stays."""
    same: dict[int, set[int]] = defaultdict(set)
    for one, other in pairs:
        same[one].add(other)
        same[other].add(one)
    hidden: set[int] = set()
    for index in sorted(same, key=lambda index: (-tracks[index].age, index)):
        if index not in hidden:
            hidden |= same[index]
    return [track for index, track in enumerate(tracks) if index not in hidden]
