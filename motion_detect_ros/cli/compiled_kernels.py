"""Kernels that a command needs: where the cache of numba lacks any, they are compiled first, and it says so."""

from __future__ import annotations

import sys
from contextlib import suppress
from dataclasses import replace
from functools import partial

from motion_detect_ros.cli.progress import Board
from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import MotionDetectError
from motion_detect_ros.core.pipeline import MIN_WARM_UP_PX
from motion_detect_ros.kernel_compiler import kind_of, signatures, warm_up_ahead

COMPILING = 'compiling kernels; this takes up to a minute, once after an installation'


def compile_missing(*configs: PipelineConfig) -> None:
    """What pipelines of these settings need, by all cores, told on stderr; at once where all of it is there.

    What is wrong with settings is for who uses them to say.
    """
    with Board(1) as board:
        told = False

        def tell(count: int, total: int) -> None:
            nonlocal told
            if not told:
                told = True
                print(COMPILING, file=sys.stderr, flush=True)
            board.advance('kernels', min(count, total), total)

        for config in configs:
            total = sum(kind_of(config, True) in each.kinds for each in signatures())
            small = replace(config.preprocessing, min_width_px=0, max_width_px=MIN_WARM_UP_PX)  # with the same kernels
            with suppress(MotionDetectError):
                warm_up_ahead(replace(config, preprocessing=small), True, partial(tell, total=total))
