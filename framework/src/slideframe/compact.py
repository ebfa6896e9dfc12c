"""Sixteen bits instead of thirty-two for the arrays of a stored product, with a known error.

An array that declares itself "fixed" lies on a grid of 65536 steps along each component of its own bounding box: the
error is at most half a step. One that declares itself "half" is IEEE float16: a relative error of at most 2^-11.
"""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float32Array

Compact = Literal["fixed", "half"]
STEPS = 2**16 - 1


def write(folder: Path, name: str, value: Float32Array, kind: Compact) -> None:
    """Write an array in sixteen bits a number.

    Raises:
        ValueError: a number is beyond float16, 65504.
    """
    if kind == "half":
        if np.abs(value).max(initial=0.0) > np.finfo(np.float16).max:
            raise ValueError(f"{name} reach {np.abs(value).max():g}, beyond what 16 bits hold: store whole frames")
        np.save(folder / f"{name}.half.npy", value.astype(np.float16), allow_pickle=False)
        return
    low, step = _box(value)
    steps = np.rint((value - low) / np.where(step > 0, step, 1)).astype(np.uint16)
    np.save(folder / f"{name}.fixed.npy", steps, allow_pickle=False)
    np.save(folder / f"{name}.box.npy", np.stack([low, step]), allow_pickle=False)


def read(folder: Path, name: str) -> npt.NDArray[Any] | None:
    """Return an array that was written in sixteen bits, as float32; None: it was not."""
    if (folder / f"{name}.half.npy").is_file():
        half: npt.NDArray[np.float16] = np.load(folder / f"{name}.half.npy", allow_pickle=False)
        return half.astype(np.float32)
    if (folder / f"{name}.fixed.npy").is_file():
        low, step = np.load(folder / f"{name}.box.npy", allow_pickle=False)
        steps: npt.NDArray[np.uint16] = np.load(folder / f"{name}.fixed.npy", allow_pickle=False)
        values: npt.NDArray[np.float32] = (low + step * steps.astype(np.float64)).astype(np.float32)
        return values
    return None


def largest_error(value: Float32Array) -> float:
    """Return the largest error that "fixed" makes of an array, in its own unit: half a step."""
    return float(_box(value)[1].max(initial=0.0)) / 2


def _box(value: Float32Array) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the lowest corner and the step of each component (last axis)."""
    if not len(value):
        return np.zeros(value.shape[-1]), np.zeros(value.shape[-1])
    rows = value.reshape(-1, value.shape[-1])
    low, high = rows.min(axis=0).astype(np.float64), rows.max(axis=0).astype(np.float64)
    return low, (high - low) / STEPS
