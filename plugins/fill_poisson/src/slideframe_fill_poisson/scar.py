"""Splats of the slip surface: what the ground shows once the mass has left it."""

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import SplatCloud
from slideframe_fill_poisson.appearance import SoilColors
from slideframe_fill_poisson.interior import DRAWN_SIGMAS, SHRINKING, axes_about, quaternions_of
from slideframe_fill_poisson.rays import Body, tensor
from slideframe_fill_poisson.solids import Mesh
from slideframe_fill_poisson.surface import Surface

# On a square lattice of splats 0.75 spacings wide, 0.5 % of light gets through where it is thinnest.
IN_PLANE_SHARE = 0.75
FINENESS = 0.4  # of the surface's spacing: what opens is looked at
THICKNESS_SHARE = 0.1
MOST_SPLATS = 60_000
OPACITY = 0.99


def scar_splats(
    scar: Mesh, surface: Surface, soil: Body, spacing: float, particle_spacing: float, colors: SoilColors
) -> SplatCloud:
    """Return flat, opaque splats just behind the faces of the slip surface and of the pit's sides.

    They are hidden as long as the mass lies on them: each is sunk by three times its thickness, and one whose
    ends would stick out of the soil beside the mass is made narrower.

    Args:
        scar: faces with normals out of the ground that stays.
        surface: the ground.
        soil: all soil, the mass included.
        spacing: of the surface's splats, m; those of the scar lie closer unless it is too large.
        particle_spacing: m.
        colors: of the soil.
    """
    if not len(scar.triangles):
        return SplatCloud.empty()
    wide = max(FINENESS * spacing, float(np.sqrt(_area(scar) / MOST_SPLATS)))
    points, normals = _lattice_points(scar, wide)
    thickness = THICKNESS_SHARE * wide
    centers = (points - DRAWN_SIGMAS * thickness * normals).astype(np.float32)
    kept = soil.inside(centers)
    centers, normals = centers[kept], normals[kept]
    axes = axes_about(normals)
    scales = np.column_stack([np.full(len(centers), thickness), _widths(centers, axes, soil, IN_PLANE_SHARE * wide)])
    foot, vertex = surface.nearest(centers)
    return SplatCloud(
        centers=centers,
        rotations=quaternions_of(axes).astype(np.float32),
        scales=scales.astype(np.float32),
        opacities=np.full(len(centers), OPACITY, np.float32),
        harmonics=colors.at(centers, foot, vertex, wide),
    )


def _lattice_points(mesh: Mesh, spacing: float) -> tuple[Float64Array, Float64Array]:
    """Return points (point, 3) on the faces and their normals.

    They lie on a square lattice seen along the axis that a face looks along most, so that neighbours are at most
    sqrt(3) spacings apart on the face.
    """
    import open3d

    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(mesh.vertices.astype(np.float32)), tensor(mesh.triangles.astype(np.uint32)))
    low, high = mesh.vertices.min(axis=0) - spacing, mesh.vertices.max(axis=0) + spacing
    normals = _normals(mesh)
    main = np.abs(normals).argmax(axis=1)
    points, found = [], []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        # seen obliquely, a face needs a finer lattice: half of all directions deviate by more than 25 degrees
        fine = spacing * 0.9
        across, along = (np.arange(low[other], high[other], fine) for other in others)
        rays = np.zeros((len(across) * len(along), 6), np.float32)
        rays[:, others] = np.stack(np.meshgrid(across, along, indexing="ij"), axis=-1).reshape(-1, 2)
        rays[:, axis], rays[:, 3 + axis] = low[axis], 1.0
        hits = scene.list_intersections(tensor(rays))
        triangle = hits["primitive_ids"].numpy().astype(np.int64)
        mine = main[triangle] == axis
        ray, triangle = hits["ray_ids"].numpy().astype(np.int64)[mine], triangle[mine]
        place = rays[ray, :3].astype(np.float64)
        place[:, axis] += hits["t_hit"].numpy()[mine]
        points.append(place)
        found.append(normals[triangle])
    return np.concatenate(points), np.concatenate(found)


def _widths(centers: Float32Array, axes: Float64Array, soil: Body, width: float) -> Float64Array:
    """Return the standard deviations along the middle and the long axis (splat, 2), their drawn ends in the soil."""
    widths = np.full((len(centers), 2), width)
    for column in range(2):
        doubtful = np.arange(len(centers))
        for share in SHRINKING:
            widths[doubtful, column] = share * width
            reach = DRAWN_SIGMAS * share * width * axes[doubtful, :, 1 + column]
            ends = np.stack([centers[doubtful] + reach, centers[doubtful] - reach], axis=1)
            out = ~soil.inside(ends.reshape(-1, 3).astype(np.float32)).reshape(-1, 2).all(axis=1)
            doubtful = doubtful[out]
        widths[doubtful, column] = THICKNESS_SHARE * width
    return widths


def _normals(mesh: Mesh) -> Float64Array:
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    units: Float64Array = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return units


def _area(mesh: Mesh) -> float:
    corners = mesh.vertices[mesh.triangles]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(sides, axis=1).sum() / 2)
