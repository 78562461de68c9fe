"""A street with exact flow: ground, two walls and boxes, seen by a camera that drives and turns."""

from __future__ import annotations

import cv2
import numpy as np

from motion_detect_ros.core.types import CameraModel

CAMERA = CameraModel(640, 360, 500.0, 500.0, 319.5, 169.5)
ROWS, COLUMNS = 90, 160
#: Camera height over the ground and half the width of the street, metres.
HEIGHT, HALF_WIDTH, END = 1.5, 8.0, 60.0


def pixels() -> np.ndarray:
    """(ROWS, COLUMNS, 2) pixel at the centre of every cell."""
    x, y = np.meshgrid((np.arange(COLUMNS) + 0.5) * 4 - 0.5, (np.arange(ROWS) + 0.5) * 4 - 0.5)
    return np.stack([x, y], axis=-1)


def rays() -> np.ndarray:
    """(ROWS, COLUMNS, 3) directions with z = 1."""
    p = pixels()
    return np.dstack([(p[..., 0] - CAMERA.cx) / CAMERA.fx, (p[..., 1] - CAMERA.cy) / CAMERA.fy,
                      np.ones((ROWS, COLUMNS))])


def street_depth() -> np.ndarray:
    """(ROWS, COLUMNS) metres to the ground, the walls or the end of the street."""
    direction = rays()
    with np.errstate(divide='ignore'):
        ground = np.where(direction[..., 1] > 0, HEIGHT / direction[..., 1], np.inf)
        wall = HALF_WIDTH / np.abs(direction[..., 0])
    return np.minimum(np.minimum(ground, wall), END)


def motion(turn_rad: tuple[float, float, float], travel_m: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """R and t with X_now = R X_earlier + t, of a camera that turns and travels (its own axes, earlier frame)."""
    rotation = cv2.Rodrigues(np.array(turn_rad))[0].T
    return rotation, -rotation @ np.array(travel_m)


def flow(
    depth: np.ndarray, rotation: np.ndarray, translation: np.ndarray, own_m: np.ndarray | None = None,
) -> np.ndarray:
    """(ROWS, COLUMNS, 2) exact flow into the current frame; own_m: (ROWS, COLUMNS, 3) what each point itself moved."""
    now = rays() * depth[..., None]
    earlier = (now - translation) @ rotation  # R^T (X - t)
    if own_m is not None:
        earlier = earlier - own_m
    q = np.stack([CAMERA.fx * earlier[..., 0] / earlier[..., 2] + CAMERA.cx,
                  CAMERA.fy * earlier[..., 1] / earlier[..., 2] + CAMERA.cy], axis=-1)
    return (pixels() - q).astype(np.float32)


def box_cells(left: int, top: int, right: int, bottom: int) -> np.ndarray:
    """(ROWS, COLUMNS) True for the cells of a rectangle, in cells."""
    mask = np.zeros((ROWS, COLUMNS), bool)
    mask[top:bottom, left:right] = True
    return mask
