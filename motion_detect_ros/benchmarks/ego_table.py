"""Ego-motion methods and families against exact warps: the tables of docs/method.md.

    python -m motion_detect_ros.benchmarks.ego_table [--seeds N]

Pairs of textured 640 x 480 views; in the first table a window of 20 % of the picture moves by 12 px against the rest.
Error: largest distance of a corner from where it belongs, median over the seeds, as measured, without smoothing. Time:
median CPU time of one core.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from motion_detect_ros.core.config import EgoMotionConfig
from motion_detect_ros.core.ego_motion.methods import METHODS, make_method
from motion_detect_ros.core.geometry.motion_models import FAMILIES, displacement, model_family, normalised
from motion_detect_ros.core.types import ByteArray, DoubleArray, FloatArray, PreparedFrame

WIDTH, HEIGHT, MARGIN, PERIOD_NS = 640, 480, 160, 40_000_000
CENTRE = np.array([WIDTH / 2.0, HEIGHT / 2.0])
CORNERS = np.array([[0, 0], [WIDTH - 1, 0], [0, HEIGHT - 1], [WIDTH - 1, HEIGHT - 1]], np.float32)
#: Side of the window that moves otherwise, share of the picture's, and its step, pixels.
OTHER_SHARE, OTHER_STEP_PX = 0.447, 12

#: (N, 2) pixels -> (N, 2) pixels they move by.
Warp = Callable[[DoubleArray], DoubleArray]


def texture(seed: int, height: int = HEIGHT + 2 * MARGIN, width: int = WIDTH + 2 * MARGIN) -> FloatArray:
    """(height, width) grey values with detail at several scales."""
    random = np.random.default_rng(seed)
    layers = [cv2.resize(random.normal(size=(height // s + 2, width // s + 2)).astype(np.float32), (width, height),
                         interpolation=cv2.INTER_CUBIC) * s for s in (4, 8, 16, 32)]
    picture = cv2.GaussianBlur(np.sum(layers, axis=0), (0, 0), 1.2)
    return np.asarray(cv2.normalize(picture, None, 5, 250, cv2.NORM_MINMAX), np.float32)


def view(world: FloatArray, warp: Warp | None = None) -> ByteArray:
    """What is seen of ``world`` after ``warp``, by cubic splines where each pixel comes from."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    here = np.stack([x.ravel(), y.ravel()], axis=1)
    origin = here
    for _ in range(20 if warp else 0):  # solves origin + warp(origin) = here
        origin = here - warp(origin) if warp else here
    grey = map_coordinates(world, [origin[:, 1] + MARGIN, origin[:, 0] + MARGIN], order=3, mode='mirror')
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8).reshape(HEIGHT, WIDTH)


def rigid(turn_deg: float, scale: float, dx: float, dy: float) -> Warp:
    """Rotation and zoom about the centre, then a shift."""
    turn = np.radians(turn_deg)
    linear = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return lambda p: (p - CENTRE) @ (linear - np.eye(2)).T + (dx, dy)


def polynomial(name: str, random: np.random.Generator) -> Warp:
    """A motion that family ``name`` can represent: a random member of it, up to some 20 px at the corners."""
    family = model_family(name)
    free = random.uniform(-1.0, 1.0, 8) * np.array([8, 12, 12, 8, 12, 12, 8, 8])
    theta = family.basis @ np.linalg.lstsq(family.basis, free, rcond=None)[0]
    return lambda p: displacement(family, theta, normalised(p.astype(np.float32), CENTRE), CENTRE)


KINDS: dict[str, Callable[[np.random.Generator], Warp]] = {
    'translation': lambda r: rigid(0, 1, r.uniform(-20, 20), r.uniform(-20, 20)),
    'rotation': lambda r: rigid(r.uniform(-10, 10), 1, 0, 0),
    'scale': lambda r: rigid(0, r.uniform(0.9, 1.1), 0, 0),
    'all': lambda r: rigid(r.uniform(-10, 10), r.uniform(0.9, 1.1), r.uniform(-20, 20), r.uniform(-20, 20)),
}


def pair(seed: int, warp: Warp, disturbed: bool) -> list[PreparedFrame]:
    """Two views of one texture. disturbed: a window of the picture moves otherwise."""
    world = texture(seed)
    pictures = [view(world), view(world, warp)]
    if disturbed:
        random, other = np.random.default_rng(seed), texture(seed + 1000, HEIGHT, WIDTH).astype(np.uint8)
        w, h = round(WIDTH * OTHER_SHARE), round(HEIGHT * OTHER_SHARE)
        x, y = random.integers(20, WIDTH - w - 40), random.integers(20, HEIGHT - h - 40)
        for picture, step in zip(pictures, (0, OTHER_STEP_PX), strict=True):
            picture[y:y + h, x + step:x + step + w] = other[y:y + h, x:x + w]
    return [PreparedFrame(picture, 1.0, WIDTH, HEIGHT, index * PERIOD_NS) for index, picture in enumerate(pictures)]


def measure(frames: Sequence[PreparedFrame], warp: Warp, method: str, model: str) -> tuple[float, float]:
    """Corner error, pixels, infinite without an estimate, and milliseconds."""
    measurer = make_method(EgoMotionConfig(method=method, model=model))
    start = time.thread_time()
    fit = measurer.measure(frames[0], frames[1]).fit
    spent = (time.thread_time() - start) * 1e3
    if fit is None:
        return float('inf'), spent
    found = displacement(model_family(model), fit.theta, normalised(CORNERS, CENTRE), CENTRE)
    return float(np.linalg.norm(found - warp(CORNERS.astype(np.float64)), axis=1).max()), spent


def rows(cases: dict[str, tuple[str, Callable[[int], Warp]]], seeds: int, disturbed: bool) -> Iterator[str]:
    """One row for each case: name -> (model, seed -> warp)."""
    yield '| motion | ' + ' | '.join(f'`{method}` px, ms' for method in METHODS) + ' |'
    yield '|---|' + '---|' * len(METHODS)
    for name, (model, warp_of) in cases.items():
        found: dict[str, list[tuple[float, float]]] = {method: [] for method in METHODS}
        for seed in range(seeds):
            warp = warp_of(seed)
            frames = pair(seed, warp, disturbed)
            for method, values in found.items():
                values.append(measure(frames, warp, method, model))
        medians = [np.median(values, axis=0) for values in found.values()]
        yield f'| {name} | ' + ' | '.join(f'{error:.3f}, {spent:.0f}' for error, spent in medians) + ' |'


def tables(seeds: int) -> Iterator[str]:
    """The lines of all tables, as markdown."""
    warm = pair(0, rigid(5.0, 1.05, 3.0, 2.0), False)
    for method in METHODS:
        make_method(EgoMotionConfig(method=method)).measure(warm[0], warm[1])
    yield 'Affine fit, 20 % of the picture moves otherwise:'
    yield ''
    yield from rows({name: ('affine', lambda seed, draw=draw: draw(np.random.default_rng(seed)))  # type: ignore[misc]
                     for name, draw in KINDS.items()}, seeds, True)
    yield ''
    yield 'Each family on a motion of its own:'
    yield ''
    yield from rows({name: (name, lambda seed, name=name: polynomial(name, np.random.default_rng(seed)))  # type: ignore[misc]
                     for name in FAMILIES}, seeds, False)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--seeds', type=int, default=12, metavar='N', help='pairs for each row (12)')
    given = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    for line in tables(given.seeds):
        print(line, flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
