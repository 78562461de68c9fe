"""The process that compiles kernels: what stands on a line of its standard input, a line of its output for each.

It imports nothing but the modules of these kernels: two of them starting beside a node are what its first start waits
for.
"""

from __future__ import annotations

import gc
import json
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from numba import types


@dataclass(frozen=True)
class Signature:
    """A kernel and types of its arguments. ``kernel``: module and function, ``core.x.y:name``; ``arguments``: numba's
    representation of each; ``seconds``: about how long it takes to compile; ``kinds``: of start that need it.
    """

    kernel: str
    arguments: tuple[str, ...]
    seconds: float
    kinds: tuple[str, ...]

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Signature:
        """From what ``asdict`` of it is in JSON. Raises: KeyError where something is missing."""
        return cls(row['kernel'], tuple(row['arguments']), row['seconds'], tuple(row['kinds']))

    def dispatcher(self) -> Any:
        """The function to compile. Raises: ImportError, AttributeError for what is not there."""
        module, name = self.kernel.split(':')
        return getattr(import_module(f'motion_detect_ros.{module}'), name)

    def compile(self) -> None:
        """Into the cache. Raises: whatever numba makes of types that it does not know."""
        known = {**vars(types), 'bool': types.boolean}
        self.dispatcher().compile(tuple(eval(argument, known) for argument in self.arguments))


def main() -> None:
    """Until the end of standard input."""
    gc.disable()  # a tenth of the time; the process ends soon
    for line in sys.stdin:
        for row in json.loads(line):
            with suppress(Exception):  # a table of another version
                Signature.of(row).compile()
            print(row['kernel'], flush=True)


if __name__ == '__main__':
    main()
