"""The town as flat arrays, and the plane-to-pixel maps of its patches for one camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from motion_detect_ros.core.types import BoolArray, DoubleArray
from motion_detect_ros.sources.synthetic.camera_path import CameraPose
from motion_detect_ros.sources.synthetic.layout import PERIOD_M
from motion_detect_ros.sources.synthetic.solids import Patches, join, patch
from motion_detect_ros.sources.synthetic.textures import Material
from motion_detect_ros.sources.synthetic.town import Body

IndexArray = npt.NDArray[np.int64]

GROUND = 0
#: Nothing is drawn closer to the camera than this, metres.
_NEAR_M = 1.0
#: A plane seen more edge-on than this (volume of u, v and the line of sight over their lengths) is not drawn.
_EDGE_ON = 1e-7
#: Rays that look less far down than this are cut when the visible ground is estimated.
_LEAST_SLOPE = 0.2


@dataclass(frozen=True)
class Scene:
    """n patches of m bodies; patch 0 and body 0 are the ground, which has no edge.

    ``body``: (n,) body of each patch; ``start``: (m, 2) position at frame 0, metres; ``ahead``: (m, 2) unit heading;
    ``speed``: (m,) m/s; ``ident``: (m,) id in the truth, 0 = scenery; ``size``: (m, 3) length, width, height, metres;
    ``reach``: (m,) distance from the body's origin to its farthest point, metres.
    """

    patches: Patches
    body: IndexArray
    start: DoubleArray
    ahead: DoubleArray
    speed: DoubleArray
    ident: IndexArray
    size: DoubleArray
    reach: DoubleArray

    def positions(self, time_s: float) -> DoubleArray:
        """(m, 2) float64 where the bodies are, metres, each counted on from its start without wrapping."""
        return np.asarray(self.start + self.speed[:, None] * time_s * self.ahead)


@dataclass(frozen=True)
class View:
    """What one camera may see at one instant.

    ``pose``; ``position``: (m, 2) bodies, moved to the copy of the town nearest to the view; ``listed``: patches to
    draw; ``to_pixel``: (n, 3, 3) float64, maps (s, t, 1) of a patch to pixel * depth; ``to_patch``: (n, 3, 3), its
    inverse, maps (x, y, 1) to (s, t, 1) / depth; both zero for patches not listed.
    """

    pose: CameraPose
    position: DoubleArray
    listed: IndexArray
    to_pixel: DoubleArray
    to_patch: DoubleArray


def make_scene(bodies: tuple[Body, ...]) -> Scene:
    """Flatten the bodies of a town and put the ground under them."""
    ground = patch((0, 0, 0), (PERIOD_M, 0, 0), (0, PERIOD_M, 0), Material.GROUND, (1, 1, 1))
    owners = [np.zeros(1, np.int64)] + [np.full(len(b.patches), i + 1) for i, b in enumerate(bodies)]
    plain = [(0.0, 0.0, 0.0, 0.0, 0)] + [(b.x, b.y, b.heading, b.speed, b.ident) for b in bodies]
    x, y, heading, speed, ident = (np.array(column) for column in zip(*plain, strict=True))
    reach = [0.0] + [float(np.linalg.norm(b.patches.corners().reshape(-1, 3), axis=1).max()) for b in bodies]
    return Scene(
        join([ground, *(b.patches for b in bodies)]), np.concatenate(owners), np.stack([x, y], axis=1),
        np.stack([np.cos(heading), np.sin(heading)], axis=1), speed, ident.astype(np.int64),
        np.array([(0.0, 0.0, 0.0)] + [b.size for b in bodies]), np.array(reach))


def look(scene: Scene, pose: CameraPose, width: int, height: int) -> View:
    """The view of ``pose``: bodies placed at its time, patches that can be in the picture listed."""
    middle = _ground_in_view(pose, width, height)
    position = scene.positions(pose.time_s)
    position += PERIOD_M * np.rint((middle - position) / PERIOD_M)
    position[GROUND] = 0.0
    bodies = _bodies_in_view(scene, pose, position, width, height)
    candidates = np.flatnonzero(bodies[scene.body])
    to_pixel = plane_maps(scene, candidates, pose, position)
    drawable = _drawable(scene, candidates, to_pixel[candidates])
    listed = candidates[drawable]
    to_patch = np.zeros_like(to_pixel)
    to_patch[listed] = np.linalg.inv(to_pixel[listed])
    return View(pose, position, listed, to_pixel, to_patch)


def plane_maps(scene: Scene, listed: IndexArray, pose: CameraPose, position: DoubleArray) -> DoubleArray:
    """(n, 3, 3) float64 maps K [u v o] from (s, t, 1) to pixel * depth of the patches ``listed``, zero for the rest.

    Source: Hartley & Zisserman 2004, section 8.1 (a plane's points under a camera).
    """
    maps = np.zeros((len(scene.patches), 3, 3))
    camera = pose.intrinsic @ pose.rotation
    ahead, where = scene.ahead[scene.body[listed]], position[scene.body[listed]]
    lift = np.concatenate([where, np.zeros((len(listed), 1))], axis=1) - pose.centre
    for column, vectors in enumerate((scene.patches.u, scene.patches.v, scene.patches.origin)):
        world = turn(vectors[listed], ahead) + (lift if column == 2 else 0.0)
        maps[listed, :, column] = world @ camera.T
    return maps


def turn(vectors: DoubleArray, ahead: DoubleArray) -> DoubleArray:
    """(n, 3) vectors of bodies turned into the world by their unit headings (n, 2)."""
    x, y = vectors[:, 0], vectors[:, 1]
    cos, sin = ahead[:, 0], ahead[:, 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y, vectors[:, 2]], axis=1)


def corner_depths_and_pixels(scene: Scene, listed: IndexArray, maps: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
    """Depth (k, 4), metres, and pixel (k, 4, 2) of the corners of ``listed``; ``maps``: (k, 3, 3) of the same."""
    u, v, origin = maps[..., 0], maps[..., 1], maps[..., 2]
    far = np.where(scene.patches.triangle[listed, None], origin, origin + u + v)
    points = np.stack([origin, origin + u, origin + v, far], axis=1)
    depth = np.where(points[..., 2:] > 0, points[..., 2:], np.inf)
    return points[..., 2], points[..., :2] / depth


def _drawable(scene: Scene, candidates: IndexArray, maps: DoubleArray) -> BoolArray:
    """In front of the camera and not edge-on; the ground always."""
    depth, _ = corner_depths_and_pixels(scene, candidates, maps)
    volume = np.abs(np.linalg.det(maps))
    lengths = np.prod(np.linalg.norm(maps, axis=1), axis=1)
    return np.asarray(((depth > _NEAR_M).all(axis=1) & (volume > _EDGE_ON * lengths)) | (candidates == GROUND))


def _bodies_in_view(scene: Scene, pose: CameraPose, position: DoubleArray, width: int, height: int) -> BoolArray:
    """(m,) bodies whose enclosing sphere meets the cone that encloses the picture; always the ground."""
    points = np.concatenate([position, np.zeros((len(position), 1))], axis=1)
    x, y, z = ((points - pose.centre) @ pose.rotation.T).T
    focal = pose.intrinsic[0, 0]
    inside = z > _NEAR_M
    for offset, half in ((x, width / 2 / focal), (y, height / 2 / focal)):
        inside &= np.abs(offset) - half * z < scene.reach * np.hypot(1.0, half)
    inside[GROUND] = True
    return np.asarray(inside)


def _ground_in_view(pose: CameraPose, width: int, height: int) -> DoubleArray:
    """(2,) middle of the ground under the picture's corners, metres."""
    pixels = np.array([(x, y, 1.0) for x in (0, width - 1) for y in (0, height - 1)])
    rays = pixels @ np.linalg.inv(pose.intrinsic).T @ pose.rotation
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    run = pose.centre[2] / np.maximum(-rays[:, 2:], _LEAST_SLOPE)
    return np.asarray((pose.centre[:2] + rays[:, :2] * run).mean(axis=0))
