"""How long the signed distance of grid nodes to a terrain takes, beside the plain search of every triangle's own box.

    python benchmarks/distance.py [--triangles N] [--spacing M]

The ground is a square of 100 m with hills and roughness. Both searches must find the same distances.
"""

import argparse
import time

import numpy as np
from machine import print_machine

from slideframe.contact import TriangleMesh
from slideframe.contact.distance import closest_points, near_nodes
from slideframe.problem.grid import place_grid

EDGE, REACH = 100.0, 3.0
TRIANGLES_AT_ONCE = 2_000


def ground(triangles: int) -> TriangleMesh:
    count = round((triangles / 2) ** 0.5) + 1
    x, y = np.meshgrid(np.linspace(0, EDGE, count), np.linspace(0, EDGE, count), indexing="ij")
    z = 0.4 * y + 4 * np.sin(x / 9) * np.cos(y / 13) + np.random.default_rng(1).normal(0, 0.05, x.shape)
    index = np.arange(count**2).reshape(count, count)
    one, two, three, four = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((one, two, three), (one, three, four))]
    return TriangleMesh.welded(np.stack([x, y, z], axis=-1).reshape(-1, 3), np.concatenate(faces))


def plain(mesh: TriangleMesh, grid) -> dict[int, float]:
    """Return the distance in cells by flat node: each triangle against all nodes of the box around it."""
    best = np.full(grid.node_count, np.inf)
    corners = (mesh.corners - np.array(grid.origin)) / grid.spacing
    shape = np.array(grid.shape)
    for part in np.array_split(np.arange(len(corners)), max(1, len(corners) // TRIANGLES_AT_ONCE)):
        low = np.clip(np.ceil(corners[part].min(axis=1) - REACH), 0, shape).astype(int)
        high = np.clip(np.floor(corners[part].max(axis=1) + REACH) + 1, 0, shape).astype(int)
        sizes = np.maximum(high - low, 0)
        counts = sizes.prod(axis=1)
        which = np.repeat(np.arange(len(part)), counts)
        place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        rest, k = np.divmod(place, sizes[which, 2])
        i, j = np.divmod(rest, sizes[which, 1])
        nodes = low[which] + np.stack([i, j, k], axis=1)
        points = nodes.astype(float)
        closest, _ = closest_points(points, corners[part][which])
        np.minimum.at(best, np.ravel_multi_index(tuple(nodes.T), grid.shape), np.linalg.norm(points - closest, axis=1))
    within = np.flatnonzero(best <= REACH)
    return dict(zip(within.tolist(), best[within].tolist(), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--triangles", type=int, default=250_000)
    parser.add_argument("--spacing", type=float, default=0.8)
    options = parser.parse_args()
    print_machine("slideframe", "numpy", "scipy")
    mesh = ground(options.triangles)
    grid = place_grid(np.array([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)]), options.spacing)
    mesh.edge_normals, mesh.vertex_normals, mesh.border_vertices  # noqa: B018  # made once for a mesh
    clock = time.perf_counter(), time.process_time()
    near = near_nodes(mesh, grid, REACH)
    trees = time.perf_counter() - clock[0], time.process_time() - clock[1]
    clock = time.perf_counter(), time.process_time()
    known = plain(mesh, grid)
    boxes = time.perf_counter() - clock[0], time.process_time() - clock[1]
    flat = np.ravel_multi_index(tuple(near.nodes.T), grid.shape)
    assert flat.tolist() == list(known)
    off = np.abs(np.abs(near.distances) / grid.spacing - np.array(list(known.values()))).max()
    print(f"{len(mesh.triangles):,} triangles, {len(flat):,} nodes within {REACH:g} cells of {grid.spacing:g} m")
    print(f"  by trees        {trees[0]:6.2f} s, {trees[1]:6.2f} s of processors")
    print(f"  plain           {boxes[0]:6.2f} s, {boxes[1]:6.2f} s of processors: {boxes[1] / trees[1]:.1f} times")
    print(f"  they differ by {off:.1e} cells at most")


if __name__ == "__main__":
    main()
