"""Cuts the moving mass out of the ground."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array, Int32Array
from slideframe.errors import ConfigurationError
from slideframe.formats.meshes import read_mesh
from slideframe.problem import MeshRegion
from slideframe.products import Georeference
from slideframe.release.coordinates import local_points
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
    closed_solid,
    height_field_sheet,
    rim_edges,
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

    @property
    def bare(self) -> Mesh:
        """The terrain's faces that the mass lay on: slip surface and sides."""
        return self.terrain.only(self.terrain.origins != GROUND)


def soil_body(sheet: tuple[Float64Array, Int32Array], rectangle: Float64Array, deepest: float) -> Solid:
    """Return the ground under a sheet, cut to a rectangle (2, 2) in plan and going down to `deepest`, m.

    What the cut leaves in the air is left out, and so are voids that meet the open air nowhere, or in a single corner:
    no camera sees into them.
    """
    vertices, triangles = sheet
    level = min(deepest, float(vertices[:, 2].min())) - CLEARANCE
    body = close_sheet(vertices, triangles, level, GROUND)
    high = float(vertices[:, 2].max()) + CLEARANCE
    cut = body.common(upright_prism([_corners(rectangle)], level - CLEARANCE, high, SKIRT))
    return cut.reaching(level + CLEARANCE / 2)


def room_above(grid: ReleaseGrid, plan: Plan, ground_top: float) -> Solid:
    """Return all that lies over the slip surface within the plan, soil or air."""
    high = ground_top + CLEARANCE
    heights = np.where(np.isfinite(grid.base), np.minimum(grid.base, high - 1), high - 1)
    above = close_sheet(*height_field_sheet(grid.x, grid.y, heights), high, SLIP_SURFACE)
    return above.common(upright_prism(plan.rings, float(heights.min()) - CLEARANCE, high + CLEARANCE, PLAN))


def room_of(region: MeshRegion, georeference: Georeference) -> Solid:
    """Return the room that a closed mesh encloses.

    Raises:
        ConfigurationError: it isn't closed, or encloses nothing, or its coordinates can't be what they are said to be.
        InputError, MissingDependency: the file can't be read.
    """
    where = str(region.path)
    vertices, triangles = read_mesh(region.path)
    return closed_room(local_points(vertices, region, georeference, where), triangles, where)


def closed_room(vertices: Float64Array, triangles: Int32Array, where: str) -> Solid:
    """Return the room that triangles (triangle, 3) on vertices (vertex, 3) enclose, m.

    What several bodies enclose together counts once, and so does a triangle that is there twice.

    Raises:
        ConfigurationError: they leave a gap, meet at an edge by more than two, or enclose nothing.
    """
    cure = "make it watertight, all triangles counter-clockwise seen from outside"
    once = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)[1]
    triangles = triangles[np.sort(once)]
    if len(rim := rim_edges(triangles)):
        x, y, z = vertices[rim[0]].mean(axis=0)
        edges = "1 edge has" if len(rim) == 1 else f"{len(rim)} edges have"
        raise ConfigurationError(
            f"the mesh of the region isn't closed: {edges} a triangle on one side only, the first "
            f"near ({x:.2f}, {y:.2f}, {z:.2f})",
            where=where,
            cure=cure,
        )
    try:
        solid = closed_solid(vertices, [(triangles, PLAN)])
        if solid.volume < 0:  # all triangles face inwards
            solid = closed_solid(vertices, [(triangles[:, ::-1], PLAN)])
    except ValueError as error:
        raise ConfigurationError(
            f"the mesh of the region is no closed body: {error}", where=where, cure=cure
        ) from error
    if solid.is_empty or solid.volume <= 0:
        raise ConfigurationError("the mesh of the region encloses nothing", where=where, cure=cure)
    return solid.united()


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
