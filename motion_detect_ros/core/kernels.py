"""How the loops over pixels are compiled: cached on disk where that is possible, and running where it is not.

Kernels fill arrays that their callers make, scratch arrays too: to make them inside adds half to what compiling takes.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.serialize import dumps

#: Kernels without a place for a cache.
_uncached: list[str] = []


def can_be_cached() -> bool:
    """Whether there is a place where compiled kernels can be kept, for all of those that have been imported."""
    return not _uncached


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: compiled at the first call, without the GIL, cached.

    A cache that cannot be read, written or believed costs compiling, and no more: numba's own raises. options: of
    ``numba.njit``.
    """
    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(nogil=True, no_cfunc_wrapper=True, **options)(function)  # type: ignore[call-overload]
        try:
            dispatcher._cache = _ForgivingCache(function)  # type: ignore[no-untyped-call]
        except RuntimeError:  # no folder can be written, neither here nor in the user's home
            _uncached.append(function.__name__)
        return dispatcher

    return compiled


class _CheckedCode(CompileResultCacheImpl):
    """Code with its checksum: what a bad disk has changed would be executed."""

    def reduce(self, cres: Any) -> tuple[bytes, bytes]:
        packed = dumps(super().reduce(cres))  # type: ignore[no-untyped-call]
        return packed, hashlib.sha256(packed).digest()

    def rebuild(self, target_context: Any, payload: tuple[bytes, bytes]) -> Any:
        packed, checksum = payload
        if hashlib.sha256(packed).digest() != checksum:
            raise ValueError('cache: damaged code')
        return super().rebuild(target_context, pickle.loads(packed))  # type: ignore[no-untyped-call]


class _ForgivingCache(FunctionCache):
    """numba's cache of one function, of which nothing is fatal."""

    _impl_class = _CheckedCode

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:  # whatever damaged bytes make of pickle and LLVM
            with suppress(OSError):  # else saving would read the same bytes
                self.flush()  # type: ignore[no-untyped-call]
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except Exception:  # the disk is full, or read-only since the start
            self.disable()  # type: ignore[no-untyped-call]
