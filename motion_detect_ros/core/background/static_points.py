"""Three-dimensional background: object flow as the distance of each cell from the positions of a static point.

A static point lies on its epipolar line, in front of the camera, and not below the ground. A cell's object flow is its
distance to the part of the line that satisfies all three.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.background.planar import Background, background_of_static_points
from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.geometry.epipolar import PoseEstimate, epipolar_lines, estimate_pose, normalised
from motion_detect_ros.core.geometry.ground_plane import ground_below
from motion_detect_ros.core.geometry.warp import grid_points
from motion_detect_ros.core.types import CameraModel, FloatArray


@dataclass(frozen=True)
class StaticScene:
    """``background``: as for a planar scene; ``motion`` of the camera."""

    background: Background
    motion: PoseEstimate


def fit_static_scene(
    flow: FloatArray, residual: FloatArray, camera: CameraModel, config: BackgroundConfig,
    start: PoseEstimate | None = None,
) -> StaticScene | None:
    """Camera motion and background from the flow; None where the flow does not determine them.

    flow: (gh, gw, 2) total displacement, pixels; residual: the same without the ego-motion, NaN = invalid;
    start: camera motion of the frame before. The background is relative to the ego-motion, as ``residual`` is.
    """
    points = grid_points(flow.shape[0], flow.shape[1], camera.width, camera.height)
    known = np.isfinite(residual[..., 0])
    now, earlier = normalised(points, camera), normalised(points - flow, camera)
    motion = estimate_pose(earlier, now, known, camera.fx, start)
    if motion is None:
        return None
    lines = epipolar_lines(earlier, motion)
    s = lines.position(now)
    reach_px = np.hypot(lines.towards[..., 0], lines.towards[..., 1]) * camera.fx
    ground = ground_below(earlier, lines.inverse_depth(s), reach_px, known & (now[..., 1] > 0.0))
    least = ground.least_inverse_depth(earlier) if ground else np.zeros_like(s)
    object_flow = (now - lines.at(np.maximum(s, lines.from_inverse_depth(least)))) * [camera.fx, camera.fy]
    return StaticScene(background_of_static_points(residual, object_flow, flow, config), motion)
