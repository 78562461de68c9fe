"""Tracks in one another's place: two views of one object, of which one is reported."""

from __future__ import annotations

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
    centre, size = np.array([track.state[:2] for track in tracks]), np.array([track.size for track in tracks])
    edges, area = (centre - size / 2.0, centre + size / 2.0), size.prod(axis=1)
    velocity = np.array([track.state[2:] for track in tracks])
    speed, difference = magnitude(velocity), magnitude(velocity[:, None] - velocity)
    same = (shared_areas(edges, edges) > INSIDE_SHARE * np.minimum(area[:, None], area)) & (
        difference <= np.maximum(speed[:, None], speed))
    kept: list[int] = []
    for index in sorted(range(len(tracks)), key=lambda index: -tracks[index].age):
        if not same[index, kept].any():
            kept.append(index)
    return [tracks[index] for index in sorted(kept)]
