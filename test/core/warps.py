"""Views of a textured plane under exact warps, and what the ego-motion stage makes of them."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.preprocessing.stage import Preprocessor
from motion_detect_ros.core.types import EgoMotion

WIDTH, HEIGHT, PERIOD_NS = 640, 480, 40_000_000
CORNERS = np.array([[0, 0, 1], [WIDTH - 1, 0, 1], [0, HEIGHT - 1, 1], [WIDTH - 1, HEIGHT - 1, 1]], float)


def world(seed: int, height: int = HEIGHT + 320, width: int = WIDTH + 320) -> np.ndarray:
    """Texture at several scales, band-limited so that resampling it is exact to well under a grey level."""
    random = np.random.default_rng(seed)
    layers = [cv2.resize(random.normal(size=(height // s + 2, width // s + 2)).astype(np.float32), (width, height),
                         interpolation=cv2.INTER_CUBIC) * s for s in (4, 8, 16, 32)]
    picture = cv2.GaussianBlur(sum(layers), (0, 0), 1.2)
    return cv2.normalize(picture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def blocks(seed: int, height: int, width: int, low: int, high: int) -> np.ndarray:
    """Texture of 4 x 4 pixels, grey values from low to below high, as float64."""
    coarse = np.random.default_rng(seed).integers(low, high, (height // 4 + 1, width // 4 + 1), dtype=np.int64)
    return np.kron(coarse, np.ones((4, 4), np.int64))[:height, :width].astype(np.float64)


def view(texture: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """What the camera sees after the background moved by ``matrix`` (previous pixel -> current pixel)."""
    offset = np.array([[1, 0, -160], [0, 1, -160], [0, 0, 1]], float)  # world -> previous view
    return cv2.warpAffine(texture, (matrix @ offset)[:2], (WIDTH, HEIGHT), flags=cv2.INTER_LANCZOS4)


def about_centre(angle_deg: float, scale: float, dx: float, dy: float) -> np.ndarray:
    turn = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), angle_deg, scale)
    matrix = np.vstack([turn, [0, 0, 1]])
    matrix[:2, 2] += dx, dy
    return matrix


def estimate(previous: np.ndarray, current: np.ndarray, config: PipelineConfig | None = None) -> EgoMotion:
    config = config or PipelineConfig()
    stage, prepare = EgoMotionStage(config), Preprocessor(config.preprocessing)
    stage.process(prepare.process(previous, PERIOD_NS))
    return stage.process(prepare.process(current, 2 * PERIOD_NS))


def corner_error(estimated: np.ndarray, true: np.ndarray) -> float:
    return float(np.linalg.norm(((CORNERS @ estimated.T) - (CORNERS @ true.T))[:, :2], axis=1).max())


#: Families of warps: a random generator -> the arguments of ``about_centre``.
DRAWS: dict[str, Callable[[np.random.Generator], tuple[float, float, float, float]]] = {
    'translation': lambda r: (0, 1, r.uniform(-20, 20), r.uniform(-20, 20)),
    'rotation': lambda r: (r.uniform(-10, 10), 1, 0, 0),
    'scale': lambda r: (0, r.uniform(0.9, 1.1), 0, 0),
    'all': lambda r: (r.uniform(-10, 10), r.uniform(0.9, 1.1), r.uniform(-20, 20), r.uniform(-20, 20)),
}


def with_a_mover(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Earlier and later view, and the background's warp: of family ``kind``, 20 % of the picture moves otherwise."""
    random = np.random.default_rng(seed)
    matrix = about_centre(*DRAWS[kind](random))
    texture, other = world(seed), world(seed + 100, HEIGHT, WIDTH)
    previous, current = view(texture, np.eye(3)), view(texture, matrix)
    # a window that moves by 12 px against everything else
    w, h = round(WIDTH * 0.447), round(HEIGHT * 0.447)
    x, y = random.integers(20, WIDTH - w - 40), random.integers(20, HEIGHT - h - 40)
    previous[y:y + h, x:x + w] = other[y:y + h, x:x + w]
    current[y:y + h, x + 12:x + 12 + w] = other[y:y + h, x:x + w]
    return previous, current, matrix
