"""The ROS nodes, one a module.

Loading one takes a second, numba and OpenCV included. A SIGINT or SIGTERM in that time ends the process as it does
later, without a word and with exit code 0: nothing has been begun that would have to be ended.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path


def _is_a_node_starting() -> bool:
    """Whether this process is ``python -m`` of a node, or its console script; not for those who import one."""
    program = Path(sys.argv[0]).name if sys.argv else ''
    if program == '-m':
        return any(word.startswith(f'{__name__}.') for word in sys.orig_argv)
    return program != '__init__' and Path(__file__).with_name(f'{program}.py').is_file()


if _is_a_node_starting():
    for _number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(_number, lambda *_: os._exit(0))
