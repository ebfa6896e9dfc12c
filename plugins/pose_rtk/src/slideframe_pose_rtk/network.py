"""How well a flight's geometry determines its cameras' lenses, told before anything is adjusted.

The same least squares that the adjustment solves, linearised at the metadata's poses over level ground: the covariance
of the lens is that of the inverse normal matrix, which knows where photographs were taken and which way they look, and
needs no observation.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.ground import footprint, ground_height

MOST_VIEWS = 24  # evenly chosen; more of the same change the figure by their number's square root at most
POINTS_PER_SIDE = 4  # of each view
# What is left of a sighting's error after thousands of them: not their noise, which averages out, but what the lens
# model and the ground's level surface leave unsaid.
SIGHTING_SIGMA = 1.0  # px
ROTATION_SIGMA = 1.0  # rad: nothing holds the rotations
LENS, PRINCIPAL_POINT = 7, slice(1, 3)  # focal length, principal point, k1, k2, p1, p2


@dataclass(frozen=True)
class LensSigma:
    """Standard deviations that a flight leaves: of the focal length, as its share, and of the principal point, px."""

    focal_length: float
    principal_point: float


OPEN = LensSigma(float(np.inf), float(np.inf))


def lens_sigma(flight: Flight, camera: int) -> LensSigma:
    """Return how well the flight determines a camera's lens; infinite where too little is seen in common."""
    chosen = np.flatnonzero((np.array(flight.camera_of) == camera) & flight.oriented)
    if len(chosen) > MOST_VIEWS:
        chosen = chosen[np.linspace(0, len(chosen) - 1, MOST_VIEWS).astype(int)]
    if not len(chosen):
        return OPEN
    weights = np.column_stack([np.full((len(chosen), 3), ROTATION_SIGMA), flight.position_sigma[chosen]]) ** -2.0
    normal = np.diag(np.concatenate([weights.ravel(), np.zeros(LENS)]))
    for point in _ground(flight, chosen):
        _add_point(normal, flight, chosen, camera, point)
    lens = normal[-LENS:, -LENS:]
    poses, across = normal[:-LENS, :-LENS], normal[:-LENS, -LENS:]
    reduced = lens - across.T @ np.linalg.solve(poses, across)
    if np.linalg.matrix_rank(reduced, hermitian=True) < LENS:
        return OPEN
    sigmas = np.sqrt(np.diag(np.linalg.inv(reduced)))
    return LensSigma(float(sigmas[0]) / flight.cameras[camera].focal_x, float(sigmas[PRINCIPAL_POINT].max()))


def _ground(flight: Flight, chosen: npt.NDArray[np.int64]) -> Float64Array:
    """Return places (point, 3) on level ground that the views show, so many for each."""
    height = ground_height(flight)
    return np.concatenate([footprint(flight, int(index), height, POINTS_PER_SIDE) for index in chosen])


def _add_point(
    normal: Float64Array, flight: Flight, chosen: npt.NDArray[np.int64], camera: int, point: Float64Array
) -> None:
    """Add a point's sightings to the normal equations, itself eliminated."""
    lens = flight.cameras[camera]
    offsets = point - flight.positions[chosen]
    local = np.einsum("vi,vij->vj", offsets, flight.rotations[chosen])
    depth = np.maximum(local[:, 2], 1e-9)
    x, y = local[:, 0] / depth, local[:, 1] / depth
    column, row = lens.focal_x * x + lens.principal_x, lens.focal_x * y + lens.principal_y
    seen = (local[:, 2] > 0) & (column > 0) & (column < lens.width) & (row > 0) & (row < lens.height)
    if seen.sum() < 2:
        return
    views = np.flatnonzero(seen)
    to_point = _slopes_to_pixels(x[seen], y[seen], depth[seen], lens.focal_x)  # (view, 2, 3) in camera axes
    turned = np.cross(np.eye(3)[None], local[seen][:, None]).transpose(0, 2, 1)  # d local = -turn x local
    by_turn = to_point @ turned
    by_place = to_point @ flight.rotations[chosen[views]].transpose(0, 2, 1)
    by_lens = _by_lens(x[seen], y[seen], lens.focal_x)
    columns = np.concatenate(
        [np.arange(6 * view, 6 * view + 6) for view in views] + [np.arange(6 * len(chosen), len(normal))]
    )
    rows = 2 * len(views)
    design = np.zeros((rows, len(columns)))
    for place in range(len(views)):
        lines = slice(2 * place, 2 * place + 2)
        design[lines, 6 * place : 6 * place + 3] = by_turn[place]
        design[lines, 6 * place + 3 : 6 * place + 6] = -by_place[place]
        design[lines, -LENS:] = by_lens[place]
    ground = by_place.reshape(rows, 3)
    # the point takes up what it can: (I - G (G'G)^-1 G') applied to the rest
    left, singular, _ = np.linalg.svd(ground, full_matrices=False)
    left = left[:, singular > 1e-9 * singular[0]]
    remaining = design - left @ (left.T @ design)
    normal[np.ix_(columns, columns)] += remaining.T @ remaining / SIGHTING_SIGMA**2


def _slopes_to_pixels(x: Float64Array, y: Float64Array, depth: Float64Array, focal_length: float) -> Float64Array:
    """Return the derivative (view, 2, 3) of pixels by the place in camera axes."""
    zero, scale = np.zeros_like(x), focal_length / depth
    return np.stack([np.stack([scale, zero, -scale * x], -1), np.stack([zero, scale, -scale * y], -1)], axis=1)


def _by_lens(x: Float64Array, y: Float64Array, focal_length: float) -> Float64Array:
    """Return the derivative (view, 2, 7) of pixels by focal length, principal point, k1, k2, p1, p2."""
    one, zero, square = np.ones_like(x), np.zeros_like(x), x * x + y * y
    terms = focal_length * np.stack([square, square**2], -1)
    tangential = focal_length * np.stack(
        [np.stack([2 * x * y, square + 2 * x * x], -1), np.stack([square + 2 * y * y, 2 * x * y], -1)], axis=1
    )
    columns = np.stack([np.stack([x, one, zero], -1), np.stack([y, zero, one], -1)], axis=1)
    radial = np.stack([terms * x[:, None], terms * y[:, None]], axis=1)
    return np.concatenate([columns, radial, tangential], axis=2)
