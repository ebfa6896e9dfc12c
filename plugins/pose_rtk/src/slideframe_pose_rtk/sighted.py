"""Surveyed points in the adjustment, and compared with it."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.photographs import distort
from slideframe.products import Camera, GroundPoint
from slideframe_pose_rtk.control import Target
from slideframe_pose_rtk.features import Features
from slideframe_pose_rtk.flight import Poses

if TYPE_CHECKING:
    import pycolmap

TargetRows = dict[tuple[int, int], int]

LEAST_SIGHTINGS = 2
ITERATIONS = 20
CONVERGED = 1e-6  # m
STEP = 1e-4  # m, of the numerical derivative
# m; in the first round heights may be off by a tenth of the flying height: the focal length is still metadata's
LARGEST_OFFSET = 10.0
OFFSET_SIGMAS = 6.0
SMALL_ANGLE = 1e-4  # least ratio of a place's uncertainty across to along the rays that determine it


def mark_features(features: Sequence[Features], targets: Sequence[Target]) -> tuple[list[Features], TargetRows]:
    """Append each target's sightings to the photographs' features; return also their rows, by target and photograph."""
    marked, rows = list(features), {}
    for number, target in enumerate(targets):
        for index, (column, row) in target.sightings.items():
            known = marked[index]
            rows[number, index] = len(known.keypoints)
            keypoint = np.array([[column, row, 1.0, 0.0]], np.float32)
            marked[index] = dataclasses.replace(known, keypoints=np.concatenate([known.keypoints, keypoint]))
    return marked, rows


def add_control(reconstruction: "pycolmap.Reconstruction", targets: Sequence[Target], rows: TargetRows) -> list[int]:
    """Add control points to a reconstruction with their sightings; return their numbers, to be held fixed."""
    import pycolmap

    numbers = []
    for number, target in enumerate(targets):
        seen = [
            index
            for index in target.sightings
            if reconstruction.exists_image(index + 1) and reconstruction.image(index + 1).has_pose
        ]
        if target.role == "control" and len(seen) >= LEAST_SIGHTINGS:
            track = pycolmap.Track()
            for index in seen:
                track.add_element(index + 1, rows[number, index])
            numbers.append(reconstruction.add_point3D(target.position, track, np.array([255, 0, 255], np.uint8)))
    return numbers


def require_one_datum(targets: Sequence[GroundPoint], sigma: Float64Array, where: str) -> None:
    """Refuse surveyed points that lie apart from the photographs' positions as a whole; `sigma` (3,), m, is theirs.

    Raises:
        InputError: with the offset, and what it looks like.
    """
    residuals = np.array([target.residual for target in targets if target.residual])
    if not len(residuals):
        return
    offset = np.median(residuals, axis=0)
    if (np.abs(offset) > np.maximum(LARGEST_OFFSET, OFFSET_SIGMAS * sigma)).any():
        east, north, up = offset
        raise InputError(
            f"the photographs see the surveyed points {east:+.1f}, {north:+.1f}, {up:+.1f} m (east, north, up; median)"
            " from where they were surveyed",
            where=where,
            cure="give the right control_epsg; if heights alone differ, they are above the sea on one side and above"
            " the ellipsoid on the other: name the column for what it is, and give geoid_offset or geoid_grid",
        )


def compare(
    targets: Sequence[Target], poses: Poses, cameras: Sequence[Camera], camera_of: Mapping[int, int]
) -> tuple[GroundPoint, ...]:
    """Return each point with where the photographs see it: the place of least reprojection error of its sightings."""
    return tuple(_compared(target, poses, cameras, camera_of) for target in targets)


def _compared(target: Target, poses: Poses, cameras: Sequence[Camera], camera_of: Mapping[int, int]) -> GroundPoint:
    seen = {index: pixel for index, pixel in target.sightings.items() if index in poses}
    east, north, up = (float(value) for value in target.position)
    point = GroundPoint(name=target.name, role=target.role, position=(east, north, up), sightings=len(seen))
    if len(seen) < LEAST_SIGHTINGS:
        return point
    views = [(poses[index], cameras[camera_of[index]]) for index in seen]
    place = _intersect(views, np.array(list(seen.values())))
    if place is None:
        return point
    error = _project(place, views) - np.array(list(seen.values()))
    d_east, d_north, d_up = (float(value) for value in place - target.position)
    rms = float(np.sqrt(np.mean((error**2).sum(axis=1))))
    return point.model_copy(update={"residual": (d_east, d_north, d_up), "reprojection_error": rms})


def _intersect(views: Sequence[tuple[Float64Array, Camera]], pixels: Float64Array) -> Float64Array | None:
    """Return the place (3,) of least squared reprojection error by Gauss and Newton; None if the rays are parallel.

    It starts where the rays come closest to one another.
    """
    rays = np.array([_ray(pose, camera, pixel) for (pose, camera), pixel in zip(views, pixels, strict=True)])
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    centres = np.array([pose[:, 3] for pose, _ in views])
    place = np.linalg.lstsq(across.sum(axis=0), np.einsum("vij,vj->i", across, centres), rcond=None)[0]
    for _ in range(ITERATIONS):
        error = (_project(place, views) - pixels).ravel()
        slope = np.column_stack(
            [
                (_project(place + step, views) - _project(place - step, views)).ravel() / (2 * STEP)
                for step in STEP * np.eye(3)
            ]
        )
        singular = np.linalg.svd(slope, compute_uv=False)
        if singular[-1] < SMALL_ANGLE * singular[0]:
            return None
        move = np.linalg.lstsq(slope, -error, rcond=None)[0]
        place = place + move
        if np.linalg.norm(move) < CONVERGED:
            return place
    return place


def _ray(pose: Float64Array, camera: Camera, pixel: Float64Array) -> Float64Array:
    """Return the unit direction (3,) in which a pixel looks; the lens is inverted by repeated correction."""
    seen = (pixel - [camera.principal_x, camera.principal_y]) / [camera.focal_x, camera.focal_y]
    slopes = seen.copy()
    for _ in range(ITERATIONS):
        slopes = slopes + seen - distort(slopes, camera.distortion)
    ray = pose[:, :3] @ np.append(slopes, 1.0)
    unit: Float64Array = ray / np.linalg.norm(ray)
    return unit


def _project(place: Float64Array, views: Sequence[tuple[Float64Array, Camera]]) -> Float64Array:
    """Return (view, 2) px of one place."""
    pixels = []
    for pose, camera in views:
        x, y, depth = (place - pose[:, 3]) @ pose[:, :3]
        slopes = distort(np.array([x / depth, y / depth]), camera.distortion)
        pixels.append(slopes * [camera.focal_x, camera.focal_y] + [camera.principal_x, camera.principal_y])
    return np.array(pixels)
