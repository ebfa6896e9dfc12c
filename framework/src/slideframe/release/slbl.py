"""Sloping local base level (Jaboyedoff et al. 2004): a slip surface where none is known.

The method lowers each node of a height grid to the mean of its neighbours less a tolerance, until nothing changes. What
it comes to is the highest surface of curvature div grad z = q > 0 that is nowhere above the ground and meets it at the
outline; on a plane slope, a circle of diameter L gives a paraboloid of depth z_max = q L^2 / 16 and volume
pi z_max L^2 / 8. It is solved here as that obstacle problem, by projected over-relaxation (Cryer 1971), the
outline cutting cells where it does (Shortley & Weller 1938), so that the result doesn't hang on the grid.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.release.plan import Plan

LEAST_SHARE = 0.02  # of a cell, between a node and the outline
TOLERANCE = 1e-4  # of the depth sought
SWEEPS_PER_CHECK = 20
MOST_SWEEPS = 4000
MOST_CURVATURES = 30


@dataclass(frozen=True)
class Stencil:
    """The five-point Laplacian on the nodes within an outline; arrays are those of the grid without its border.

    Attributes:
        inside: which nodes are free.
        weights: of the neighbours in the east, west, north and south, 0 where the outline comes first.
        total: weight of the node itself.
        outline: sum of the heights on the outline times their weights.
    """

    inside: npt.NDArray[np.bool_]
    weights: tuple[Float64Array, ...]
    total: Float64Array
    outline: Float64Array


def base_level(
    x: Float64Array, y: Float64Array, ground: Float64Array, plan: Plan, maximum_depth: float
) -> tuple[Float64Array, float]:
    """Return the slip surface (column, row), m, whose greatest depth is `maximum_depth`, and its curvature, 1/m.

    Args:
        x: eastings of the nodes (column,), m; the outermost lie outside the plan.
        y: northings of the nodes (row,), m.
        ground: heights (column, row), m.
        plan: the outline from which the surface hangs.
        maximum_depth: vertical, m.
    """
    stencil = _stencil(x, y, ground, plan)
    surface, low, curvature = ground.copy(), 0.0, 16 * maximum_depth / plan.area
    high, depth_low, depth_high = np.inf, 0.0, np.inf
    for _ in range(MOST_CURVATURES):
        surface = _lowered(surface, ground, stencil, curvature, maximum_depth)
        depth = float((ground - surface)[1:-1, 1:-1][stencil.inside].max())
        if abs(depth - maximum_depth) <= 10 * TOLERANCE * maximum_depth:
            break
        if depth < maximum_depth:
            low, depth_low = curvature, depth
        else:
            high, depth_high = curvature, depth
        # depth grows with curvature, in proportion where the surface nowhere touches the ground
        if np.isfinite(high):
            share = (maximum_depth - depth_low) / (depth_high - depth_low)
            curvature = low + np.clip(share, 0.05, 0.95) * (high - low)
        else:
            curvature *= np.clip(maximum_depth / max(depth, 1e-9 * maximum_depth), 1.05, 10)
    return surface, curvature


def _stencil(x: Float64Array, y: Float64Array, ground: Float64Array, plan: Plan) -> Stencil:
    across, along = np.meshgrid(x, y, indexing="ij")
    inside = plan.contains(across.ravel(), along.ravel()).reshape(across.shape)
    away = plan.distance_to_outline(across.ravel(), along.ravel()).reshape(across.shape)
    middle = (slice(1, -1), slice(1, -1))
    free, lengths, outside, heights = inside[middle], [], [], []
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        within, farther, height = (np.roll(values, -step, axis)[middle] for values in (inside, away, ground))
        share = np.clip(away[middle] / np.maximum(away[middle] + farther, 1e-12), LEAST_SHARE, 1)
        spacing = float((x if axis == 0 else y)[1] - (x if axis == 0 else y)[0])
        outside.append(~within.astype(bool))
        lengths.append(np.where(within, spacing, share * spacing))
        heights.append(ground[middle] + share * (height - ground[middle]))
    weights = [2 / (lengths[d] * (lengths[d] + lengths[d ^ 1])) for d in range(4)]
    outline = sum(np.where(outside[d], weights[d] * heights[d], 0.0) for d in range(4))
    inner = tuple(np.where(outside[d], 0.0, weights[d]) for d in range(4))
    return Stencil(free, inner, np.sum(weights, axis=0), np.asarray(outline))


def _lowered(
    start: Float64Array, ground: Float64Array, stencil: Stencil, curvature: float, depth: float
) -> Float64Array:
    """Return the highest surface of that curvature at or below the ground (column, row), m."""
    surface = start.copy()
    middle = surface[1:-1, 1:-1]
    lid = ground[1:-1, 1:-1]
    parity = np.add.outer(np.arange(middle.shape[0]), np.arange(middle.shape[1])) % 2
    colors = [stencil.inside & (parity == color) for color in (0, 1)]
    relaxation = 2 / (1 + np.sin(np.pi / max(middle.shape)))
    neighbors = (surface[2:, 1:-1], surface[:-2, 1:-1], surface[1:-1, 2:], surface[1:-1, :-2])
    for sweep in range(MOST_SWEEPS):
        largest = 0.0
        for chosen in colors:
            mean = stencil.outline - curvature
            for weight, beside in zip(stencil.weights, neighbors, strict=True):
                mean = mean + weight * beside
            change = np.where(chosen, relaxation * (mean / stencil.total - middle), 0.0)
            change = np.minimum(middle + change, np.where(chosen, lid, np.inf)) - middle
            middle += change
            largest = max(largest, float(np.abs(change).max()))
        if sweep % SWEEPS_PER_CHECK == 0 and largest <= 0.1 * TOLERANCE * depth:
            break
    return surface
