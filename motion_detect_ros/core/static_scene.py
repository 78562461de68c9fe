"""Background in three dimensions: what a static point can do, and by how much each cell of the flow exceeds it.

Three tests in one figure. A static point lies on its epipolar line, in front of the camera, and not below the ground;
a cell's own motion is its distance to the part of the line that all three allow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_detect_ros.core.background import Background, background_in_space
from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.epipolar import CameraMotion, epipolar_lines, estimate_motion, normalised
from motion_detect_ros.core.ground import GroundPlane, fit_ground
from motion_detect_ros.core.types import BoolArray, CameraModel, DoubleArray, FloatArray
from motion_detect_ros.core.warp import grid_points

#: Noise of the inverse depth: of the flow, pixels, and share of itself.
DEPTH_NOISE_PX, DEPTH_NOISE_SHARE = 0.3, 0.05


@dataclass(frozen=True)
class StaticScene:
    """``background``: as for a planar scene; ``motion`` of the camera; ``ground`` where there is one."""

    background: Background
    motion: CameraMotion
    ground: GroundPlane | None


def guessed_camera(width: int, height: int, focal_share: float) -> CameraModel:
    """A camera that looks along the middle of the picture, focal length a share of its width."""
    focal = focal_share * width
    return CameraModel(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)


def fit_static_scene(
    flow: FloatArray, residual: FloatArray, camera: CameraModel, config: BackgroundConfig,
    start: CameraMotion | None = None,
) -> StaticScene | None:
    """Camera motion and ground from the flow; None where the flow does not determine them.

    flow: (gh, gw, 2) total displacement, pixels; residual: the same with the ego-motion taken out, NaN = invalid;
    start: camera motion of the frame before. The background is relative to the ego-motion, as ``residual`` is.
    """
    points = grid_points(flow.shape[0], flow.shape[1], camera.width, camera.height)
    known = np.isfinite(residual[..., 0])
    now, earlier = normalised(points, camera), normalised(points - flow, camera)
    motion = estimate_motion(earlier, now, known, camera.fx, start)
    if motion is None:
        return None
    lines = epipolar_lines(earlier, motion)
    s = lines.position(now)
    reach_px = np.hypot(lines.towards[..., 0], lines.towards[..., 1]) * camera.fx
    ground = ground_below(earlier, lines.inverse_depth(s), reach_px, known & (now[..., 1] > 0.0))
    least = ground.least_inverse_depth(earlier) if ground else np.zeros_like(s)
    own = (now - lines.at(np.maximum(s, lines.from_inverse_depth(least)))) * [camera.fx, camera.fy]
    return StaticScene(background_in_space(residual, own, flow, config), motion, ground)


def ground_below(
    earlier: DoubleArray, inverse_depth: DoubleArray, reach_px: DoubleArray, below: BoolArray,
    noise_px: float = DEPTH_NOISE_PX,
) -> GroundPlane | None:
    """The ground under the points marked ``below``.

    earlier: (..., 2) normalised; inverse_depth: (...,); reach_px: (...,) pixels that a point moves for one unit of s;
    noise_px: of the points' motion, one deviation.
    """
    use = below & (inverse_depth > 0.0)
    inverse = inverse_depth[use]
    sigma = noise_px / np.maximum(reach_px[use], 1e-3) + DEPTH_NOISE_SHARE * inverse + 1e-4
    return fit_ground(earlier[use], inverse, sigma)
