"""Real spherical harmonics up to degree 3, in the order and with the signs of 3DGS files, and their rotation."""

from functools import cache

import numpy as np

from slideframe.arrays import Float32Array, Float64Array

# Coefficients of a colour channel by degree, and where each band of them starts and ends.
COEFFICIENTS = (1, 4, 9, 16)
BANDS = (slice(0, 1), slice(1, 4), slice(4, 9), slice(9, 16))


def basis(directions: Float64Array) -> Float64Array:
    """Return the 16 functions (..., 16) at unit directions (..., 3).

    Source: Sloan 2008, "Stupid spherical harmonics (SH) tricks".
    """
    x, y, z = np.moveaxis(directions, -1, 0)
    xx, yy, zz = x * x, y * y, z * z
    return np.stack(
        [
            np.full_like(x, 0.28209479177387814),
            -0.4886025119029199 * y,
            0.4886025119029199 * z,
            -0.4886025119029199 * x,
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ],
        axis=-1,
    )


def rotate_harmonics(harmonics: Float32Array, rotations: Float64Array) -> Float32Array:
    """Return the coefficients of colours that have turned with their splats: c'(d) = c(R^T d) for every direction d.

    A rotation mixes the coefficients of one band among themselves only. The mixing matrix of a band follows from as
    many directions as the band has functions: B M = B', with B at the directions and B' at the directions turned back.

    Args:
        harmonics: (splat, coefficient, 3) with 1, 4, 9 or 16 coefficients.
        rotations: (3, 3) for all splats, or (splat, 3, 3).
    """
    turned = harmonics.copy()
    for degree in range(1, COEFFICIENTS.index(harmonics.shape[1]) + 1):
        directions, inverse = _band_samples(degree)
        back = directions @ rotations  # d^T R = (R^T d)^T
        mixing = inverse @ basis(back)[..., BANDS[degree]]
        turned[:, BANDS[degree]] = mixing @ harmonics[:, BANDS[degree]].astype(np.float64)
    return turned


@cache
def _band_samples(degree: int) -> tuple[Float64Array, Float64Array]:
    """Return directions (2 degree + 1, 3) that determine a band, and the inverse of its functions there."""
    count = 2 * degree + 1
    # a spiral that avoids antipodes, at which the functions of a band agree or cancel
    height = 1 - (np.arange(count) + 0.5) / count
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    radius = np.sqrt(1 - height**2)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    inverse: Float64Array = np.linalg.inv(basis(directions)[:, BANDS[degree]]).astype(np.float64)
    return directions, inverse
