"""The grid nodes that lie in solid ground, by column, for any solver's grid."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slideframe.arrays import Float64Array, Int32Array
from slideframe.contact.bodies import Body
from slideframe.contact.distance import near_nodes
from slideframe.contact.mesh import IntArray
from slideframe.problem import Grid
from slideframe.problem.boundary import STICKS

# Nodes that deep, in cells, act: no particle crosses more than one of them in a substep.
DEPTH = 3.0
# A node on the surface itself counts as inside: the rounding of its distance, in cells.
ON_SURFACE = 1e-6


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

    def indices(self) -> tuple[IntArray, Float64Array]:
        """Return the nodes (m, 3) in the ground and their normals and coefficients (m, 4)."""
        i, j = np.nonzero(self.columns[..., 1])
        lowest, counts, starts = self.columns[i, j].astype(np.int64).T
        which = np.repeat(np.arange(len(i)), counts)
        step = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        normals = self.normals[starts[which] + step]
        inside = normals[:, :3].any(axis=1)
        nodes = np.stack([i[which], j[which], lowest[which] + step], axis=1)
        return nodes[inside], normals[inside]


class SolidNodes(NamedTuple):
    """The nodes in one body.

    Attributes:
        nodes: (m, 3), their indices.
        distances: (m,), m, from the surface; negative inside.
        entries: (m, 4), as ContactNodes.normals.
    """

    nodes: IntArray
    distances: Float64Array
    entries: Float64Array


def solid_nodes(body: Body, grid: Grid) -> SolidNodes:
    """Return the nodes of `grid` in a body, as far as DEPTH from its surface.

    Raises:
        InputError: the mesh has a hole wider than a cell, through which the mass would leak.
    """
    body.require_no_holes(grid.spacing)
    near = near_nodes(body.mesh, grid, DEPTH)
    inside = (near.distances <= ON_SURFACE * grid.spacing) & ~near.at_border
    entries = np.column_stack([near.normals[inside], np.full(int(inside.sum()), body.wall.coefficient)])
    return SolidNodes(near.nodes[inside], near.distances[inside], entries)


def merge(parts: Sequence[SolidNodes], grid: Grid) -> ContactNodes:
    """Return the nodes of all bodies; where two share a node the deeper one acts, which is that of their union."""
    if not parts:
        return ContactNodes.none(grid)
    nodes, depths, entries = (np.concatenate(values) for values in zip(*parts, strict=True))
    flat = (nodes[:, 0] * grid.shape[1] + nodes[:, 1]) * grid.shape[2] + nodes[:, 2]
    order = np.lexsort((depths, flat))
    first = np.ones(len(order), bool)
    first[1:] = np.diff(flat[order]) > 0
    return _by_column(nodes[order][first], entries[order][first], grid)


def _by_column(nodes: IntArray, entries: Float64Array, grid: Grid) -> ContactNodes:
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
