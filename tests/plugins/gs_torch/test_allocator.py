"""Freed memory goes back, or stays, where the C library can (what it is worth: test_shelf.py)."""

import ctypes

import pytest

from slideframe_gs_torch import allocator


@pytest.fixture(autouse=True)
def library_looked_up_anew():
    allocator._glibc.cache_clear()
    yield
    allocator._glibc.cache_clear()


@pytest.fixture
def asked(monkeypatch):
    """What the C library is asked for, in order."""
    found = []

    class Library:
        malloc_trim = staticmethod(lambda kept: found.append(("trim", kept)))
        mallopt = staticmethod(lambda option, value: found.append((option, value)))

    monkeypatch.setattr(ctypes, "CDLL", lambda name: Library)
    return found


def test_the_c_library_is_asked_to_keep_nothing(asked):
    allocator.return_freed_memory()
    assert asked == [("trim", 0)]


def test_memory_is_kept_for_a_while_and_goes_back_even_after_an_error(asked):
    with pytest.raises(ZeroDivisionError), allocator.freed_memory_kept():
        raise ZeroDivisionError
    kept, restored = (value for option, value in asked if option == allocator._TRIM_THRESHOLD)
    assert restored < kept
    assert asked[-1] == ("trim", 0)


def test_a_library_that_cannot_is_left_alone(monkeypatch):
    monkeypatch.setattr(ctypes, "CDLL", lambda name: object())
    allocator.return_freed_memory()
    with allocator.freed_memory_kept():
        pass
    assert allocator._glibc() is None
