"""The two ways a function of the renderer is compiled; typed, so that mypy still checks what it decorates."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from motion_detect_ros.core import kernels

F = TypeVar('F', bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compiled loop over pixels: cached on disk, no GIL, no fastmath (the bytes must not vary)."""
    return cast(F, kernels.kernel(error_model='numpy')(function))


def inlined(function: F) -> F:
    """Compiled and merged into its caller: per pixel, the call itself would cost more than the work."""
    return cast(F, kernels.kernel(error_model='numpy', forceinline=True)(function))
