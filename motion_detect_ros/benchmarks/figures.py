"""matplotlib, which only the pictures of the documents need: the extra ``plots``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from motion_detect_ros.core.errors import BackendError

DPI = 110


def make_figure(width_px: int, height_px: int) -> Any:
    """An empty ``matplotlib.figure.Figure``, laid out by itself. Raises: BackendError where matplotlib is missing."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise BackendError(f"pictures: expected matplotlib ({error}); "
                           "install it: pip install 'motion_detect_ros[plots]'") from None
    return Figure(figsize=(width_px / DPI, height_px / DPI), dpi=DPI, layout='constrained')


def save(figure: Any, path: Path) -> None:
    """Write a PNG; its folder is made where it is missing. Raises: BackendError where it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={'Software': None})
    except OSError as error:
        raise BackendError(f'{path}: cannot be written: {error.strerror}') from None
