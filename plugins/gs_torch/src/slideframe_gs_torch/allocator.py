"""Memory that was freed: given back to the system, or kept for the next iteration."""

import ctypes
import functools
from collections.abc import Iterator
from contextlib import contextmanager

# Of glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
# What glibc itself raises its thresholds to at most, and more than an iteration frees.
_MOST_USUAL, _MORE_THAN_FREED = 32 << 20, 1 << 30


def return_freed_memory() -> None:
    """Let the C library hand freed pages back, where it can (glibc); elsewhere nothing happens.

    Where photographs are read one by one and something small is kept of each, glibc's heap grows by nearly every one of
    them: what is kept lies above what was freed, so that the heap can't shrink.
    """
    library = _glibc()
    if library is not None:
        library.malloc_trim(0)


@contextmanager
def freed_memory_kept() -> Iterator[None]:
    """Keep what is freed for what is allocated next, and return it in the end; elsewhere than with glibc do nothing.

    An iteration allocates some ten arrays of many megabytes and frees them all; a heap that shrinks each time has every
    page cleared anew by the system.
    """
    library = _glibc()
    if library is None:
        yield
        return
    library.mallopt(_MMAP_THRESHOLD, _MOST_USUAL)
    library.mallopt(_TRIM_THRESHOLD, _MORE_THAN_FREED)
    try:
        yield
    finally:
        library.mallopt(_TRIM_THRESHOLD, 2 * _MOST_USUAL)
        library.malloc_trim(0)


@functools.cache
def _glibc() -> ctypes.CDLL | None:
    try:
        library = ctypes.CDLL(None)
        return library if library.malloc_trim and library.mallopt else None
    except (AttributeError, OSError, TypeError):
        return None
