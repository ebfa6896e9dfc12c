"""How checks look at products: digests, copies and contexts."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Product
from slideframe.device import Device
from slideframe.stages import Context


def fresh_context(scratch: Path, name: str = "run") -> Context:
    """Return a CPU context whose scratch folder is empty."""
    folder = scratch / name
    folder.mkdir(parents=True)
    return Context(device=Device(), scratch=folder)


def arrays_of(product: Product, prefix: str = "") -> Iterator[tuple[str, npt.NDArray[np.generic]]]:
    """Yield every array of a product and of the products in it, by name."""
    for name in type(product).model_fields:
        value = getattr(product, name)
        if isinstance(value, Product):
            yield from arrays_of(value, f"{prefix}{name}.")
        elif name in product.array_fields():
            yield prefix + name, value


def digest(product: Product) -> str:
    """Return a digest of all bits of a product."""
    state = hashlib.sha256()
    for name, array in arrays_of(product):
        state.update(name.encode() + str(array.dtype).encode() + str(array.shape).encode() + array.tobytes())
    plain = {name: getattr(product, name) for name in type(product).model_fields if name not in product.array_fields()}
    state.update(repr({name: value for name, value in plain.items() if not isinstance(value, Product)}).encode())
    return state.hexdigest()


def assert_valid(product: Product) -> None:
    """Assert that a product passes its own declaration, even if it was built around it."""
    fields = {name: getattr(product, name) for name in type(product).model_fields}
    try:
        type(product).model_validate(fields)
    except ValueError as error:
        raise AssertionError(f"the {type(product).__name__} breaks its declaration: {error}") from error


def assert_same(first: Product, second: Product, what: str) -> None:
    """Assert that two products are equal bit for bit, and name the first array that isn't."""
    for (name, mine), (_, theirs) in zip(arrays_of(first), arrays_of(second), strict=True):
        if mine.shape != theirs.shape:
            raise AssertionError(f"{what}: {name} has shape {mine.shape} once and {theirs.shape} the other time")
        if mine.tobytes() != theirs.tobytes():
            count = int(np.count_nonzero(mine != theirs))
            raise AssertionError(f"{what}: {count} of {mine.size} elements of {name} differ")
    assert digest(first) == digest(second), f"{what}: fields other than arrays differ"
