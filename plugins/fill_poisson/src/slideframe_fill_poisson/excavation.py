"""Cuts the moving mass out of the ground."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array, Int32Array
from slideframe.release.grid import ReleaseGrid
from slideframe.release.plan import Plan
from slideframe_fill_poisson.solids import (
    CLEARANCE,
    GROUND,
    PLAN,
    SKIRT,
    SLIP_SURFACE,
    Mesh,
    Solid,
    close_sheet,
    height_field_sheet,
    upright_prism,
)


@dataclass(frozen=True)
class Excavation:
    """The ground taken apart.

    Attributes:
        mass: what moves.
        terrain: the ground that stays, the slip surface and the sides of the pit included (faces of origin
            GROUND, SLIP_SURFACE and PLAN), counter-clockwise seen from the air.
    """

    mass: Solid
    terrain: Mesh


def soil_body(sheet: tuple[Float64Array, Int32Array], rectangle: Float64Array, deepest: float) -> Solid:
    """Return the ground under a sheet, cut to a rectangle (2, 2) in plan and going down to `deepest`, m."""
    vertices, triangles = sheet
    level = min(deepest, float(vertices[:, 2].min())) - CLEARANCE
    body = close_sheet(vertices, triangles, level, GROUND)
    high = float(vertices[:, 2].max()) + CLEARANCE
    return body.common(upright_prism([_corners(rectangle)], level - CLEARANCE, high, SKIRT))


def room_above(grid: ReleaseGrid, plan: Plan, ground_top: float) -> Solid:
    """Return all that lies over the slip surface within the plan, soil or air."""
    high = ground_top + CLEARANCE
    heights = np.where(np.isfinite(grid.base), np.minimum(grid.base, high - 1), high - 1)
    above = close_sheet(*height_field_sheet(grid.x, grid.y, heights), high, SLIP_SURFACE)
    return above.common(upright_prism(plan.rings, float(heights.min()) - CLEARANCE, high + CLEARANCE, PLAN))


def excavate(soil: Solid, room: Solid) -> Excavation:
    """Take the soil in the room out of the ground."""
    left = soil.without(room).mesh()
    return Excavation(soil.common(room), left.only(left.origins != SKIRT))


def ground_of(soil: Solid) -> Mesh:
    """Return the soil's upper surface."""
    mesh = soil.mesh()
    return mesh.only(mesh.origins == GROUND)


def _corners(rectangle: Float64Array) -> Float64Array:
    (west, south), (east, north) = rectangle
    return np.array([[west, south], [east, south], [east, north], [west, north]])
