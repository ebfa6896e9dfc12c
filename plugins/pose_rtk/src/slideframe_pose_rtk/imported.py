"""Cameras that another program has found already, brought into the survey's frame."""

from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError
from slideframe.formats.posed_camera import PosedCamera
from slideframe.formats.posed_model import PosedModel
from slideframe.geodesy import ecef_from_geodetic, enu_axes
from slideframe.products import Georeference
from slideframe.stages import Context
from slideframe_pose_rtk.control import Target
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.intake import LEAST_PHOTOGRAPHS
from slideframe_pose_rtk.model_views import views_by_photograph
from slideframe_pose_rtk.sessions import sessions_of
from slideframe_pose_rtk.sighted import compare
from slideframe_pose_rtk.solution import Solution
from slideframe_pose_rtk.sparse import SparsePoints

# Camera centres closer to one line than this share of their spread leave the turn about it open.
LEAST_SPREAD = 0.02
REWEIGHTINGS = 10
# Residuals beyond this many median ones pull no more; the median of a 3-D normal residual is 1.54 sigma.
FARTHEST_MEDIANS = 4.0
ACCEPTED_OFFSET = 5.0  # m between a model's own reference and the positions: beyond, one has another datum


@dataclass(frozen=True, eq=False)
class Similarity:
    """x -> scale rotation x + translation."""

    scale: float
    rotation: Float64Array
    translation: Float64Array

    def points(self, points: Float64Array) -> Float64Array:
        """Carry (point, 3) over."""
        return self.scale * points @ self.rotation.T + self.translation

    def pose(self, pose: Float64Array) -> Float64Array:
        """Carry world from camera (3, 4) over."""
        return np.column_stack([self.rotation @ pose[:, :3], self.points(pose[None, :, 3])[0]])


def solve_from_model(flight: Flight, model: PosedModel, targets: tuple[Target, ...], context: Context) -> Solution:
    """Take the model's poses, cameras and points, in the frame of the flight.

    A model with a reference of its own is moved by it; any other by the similarity that best carries its camera
    centres to the photographs' stated positions, each weighted by its sigma.

    Raises:
        InputError: too few of the model's views are photographs of the survey, or their centres lie on one line.
    """
    views = _by_photograph(flight, model.views, context)
    for remark in model.remarks:
        context.warn(f"of the imported model: {remark}")
    indices = sorted(views)
    centres = np.array([views[index].world_from_camera[:, 3] for index in indices])
    stated, sigma = flight.positions[indices], flight.position_sigma[indices]
    if model.georeference:
        similarity = between_frames(model.georeference, flight.georeference)
        _check_reference(similarity, centres, stated, context)
        context.figure("model_reference", "the model's own")
    else:
        similarity = fit_similarity(centres, stated, 1 / sigma.mean(axis=1) ** 2, str(flight.folder))
        context.figure("model_reference", "similarity to the photographs' stated positions")
        context.figure("model_scale", similarity.scale)
    cameras = tuple(dict.fromkeys(views[index].camera for index in indices))
    points = SparsePoints(similarity.points(model.points), _known_errors(model, context), model.colors)
    poses = {index: similarity.pose(views[index].world_from_camera) for index in indices}
    camera_of = {index: cameras.index(views[index].camera) for index in indices}
    return Solution(
        poses=poses,
        cameras=cameras,
        camera_of=camera_of,
        ground_points=compare(targets, poses, cameras, camera_of),
        points=points,
        sessions=sessions_of(flight.records),
        focal_length_rule="as imported",
        principal_point_rule="as imported",
        origin="imported",
    )


def between_frames(source: Georeference, target: Georeference) -> Similarity:
    """Return what carries east-north-up about `source` to east-north-up about `target`, exactly."""
    origins = [
        ecef_from_geodetic(np.array([[place.latitude, place.longitude, place.ellipsoidal_height]]))[0]
        for place in (source, target)
    ]
    axes = enu_axes(target)
    return Similarity(1.0, axes @ enu_axes(source).T, axes @ (origins[0] - origins[1]))


def fit_similarity(source: Float64Array, target: Float64Array, weights: Float64Array, where: str) -> Similarity:
    """Return the similarity of least weighted squares (Umeyama 1991), reweighted so that outliers don't pull.

    Raises:
        InputError: the points lie on one line.
    """
    kept = np.ones(len(source))
    for _ in range(REWEIGHTINGS):
        similarity = _umeyama(source, target, weights * kept, where)
        residual = np.linalg.norm(similarity.points(source) - target, axis=1)
        limit = FARTHEST_MEDIANS * np.median(residual)
        fresh = np.minimum(1.0, limit / np.maximum(residual, max(limit, 1e-12))) ** 2 * (residual <= 2 * limit)
        if np.array_equal(fresh, kept) or limit < 1e-9:
            break
        kept = fresh
    return similarity


def _umeyama(source: Float64Array, target: Float64Array, weights: Float64Array, where: str) -> Similarity:
    share = weights / weights.sum()
    source_mean, target_mean = share @ source, share @ target
    from_mean, to_mean = source - source_mean, target - target_mean
    spread = np.linalg.svd(np.sqrt(share)[:, None] * from_mean, compute_uv=False)
    if spread[1] < LEAST_SPREAD * spread[0]:
        raise InputError(
            "the imported model's cameras lie on one line, so their positions leave the turn about it open",
            where=where,
            cure="import a model with a reference of its own, or let pose_rtk locate the cameras",
        )
    left, singular, right = np.linalg.svd(to_mean.T @ (share[:, None] * from_mean))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = left @ np.diag(signs) @ right
    scale = float((singular * signs).sum() / (share @ (from_mean**2).sum(axis=1)))
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean)


def _known_errors(model: PosedModel, context: Context) -> Float64Array:
    unknown = ~np.isfinite(model.errors)
    if unknown.any():
        context.warn("the imported model doesn't keep its points' reprojection errors: they are written as 0")
    return np.where(unknown, 0.0, model.errors)


def _by_photograph(flight: Flight, views: tuple[PosedCamera, ...], context: Context) -> dict[int, PosedCamera]:
    """Find the views' photographs.

    Raises:
        InputError: fewer than three are found, or a photograph isn't of its camera's size.
    """
    found = views_by_photograph([flight.name(index) for index in range(len(flight))], views)
    for index, view in found.items():
        size = flight.records[index].size
        if size != (view.camera.width, view.camera.height):
            raise InputError(
                f"{flight.name(index)} is {size[0]}x{size[1]} px, but {view.camera.width}x{view.camera.height} in"
                " the imported model",
                where=str(flight.folder),
                cure="give the very photographs that the model was made from",
            )
    if len(found) < LEAST_PHOTOGRAPHS:
        raise InputError(
            f"only {len(found)} of the imported model's {len(views)} views are usable photographs of this folder",
            where=str(flight.folder),
            cure=f"give the folder of its photographs; the model names {', '.join(view.name for view in views[:3])}",
        )
    if len(found) < len(views):
        context.warn(f"{len(views) - len(found)} of the imported model's {len(views)} views have no photograph here")
    return found


def _check_reference(similarity: Similarity, centres: Float64Array, stated: Float64Array, context: Context) -> None:
    offset = np.median(similarity.points(centres) - stated, axis=0)
    if np.abs(offset).max() > ACCEPTED_OFFSET:
        east, north, up = offset
        context.warn(
            f"the imported model's own reference lies {east:+.1f}, {north:+.1f}, {up:+.1f} m (east, north, up; median)"
            " off the photographs' positions: the two have different datums or height levels"
        )
