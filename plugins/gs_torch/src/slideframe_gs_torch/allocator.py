"""Memory that was freed, given back to the system."""

import ctypes
import functools
from collections.abc import Callable


def return_freed_memory() -> None:
    """Let the C library hand freed pages back, where it can (glibc); elsewhere nothing happens.

    Where photographs are read one by one and something small is kept of each, glibc's heap grows by nearly every one of
    them: what is kept lies above what was freed, so that the heap can't shrink.
    """
    trim = _trim()
    if trim is not None:
        trim(0)


@functools.cache
def _trim() -> Callable[[int], int] | None:
    try:
        return ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return None
