"""Planes and ellipsoids through given points."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import ConfigurationError

FLATTEST = 1e-6  # smallest singular value, in the largest one, of points that determine a shape


@dataclass(frozen=True)
class Ellipsoid:
    """An upright ellipsoid: (p - centre)^T shape (p - centre) = 1 in plan, and an axis straight up.

    Attributes:
        centre: (3,), m.
        shape: inverse squares of the lengths of the axes in plan (2, 2), 1/m2.
        height: length of the upright axis, m.
    """

    centre: Float64Array
    shape: Float64Array
    height: float

    def underside(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the height of the lower half; NaN beside the ellipsoid, m."""
        offset = np.stack([x - self.centre[0], y - self.centre[1]], axis=-1)
        share = np.einsum("...i,ij,...j->...", offset, self.shape, offset)
        below = np.where(share <= 1, np.sqrt(np.maximum(1 - share, 0)), np.nan)
        heights: Float64Array = self.centre[2] - self.height * below
        return heights


def fit_plane(points: Float64Array, where: str) -> tuple[Float64Array, float]:
    """Return a, b, c of z = a x + b y + c nearest to points (point, 3), and the largest distance left, m.

    Raises:
        ConfigurationError: the points stand on one vertical plane.
    """
    middle = points.mean(axis=0)
    system = np.column_stack([points[:, :2] - middle[:2], np.ones(len(points))])
    values = np.linalg.svd(points[:, :2] - middle[:2], compute_uv=False)
    if values[-1] < FLATTEST * max(values[0], 1e-300):
        raise ConfigurationError(
            "the points lie on one line in plan, so no plane follows from them", where=where, cure="add one beside it"
        )
    slope = np.linalg.lstsq(system, points[:, 2], rcond=None)[0]
    left = float(np.abs(system @ slope - points[:, 2]).max())
    return np.array([slope[0], slope[1], slope[2] - slope[:2] @ middle[:2]]), left


def fit_ellipsoid(
    points: Float64Array, axis_ratio: tuple[float, float, float] | None, azimuth: float, where: str
) -> tuple[Ellipsoid, float]:
    """Return the upright ellipsoid nearest to points (point, 3), and the largest share by which a point is off.

    With the ratio of its axes given, space is squeezed so that a sphere is sought, by linear least squares on
    |p|^2 = 2 p.c + d. Without it, on A x^2 + B x y + C y^2 + D x + E y + F z + G = -z^2.

    Raises:
        ConfigurationError: too few points, or no ellipsoid goes through them.
    """
    least = 7 if axis_ratio is None else 4
    if len(points) < least:
        raise ConfigurationError(
            f"{len(points)} points don't determine the ellipsoid", where=where, cure=f"give {least} or more"
        )
    middle = points.mean(axis=0)
    size = float(np.abs(points - middle).max())
    scaled = (points - middle) / size
    found = _free(scaled) if axis_ratio is None else _of_ratio(scaled, axis_ratio, azimuth)
    if found is None:
        raise ConfigurationError(
            "no ellipsoid goes through the points: they lie on a plane, a line or an open surface",
            where=where,
            cure="take points at the crown, the toe, both flanks and the deepest place, or kind = 'plane'",
        )
    centre, shape, height = found
    offset = scaled - centre
    radius = np.sqrt(np.einsum("pi,ij,pj->p", offset[:, :2], shape, offset[:, :2]) + (offset[:, 2] / height) ** 2)
    return Ellipsoid(middle + size * centre, shape / size**2, height * size), float(np.abs(radius - 1).max())


def _of_ratio(
    points: Float64Array, ratio: tuple[float, float, float], azimuth: float
) -> tuple[Float64Array, Float64Array, float] | None:
    angle = np.radians(azimuth)
    along, across = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    squeezed = np.column_stack(
        [points[:, :2] @ along / ratio[0], points[:, :2] @ across / ratio[1], points[:, 2] / ratio[2]]
    )
    system = np.column_stack([2 * squeezed, np.ones(len(squeezed))])
    solution, _, rank, values = np.linalg.lstsq(system, (squeezed**2).sum(axis=1), rcond=None)
    squared = solution[3] + solution[:3] @ solution[:3]
    if rank < 4 or values[-1] < FLATTEST * values[0] or squared <= 0:
        return None
    radius = np.sqrt(squared)
    flat = along * solution[0] * ratio[0] + across * solution[1] * ratio[1]
    shape = np.outer(along, along) / (radius * ratio[0]) ** 2 + np.outer(across, across) / (radius * ratio[1]) ** 2
    return np.append(flat, solution[2] * ratio[2]), shape, float(radius * ratio[2])


def _free(points: Float64Array) -> tuple[Float64Array, Float64Array, float] | None:
    x, y, z = points.T
    system = np.column_stack([x * x, x * y, y * y, x, y, z, np.ones(len(points))])
    solution, _, rank, values = np.linalg.lstsq(system, -z * z, rcond=None)
    if rank < 7 or values[-1] < FLATTEST * values[0]:
        return None
    a, b, c, d, e, f, g = solution
    quadratic = np.array([[a, b / 2], [b / 2, c]])
    if np.linalg.eigvalsh(quadratic)[0] <= 0:
        return None
    flat = np.linalg.solve(2 * quadratic, [-d, -e])
    squared = flat @ quadratic @ flat + f * f / 4 - g
    if squared <= 0:
        return None
    return np.append(flat, -f / 2), quadratic / squared, float(np.sqrt(squared))
