"""Three-dimensional background: object flow as the distance of each cell from the positions of a static point.

A static point lies on its epipolar line, in front of the camera, and not below the ground. A cell's object flow is its
distance to the part of the line that satisfies all three.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from motion_detect_ros.core.background.planar import Background
from motion_detect_ros.core.config import BackgroundConfig
from motion_detect_ros.core.geometry.epipolar import PoseEstimate, estimate_pose, infinitely_far, normalised
from motion_detect_ros.core.geometry.ground_plane import GroundPlane, ground_below
from motion_detect_ros.core.geometry.order_statistics import median
from motion_detect_ros.core.geometry.robust import RAYLEIGH_MEDIAN
from motion_detect_ros.core.geometry.warp import grid_points
from motion_detect_ros.core.kernels import kernel
from motion_detect_ros.core.types import BoolArray, CameraModel, DoubleArray, FloatArray

#: No ground: static points may be infinitely far.
NO_LIMIT = np.zeros(3)


@dataclass(frozen=True)
class StaticScene:
    """``background``: as for a planar scene; ``motion`` of the camera.

    ``against``: (gh, gw), cells that lie on the wrong side of their lines: behind what is infinitely far, or below the
    ground.
    """

    background: Background
    motion: PoseEstimate
    against: BoolArray


def fit_static_scene(
    flow: FloatArray, residual: FloatArray, magnitude: FloatArray, camera: CameraModel, config: BackgroundConfig,
    start: PoseEstimate | None = None,
) -> StaticScene | None:
    """Camera motion and background from the flow; None where the flow does not determine them.

    flow: (gh, gw, 2) total displacement, pixels; residual: the same without the ego-motion, NaN = invalid;
    magnitude: (gh, gw) length of the total flow, pixels; start: camera motion of the frame before. The background is
    relative to the ego-motion, as ``residual`` is. Its noise is the measured distance from static points, at least
    ``noise_floor_px``, plus a share of the total flow.
    """
    rows, columns = flow.shape[:2]
    now = _grid(rows, columns, camera)
    known = np.isfinite(residual[..., 0])
    earlier = normalised(grid_points(rows, columns, camera.width, camera.height) - flow, camera)
    motion = estimate_pose(earlier, now, known, camera.fx, start)
    if motion is None:
        return None
    position, ground = _along_lines(earlier, now, known, motion, camera.fx)
    limit = NO_LIMIT if ground is None else ground.limit
    still, own, against = np.empty(flow.shape, np.float32), np.empty(known.size), np.empty(known.shape, np.bool_)
    count = _closest_static(
        earlier.reshape(-1, 2), now.reshape(-1, 2), position, limit, motion.rotation, motion.direction,
        camera.fx, camera.fy, np.ascontiguousarray(residual).reshape(-1, 2), still.reshape(-1, 2), own, against.ravel())
    spread_px = float(median(own[:count])) / RAYLEIGH_MEDIAN
    sigma_px = (max(config.noise_floor_px, spread_px) + config.depth_noise_share * magnitude).astype(np.float32)
    return StaticScene(Background(still, sigma_px, smooth=False, spread_px=spread_px), motion, against)


def warm_up() -> None:
    """Compiles the kernels of this model: pictures of a plane do not reach them."""
    camera = CameraModel.guessed(320, 180, 1.0)
    ahead, places = PoseEstimate(np.eye(3), np.array([0.0, 0.0, -1.0]), 1.0), _grid(45, 80, camera)
    flow = (0.1 * camera.fx * places * np.maximum(places[..., 1:], 0.0)).astype(np.float32)  # over level ground
    scene = fit_static_scene(flow, flow, np.zeros(flow.shape[:2], np.float32), camera, BackgroundConfig(), ahead)
    if scene is not None:
        scene.background.behind(places[..., 0] > 0.0)


@lru_cache(maxsize=8)
def _grid(rows: int, columns: int, camera: CameraModel) -> DoubleArray:
    """(rows, columns, 2) normalised centres of the cells."""
    centres = normalised(grid_points(rows, columns, camera.width, camera.height), camera)
    centres.flags.writeable = False
    return centres


def _along_lines(
    earlier: DoubleArray, now: DoubleArray, known: BoolArray, motion: PoseEstimate, focal_px: float,
) -> tuple[DoubleArray, GroundPlane | None]:
    """(cells,) position of each cell on its line, and the ground that these imply."""
    position, inverse_depth, reach_px = np.empty(known.size), np.empty(known.shape), np.empty(known.shape)
    _positions(earlier.reshape(-1, 2), now.reshape(-1, 2), motion.rotation, motion.direction, focal_px,
               position, inverse_depth.ravel(), reach_px.ravel())
    return position, ground_below(earlier, inverse_depth, reach_px, known & (now[..., 1] > 0.0))


@kernel(error_model='numpy')
def _positions(earlier, now, rotation, direction, focal_px, position, inverse_depth, reach_px):  # type: ignore[no-untyped-def]
    """As ``EpipolarLines``: (N,) position of ``now`` on its line, the inverse depth there, pixels of a unit of s."""
    x, y, z = direction[0], direction[1], direction[2]
    for n in range(len(earlier)):
        fx, fy, depth = infinitely_far(earlier[n, 0], earlier[n, 1], rotation)
        vx, vy = x - z * fx, y - z * fy
        squared = vx * vx + vy * vy
        s = ((now[n, 0] - fx) * vx + (now[n, 1] - fy) * vy) / max(squared, 1e-12)
        position[n] = s
        inverse_depth[n] = s * depth / max(1.0 - s * z, 1e-3)
        reach_px[n] = squared ** 0.5 * focal_px


@kernel(error_model='numpy')
def _closest_static(  # type: ignore[no-untyped-def]
    earlier, now, position, limit, rotation, direction, focal_x, focal_y, residual, still, own, against,
):
    """``still``: (N, 2) ``residual`` of the static point that is closest to ``now``, pixels.

    position: (N,) of ``now`` on its line; limit: (3,) inverse depth that no static point falls below, ``GroundPlane``.
    own: (N,) gets the distances between both where ``residual`` is known, pixels. against: (N,) gets where the way
    between both is rather along the line, backwards, than across. Returns how many are known.
    """
    x, y, z = direction[0], direction[1], direction[2]
    count = 0
    for n in range(len(earlier)):
        fx, fy, depth = infinitely_far(earlier[n, 0], earlier[n, 1], rotation)
        inverse = max(limit[0] * earlier[n, 0] + limit[1] * earlier[n, 1] + limit[2], 0.0)
        s = max(position[n], inverse / max(depth + inverse * z, 1e-6))
        vx, vy = (x - z * fx) * focal_x, (y - z * fy) * focal_y
        across, down = (now[n, 0] - fx) * focal_x - s * vx, (now[n, 1] - fy) * focal_y - s * vy
        back = -(across * vx + down * vy)
        against[n] = back > 0.0 and 2.0 * back * back > (across * across + down * down) * (vx * vx + vy * vy)
        still[n, 0], still[n, 1] = residual[n, 0] - across, residual[n, 1] - down
        own[count] = (across * across + down * down) ** 0.5
        count += np.isfinite(residual[n, 0])
    return count
