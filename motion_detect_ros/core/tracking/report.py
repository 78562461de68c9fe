"""The records of tracks."""

from __future__ import annotations

import numpy as np

from motion_detect_ros.core.detection.scoring import probability
from motion_detect_ros.core.tracking.track import Track
from motion_detect_ros.core.types import RecordArray, empty_detections

#: What ``_figures`` returns, in its order.
FIELDS = ('vel_u', 'vel_v', 'var_u', 'var_v', 'ttc', 'score', 'id', 'age', 'area', 'cluster')


def reported(tracks: list[Track], width: int, height: int) -> RecordArray:
    """One record (``DETECTION_DTYPE``) a track, boxes cut to an image of ``width`` x ``height`` pixels.

    Edges of boxes are at pixel borders.
    """
    records = empty_detections(len(tracks))
    if not tracks:
        return records
    centre, size = np.array([track.centre for track in tracks]), np.array([track.size for track in tracks])
    low = np.maximum(centre - size / 2.0, 0.0)
    high = np.minimum(centre + size / 2.0, [width, height])
    records['u'], records['v'] = ((low + high) / 2.0).T
    records['width'], records['height'] = (high - low).T
    for field, values in zip(FIELDS, zip(*map(_figures, tracks), strict=True), strict=True):
        records[field] = values
    return records


def _figures(track: Track) -> tuple[float, ...]:
    return (*track.velocity, *track.velocity_variance, track.approach.time_to_contact_s, probability(track.belief),
            track.id, track.age, track.seen.area, track.seen.cluster)
