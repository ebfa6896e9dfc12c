"""Chooses the splats that the surface rests on, and turns their normals to the air."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import SplatCloud, Survey

SPACING_NEIGHBORS = 8
# Splats per z-buffer cell that make a gap in the nearer surface improbable (e^-6 for random positions).
SPLATS_PER_CELL = 6


# Sine of the angle between a surface and the views of it below which they don't tell its sides apart.
GRAZING = 0.05


@dataclass(frozen=True)
class Support:
    """Centres of the splats that stand for ground.

    Attributes:
        indices: of the splats in the cloud (support,).
        centers: (support, 3), m.
        normals: unit vectors out of the ground (support, 3).
        spacing: mean distance of neighbouring splats on the surface, m.
    """

    indices: np.ndarray
    centers: Float64Array
    normals: Float64Array
    spacing: float


def solid_splats(splats: SplatCloud, minimum_opacity: float, oversize_ratio: float) -> np.ndarray:
    """Return the indices of splats that are neither faint nor far larger than is usual."""
    opaque = splats.opacities >= minimum_opacity
    largest = splats.scales.max(axis=1)
    usual = np.median(largest[opaque]) if opaque.any() else 0.0
    return np.flatnonzero(opaque & (largest <= oversize_ratio * usual))


def widened(rectangle: Float64Array, margin: float) -> Float64Array:
    """Return a rectangle (2, 2) with its sides moved out by `margin` metres."""
    wide: Float64Array = rectangle + np.array([[-margin], [margin]])
    return wide


def within(centers: Float32Array | Float64Array, rectangle: Float64Array) -> np.ndarray:
    """Tell which points stand above a rectangle (2, 2) in plan, m."""
    inside: np.ndarray = ((centers[:, :2] >= rectangle[0]) & (centers[:, :2] <= rectangle[1])).all(axis=1)
    return inside


def near_neighbors(centers: Float64Array, neighbors: int, deviations: float) -> np.ndarray:
    """Return the indices of points that don't float.

    A point floats where its mean distance to its `neighbors` nearest exceeds the mean of all points by
    `deviations` standard deviations (Rusu et al. 2008, "Towards 3D point cloud based object maps").
    """
    distances = _neighbor_distances(centers, neighbors).mean(axis=1)
    return np.flatnonzero(distances <= distances.mean() + deviations * distances.std())


def surface_spacing(centers: Float64Array) -> float:
    """Return the mean spacing of points on a surface, m.

    Of points strewn with density rho, pi r_k^2 rho = k at the k-th neighbour, and the spacing is rho^-1/2. The
    k-th neighbour is used because splats that were split lie in pairs.
    """
    distance = np.median(_neighbor_distances(centers, SPACING_NEIGHBORS)[:, -1])
    return float(distance * np.sqrt(np.pi / SPACING_NEIGHBORS))


def outward_normals(centers: Float64Array, survey: Survey, neighbors: int, spacing: float) -> Float64Array:
    """Fit a plane through each point's neighbours and turn its normal towards the cameras that see it.

    Cameras count by the inverse square of their distance. Where they are undecided, or none sees the
    point, the normal points up.
    """
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(centers))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(neighbors))
    normals = np.asarray(cloud.normals).copy()
    views = np.zeros_like(centers)
    for index in range(len(survey.photographs)):
        towards = survey.world_from_camera[index, :, 3] - centers
        weight = seen_from(centers, survey, index, spacing) / np.linalg.norm(towards, axis=1) ** 3
        views += weight[:, None] * towards
    agreement = np.einsum("ij,ij->i", normals, views)
    undecided = np.abs(agreement) <= GRAZING * np.linalg.norm(views, axis=1)
    agreement[undecided] = normals[undecided, 2]
    normals[agreement < 0] *= -1
    return normals


def seen_from(centers: Float64Array, survey: Survey, index: int, spacing: float) -> np.ndarray:
    """Tell which points lie in the picture and are not hidden behind nearer points.

    The lens's distortion moves points by a few pixels at the rim only, which doesn't matter here.
    """
    camera, pose = survey.camera_of(index), survey.world_from_camera[index]
    local = (centers - pose[:, 3]) @ pose[:, :3]
    ahead = local[:, 2] > spacing
    depth = np.where(ahead, local[:, 2], 1.0)
    column = camera.focal_x * local[:, 0] / depth + camera.principal_x
    row = camera.focal_y * local[:, 1] / depth + camera.principal_y
    seen: np.ndarray = ahead & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    if not seen.any():
        return seen
    cell = max(np.sqrt(SPLATS_PER_CELL) * spacing * camera.focal_x / np.median(depth[seen]), 1.0)
    columns = int(camera.width / cell) + 1
    cells = (row[seen] / cell).astype(np.int64) * columns + (column[seen] / cell).astype(np.int64)
    nearest = np.full(cells.max() + 1, np.inf)
    np.minimum.at(nearest, cells, depth[seen])
    # within a cell, a surface seen at up to 70 degrees from its normal spans tan(70) = 2.7 cells of depth
    hidden = depth[seen] > nearest[cells] + 2.7 * np.sqrt(SPLATS_PER_CELL) * spacing
    seen[np.flatnonzero(seen)[hidden]] = False
    return seen


def distance_to(centers: Float64Array, points: Float64Array) -> Float64Array:
    """Return how far each point is from the nearest of the centres (point,), m."""
    from scipy.spatial import cKDTree

    distances: Float64Array = cKDTree(centers).query(points, workers=-1)[0]
    return distances


def _neighbor_distances(centers: Float64Array, neighbors: int) -> Float64Array:
    from scipy.spatial import cKDTree

    distances: Float64Array = cKDTree(centers).query(centers, k=neighbors + 1, workers=-1)[0]
    return distances[:, 1:]
