"""The type of every array that a kernel is given."""

import taichi as ti

Array = ti.types.ndarray()
