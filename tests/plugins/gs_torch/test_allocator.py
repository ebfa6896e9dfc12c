"""Freed memory goes back where the C library can (what it is worth: test_shelf.py)."""

import ctypes

import pytest

from slideframe_gs_torch import allocator


@pytest.fixture(autouse=True)
def library_looked_up_anew():
    allocator._trim.cache_clear()
    yield
    allocator._trim.cache_clear()


def test_the_c_library_is_asked_to_keep_nothing(monkeypatch):
    asked = []

    class Library:
        malloc_trim = staticmethod(asked.append)

    monkeypatch.setattr(ctypes, "CDLL", lambda name: Library)
    allocator.return_freed_memory()
    assert asked == [0]


def test_a_library_that_cannot_is_left_alone(monkeypatch):
    monkeypatch.setattr(ctypes, "CDLL", lambda name: object())
    allocator.return_freed_memory()
    assert allocator._trim() is None
