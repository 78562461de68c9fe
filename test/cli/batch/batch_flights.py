"""Short bags for the tests of many inputs, and a trap that kills whoever works on one of them."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import numpy as np

from motion_detect_ros.sources.bags import BagWriter
from motion_detect_ros.sources.synthetic import FlightConfig, SyntheticFlight

FRAMES, PERIOD_NS = 20, 50_000_000
#: Until something has happened on a machine that others use too.
PATIENCE_S = 300.0


@cache
def pictures() -> tuple[np.ndarray, ...]:
    """The built-in flight, small."""
    flight = SyntheticFlight(FlightConfig(width=320, height=180, focal_px=240.0, frames=FRAMES + 5))
    return tuple(frame.image for frame in flight)


def write_flight(path: Path, number: int = 0, frames: int = FRAMES) -> Path:
    """A bag of the flight from frame ``number // 2`` on, mirrored where the number is odd: no two the same."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with BagWriter(path, compress=False, chunk_bytes=200_000) as bag:
        for index in range(frames):
            image = pictures()[(number // 2 + index) % len(pictures())]
            bag.write_image(image[:, ::-1] if number % 2 else image, 10**18 + index * PERIOD_NS)
    return path


#: Runs in every Python process that is started with it: one that has written 1 kB of the file kills itself, so often as
#: there are marker files to take away.
_TRAP = """
import os, signal, sys, threading, time
FILE, MARKERS = {file!r}, {markers!r}

def watch():
    while not os.path.exists(FILE) or os.path.getsize(FILE) < 1000:
        time.sleep(0.001)
    for marker in os.listdir(MARKERS):
        os.unlink(os.path.join(MARKERS, marker))
        os.kill(os.getpid(), signal.SIGKILL)

def hook(event, arguments):
    if event == 'open' and str(arguments[0]) == FILE and 'w' in str(arguments[1]):
        threading.Thread(target=watch, daemon=True).start()

sys.addaudithook(hook)
"""


def trap(folder: Path, file: Path, times: int) -> dict[str, str]:
    """Environment in which a process is killed (SIGKILL) while it writes ``file``, ``times`` times in all."""
    markers = folder / 'markers'
    markers.mkdir()
    for number in range(times):
        (markers / str(number)).touch()
    (folder / 'sitecustomize.py').write_text(_TRAP.format(file=str(file), markers=str(markers)))
    paths = [str(folder), *filter(None, [os.environ.get('PYTHONPATH')])]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(paths)}


def unused(folder: Path) -> int:
    """How many of the kills of ``trap`` did not take place."""
    return len([*(folder / 'markers').iterdir()])
