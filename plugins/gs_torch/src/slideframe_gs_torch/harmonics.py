"""Real spherical harmonics to degree 3, with the signs and order of Kerbl et al. 2023."""

import math

import torch
from torch import Tensor

C0 = 0.5 * math.sqrt(1 / math.pi)
C1 = math.sqrt(3 / (4 * math.pi))
XY, Z2, X2Y2 = math.sqrt(15 / (4 * math.pi)), math.sqrt(5 / (16 * math.pi)), math.sqrt(15 / (16 * math.pi))
X3, XYZ, XZ2 = math.sqrt(35 / (32 * math.pi)), math.sqrt(105 / (4 * math.pi)), math.sqrt(21 / (32 * math.pi))
Z3, X2Y2Z = math.sqrt(7 / (16 * math.pi)), math.sqrt(105 / (16 * math.pi))


def harmonics_basis(directions: Tensor, coefficients: int) -> Tensor:
    """Return the first 1, 4, 9 or 16 basis functions (splat, coefficient) at unit directions (splat, 3)."""
    x, y, z = directions.unbind(1)
    basis = [torch.full_like(x, C0)]
    if coefficients > 1:
        basis += [-C1 * y, C1 * z, -C1 * x]
    if coefficients > 4:
        xx, yy, zz = x * x, y * y, z * z
        basis += [XY * x * y, -XY * y * z, Z2 * (2 * zz - xx - yy), -XY * x * z, X2Y2 * (xx - yy)]
    if coefficients > 9:
        basis += [
            -X3 * y * (3 * xx - yy),
            XYZ * x * y * z,
            -XZ2 * y * (4 * zz - xx - yy),
            Z3 * z * (2 * zz - 3 * xx - 3 * yy),
            -XZ2 * x * (4 * zz - xx - yy),
            X2Y2Z * z * (xx - yy),
            -X3 * x * (xx - 3 * yy),
        ]
    return torch.stack(basis, dim=1)


def evaluate_harmonics(harmonics: Tensor, directions: Tensor) -> Tensor:
    """Return the colour (splat, 3), 0.5 + sum of basis times coefficient, not below 0.

    Args:
        harmonics: (splat, coefficient, 3).
        directions: (splat, 3), from the camera to each splat, of any length, in the splat's own turned
            frame where the splat has moved.
    """
    basis = harmonics_basis(torch.nn.functional.normalize(directions, dim=1), harmonics.shape[1])
    return (0.5 + (basis[:, None, :] @ harmonics)[:, 0]).clamp_min(0)
