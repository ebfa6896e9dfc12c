from typing import Annotated

import numpy as np
import pytest
from pydantic import ValidationError

from slideframe.arrays import Array, Float32Array, Product
from slideframe.products import SplatCloud


class Cloud(Product):
    positions: Annotated[Float32Array, Array(("particle", 3), "float32", "m")]
    masses: Annotated[Float32Array, Array(("particle",), "float32", "kg")]


def cloud(**changes) -> Cloud:
    return Cloud(**({"positions": np.zeros((4, 3), np.float32), "masses": np.ones(4, np.float32)} | changes))


def test_wrong_dtype_names_field_unit_and_cure():
    with pytest.raises(ValidationError, match=r"masses\n\s+must be float32 in kg, not float64: convert it with"):
        cloud(masses=np.ones(4))


def test_wrong_shape_is_refused():
    with pytest.raises(ValidationError, match=r"must have axes \('particle', 3\), not shape \(4, 2\)"):
        cloud(positions=np.zeros((4, 2), np.float32))


def test_named_axes_agree_within_a_product():
    with pytest.raises(ValidationError, match="axis 'particle' has length 5 in 'masses' but 4 in 'positions'"):
        cloud(masses=np.ones(5, np.float32))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_not_finite_is_refused_with_its_place(bad):
    positions = np.zeros((4, 3), np.float32)
    positions[2, 1] = bad
    with pytest.raises(ValidationError, match=r"must be finite, but element \(2, 1\)"):
        cloud(positions=positions)


def test_arrays_are_read_only_and_the_givers_stays_writable():
    masses = np.ones(4, np.float32)
    product = cloud(masses=masses)
    with pytest.raises(ValueError, match="read-only"):
        product.masses[0] = 2
    masses[0] = 3


def test_products_compare_by_value():
    assert cloud() == cloud()
    assert cloud() != cloud(masses=np.full(4, 2, np.float32))


def test_unknown_fields_are_refused():
    with pytest.raises(ValidationError, match="Extra inputs"):
        cloud(mases=1)


def test_harmonics_have_a_whole_degree():
    with pytest.raises(ValidationError, match="1, 4, 9 or 16 coefficients, not 5"):
        SplatCloud(
            centers=np.zeros((1, 3), np.float32),
            rotations=np.float32([[1, 0, 0, 0]]),
            scales=np.ones((1, 3), np.float32),
            opacities=np.ones(1, np.float32),
            harmonics=np.zeros((1, 5, 3), np.float32),
        )
