"""What the commands of this folder have in common."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec

from motion_detect_ros.core.errors import MotionDetectError

_Arguments = ParamSpec('_Arguments')


def reports_errors(main: Callable[_Arguments, int]) -> Callable[_Arguments, int]:
    """Decorates a ``main``: what the package raises on purpose is printed in one line to stderr and exit code 2."""
    @wraps(main)
    def reporting(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> int:
        try:
            return main(*args, **kwargs)
        except MotionDetectError as error:
            print(f'error: {error}', file=sys.stderr)
            return 2
    return reporting
