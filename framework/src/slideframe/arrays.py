"""Arrays that declare their axes, dtype and SI unit, and the immutable products made of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, model_validator
from pydantic_core import PydanticCustomError, core_schema

Axes = tuple[str | int, ...]

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]
UInt8Array = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Array:
    """What an array field holds, as metadata of an annotation.

    `Annotated[Float32Array, Array(("particle", 3), "float32", "m")]` is an array of shape
    (particle_count, 3) in metres. A named axis has the same length wherever the name stands
    in one product; a number is the exact length. Floating-point values must be finite.
    `compact` is how the array may be stored in 16 bits where the user wants that (slideframe.compact).
    """

    axes: Axes
    dtype: str
    unit: str = "1"
    compact: Literal["fixed", "half"] | None = None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self.validate)

    def validate(self, value: object) -> npt.NDArray[Any]:
        """Check dtype, axes and finiteness, and return a read-only contiguous view of the array."""
        if not isinstance(value, np.ndarray):
            raise PydanticCustomError("array_type", "must be a NumPy array, not {got}", {"got": type(value).__name__})
        if value.dtype != np.dtype(self.dtype):
            raise PydanticCustomError(
                "array_dtype",
                "must be {expected} in {unit}, not {got}: convert it with .astype('{expected}')",
                {"expected": self.dtype, "unit": self.unit, "got": str(value.dtype)},
            )
        if not self._fits(value.shape):
            raise PydanticCustomError(
                "array_shape",
                "must have axes {axes}, not shape {got}",
                {"axes": str(self.axes), "got": str(value.shape)},
            )
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            index = tuple(int(i) for i in np.argwhere(~np.isfinite(value))[0])
            raise PydanticCustomError(
                "array_finite",
                "must be finite, but element {index} is {got}",
                {"index": str(index), "got": str(value[index])},
            )
        view = np.ascontiguousarray(value).view()
        view.flags.writeable = False
        return view

    def _fits(self, shape: tuple[int, ...]) -> bool:
        return len(shape) == len(self.axes) and all(
            isinstance(axis, str) or axis == length for axis, length in zip(self.axes, shape, strict=True)
        )


class Product(BaseModel):
    """What a stage hands to the next: immutable, with read-only arrays whose axes agree."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)

    @classmethod
    def array_fields(cls) -> dict[str, Array]:
        """Return the declared array fields by name, in order."""
        found = {}
        for name, field in cls.model_fields.items():
            for metadata in field.metadata:
                if isinstance(metadata, Array):
                    found[name] = metadata
        return found

    def axis_lengths(self) -> dict[str, int]:
        """Return the length of every named axis."""
        return {axis: length for _, axis, length in self._named_axes()}

    def _named_axes(self) -> Iterator[tuple[str, str, int]]:
        for name, declared in self.array_fields().items():
            for axis, length in zip(declared.axes, getattr(self, name).shape, strict=True):
                if isinstance(axis, str):
                    yield name, axis, length

    @model_validator(mode="after")
    def _axes_agree(self) -> "Product":
        first: dict[str, tuple[str, int]] = {}
        for name, axis, length in self._named_axes():
            other, expected = first.setdefault(axis, (name, length))
            if length != expected:
                raise PydanticCustomError(
                    "array_axes",
                    "axis '{axis}' has length {length} in '{name}' but {expected} in '{other}'",
                    {"axis": axis, "length": length, "name": name, "expected": expected, "other": other},
                )
        return self

    def __eq__(self, other: object) -> bool:
        """Compare values, arrays element by element and bit for bit."""
        if type(self) is not type(other):
            return NotImplemented
        arrays = self.array_fields()
        return all(
            np.array_equal(mine, theirs) if name in arrays else mine == theirs
            for name in type(self).model_fields
            for mine, theirs in [(getattr(self, name), getattr(other, name))]
        )

    __hash__ = None  # type: ignore[assignment]
