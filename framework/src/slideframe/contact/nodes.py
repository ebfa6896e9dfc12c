"""The grid nodes that lie in solid ground, by column, for any solver's grid."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array, Int32Array
from slideframe.contact.distance import near_nodes
from slideframe.contact.mesh import TriangleMesh
from slideframe.errors import InputError
from slideframe.problem import Grid, SimulationProblem, Wall
from slideframe.problem.boundary import STICKS
from slideframe.products import Filling

# Nodes that deep, in cells, act: no particle crosses more than one of them in a substep.
DEPTH = 3.0
# A node on the surface itself counts as inside: the rounding of its distance, in cells.
ON_SURFACE = 1e-6
# Particles whose whole cell lies in the ground are buried; a few may be, at the rounding of a steep side.
BURIED_SHARE = 0.01


@dataclass(frozen=True)
class ContactNodes:
    """Where solid ground acts on the grid.

    Attributes:
        columns: (i, j, 3), of each column of nodes the lowest layer, the number of layers, and where in `normals`
            the lowest is found.
        normals: (n, 4), unit vector out of the ground and the wall's coefficient there;
            all zero for a node between others that is not in the ground; coefficients as of Wall.coefficient.
    """

    columns: Int32Array
    normals: Float64Array

    @classmethod
    def none(cls, grid: Grid) -> "ContactNodes":
        """Return what there is without any ground."""
        return cls(np.zeros((*grid.shape[:2], 3), np.int32), np.zeros((1, 4)))

    def settling(self) -> "ContactNodes":
        """Return the same while stress builds up: friction holds."""
        normals = self.normals.copy()
        normals[normals[:, 3] > 0, 3] = STICKS
        return ContactNodes(self.columns, normals)

    def indices(self) -> tuple[npt.NDArray[np.int64], Float64Array]:
        """Return the nodes (m, 3) in the ground and their normals and coefficients (m, 4)."""
        i, j = np.nonzero(self.columns[..., 1])
        lowest, counts, starts = self.columns[i, j].astype(np.int64).T
        which = np.repeat(np.arange(len(i)), counts)
        step = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        normals = self.normals[starts[which] + step]
        inside = normals[:, :3].any(axis=1)
        nodes = np.stack([i[which], j[which], lowest[which] + step], axis=1)
        return nodes[inside], normals[inside]


def terrain_contact(filling: Filling, problem: SimulationProblem, grid: Grid) -> ContactNodes:
    """Return where the filling's terrain acts on the grid, if the problem wants it to.

    Raises:
        InputError: the terrain has holes, there is none, or it passes through the mass.
    """
    wall = problem.boundary.terrain
    if wall.kind == "open":
        return ContactNodes.none(grid)
    if not len(filling.terrain_triangles):
        raise InputError(
            "the filling has no terrain, and boundary.terrain wants the mass to meet it",
            where="boundary.terrain",
            cure="take a volume filler that gives the ground that stays, or set boundary.terrain.kind = 'open'",
        )
    mesh = TriangleMesh.welded(filling.terrain_vertices, filling.terrain_triangles)
    contact = find_contact(grid, [("terrain", mesh, wall)])
    _require_not_buried(filling, grid, contact)
    return contact


def _require_not_buried(filling: Filling, grid: Grid, contact: ContactNodes) -> None:
    nodes, _ = contact.indices()
    solid = np.sort(np.ravel_multi_index(tuple(nodes.T), grid.shape))
    cells = (filling.particle_positions.astype(np.float64) - np.array(grid.origin)) / grid.spacing
    corner = np.clip(cells.astype(np.int64), 0, np.array(grid.shape) - 2)
    buried = np.ones(len(corner), bool)
    for step in np.ndindex(2, 2, 2):
        flat = np.ravel_multi_index(tuple((corner + step).T), grid.shape)
        place = np.minimum(np.searchsorted(solid, flat), max(len(solid) - 1, 0))
        buried &= solid[place] == flat if len(solid) else False
    if buried.mean() > BURIED_SHARE:
        x, y, z = filling.particle_positions[int(np.argmax(buried))]
        raise InputError(
            f"the terrain passes through the mass: {int(buried.sum())} of {len(buried)} particles lie in it, "
            f"the first at ({x:.2f}, {y:.2f}, {z:.2f}) m",
            where="filling.terrain_triangles",
            cure="the terrain must be the ground without the mass, its triangles counter-clockwise seen from the air",
        )


def find_contact(grid: Grid, bodies: Sequence[tuple[str, TriangleMesh, Wall]]) -> ContactNodes:
    """Return the nodes of `grid` in solid bodies (name, mesh, how its surface acts); of two bodies the deeper acts.

    Raises:
        InputError: a mesh has a hole wider than a cell, through which the mass would leak.
    """
    found = []
    for name, mesh, wall in bodies:
        if wall.kind == "open" or not len(mesh.triangles):
            continue
        _require_no_holes(name, mesh, grid)
        near = near_nodes(mesh, grid, DEPTH)
        inside = (near.distances <= ON_SURFACE * grid.spacing) & ~near.at_border
        entries = np.column_stack([near.normals[inside], np.full(int(inside.sum()), wall.coefficient)])
        found.append((near.nodes[inside], near.distances[inside], entries))
    if not found:
        return ContactNodes.none(grid)
    nodes, depths, entries = (np.concatenate(parts) for parts in zip(*found, strict=True))
    flat = (nodes[:, 0] * grid.shape[1] + nodes[:, 1]) * grid.shape[2] + nodes[:, 2]
    order = np.lexsort((depths, flat))
    first = np.ones(len(order), bool)
    first[1:] = np.diff(flat[order]) > 0
    return _by_column(nodes[order][first], entries[order][first], grid)


def _by_column(nodes: npt.NDArray[np.int64], entries: Float64Array, grid: Grid) -> ContactNodes:
    """Pack nodes (m, 3), ordered by column and layer, with their entries (m, 4)."""
    if not len(nodes):
        return ContactNodes.none(grid)
    column = nodes[:, 0] * grid.shape[1] + nodes[:, 1]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
    ends = np.concatenate([starts[1:], [len(column)]]) - 1
    lowest, counts = nodes[starts, 2], nodes[ends, 2] - nodes[starts, 2] + 1
    offsets = np.cumsum(counts) - counts
    columns = np.zeros((grid.shape[0] * grid.shape[1], 3), np.int32)
    columns[column[starts]] = np.stack([lowest, counts, offsets], axis=1)
    which = np.searchsorted(column[starts], column)
    normals = np.zeros((int(counts.sum()), 4))
    normals[offsets[which] + nodes[:, 2] - lowest[which]] = entries
    return ContactNodes(columns.reshape(*grid.shape[:2], 3), normals)


def _require_no_holes(name: str, mesh: TriangleMesh, grid: Grid) -> None:
    wide = [hole for hole in mesh.holes() if np.linalg.norm(hole[1] - hole[0]) > grid.spacing]
    if wide:
        centre = wide[0].mean(axis=0)
        raise InputError(
            f"the {name} has {len(wide)} holes wider than a cell, the first around "
            f"({centre[0]:.2f}, {centre[1]:.2f}, {centre[2]:.2f}) m: the mass would fall through",
            where=name,
            cure="close the mesh's holes; only its outer border may be open",
        )
