"""The survey as a product, and the figures that say how good it is."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from slideframe.arrays import Float64Array, UInt8Array
from slideframe.products import LeftOut, Photograph, Survey
from slideframe.quality.pictures import PictureQuality
from slideframe.stages import Context
from slideframe_pose_rtk.features import Features
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.orientation import about_up, angle_between, yaw_bias
from slideframe_pose_rtk.solution import Solution

Sightings = dict[int, tuple[list[int], list[tuple[float, float]]]]

FOCAL_LENGTH_DOUBT = 0.01  # of the focal length, for the statement of what it does to heights


def survey_of(
    flight: Flight, solution: Solution, files: Sequence[Path], digests: Sequence[str], features: Sequence[Features]
) -> Survey:
    """Return the registered photographs in file order, the cameras they use, and the accepted points.

    `files` are all that were found; those without a pose are named with the reason.
    """
    registered = sorted(solution.poses)
    used = sorted({flight.camera_of[index] for index in registered})
    points, colors, errors = _points(flight, solution)
    return Survey(
        georeference=flight.georeference,
        cameras=tuple(solution.cameras[camera] for camera in used),
        photographs=tuple(
            _photograph(flight, index, used.index(flight.camera_of[index]), digests[index], features[index].quality)
            for index in registered
        ),
        world_from_camera=np.array([solution.poses[index] for index in registered]),
        position_sigma=flight.position_sigma[registered],
        sparse_points=points.astype(np.float32),
        sparse_colors=colors,
        sparse_errors=errors.astype(np.float32),
        left_out=_left_out(flight, solution, files, features),
    )


def _photograph(flight: Flight, index: int, camera: int, sha256: str, quality: PictureQuality | None) -> Photograph:
    record = flight.records[index]
    return Photograph(
        path=record.path,
        camera=camera,
        sha256=sha256,
        fix=record.fix,
        stated_position=_triple(flight.positions[index]),
        sharpness=quality.sharpness if quality else None,
        fault=quality.fault if quality else None,
    )


def _left_out(
    flight: Flight, solution: Solution, files: Sequence[Path], features: Sequence[Features]
) -> tuple[LeftOut, ...]:
    """Name the photographs without a pose: unusable by their metadata, or not registered."""
    by_path = {record.path: index for index, record in enumerate(flight.records)}
    found = []
    for path in files:
        index = by_path.get(path)
        if index is None:
            found.append(LeftOut(path=path, reason="its file or metadata can't be used, see the warnings"))
        elif index not in solution.poses:
            quality = features[index].quality
            fault = quality.fault if quality else None
            found.append(
                LeftOut(
                    path=path,
                    reason=_reason(quality, len(features[index].keypoints)),
                    fix=flight.records[index].fix,
                    stated_position=_triple(flight.positions[index]),
                    fault=fault,
                )
            )
    return tuple(found)


def _reason(quality: PictureQuality | None, feature_count: int) -> str:
    if quality is None:
        return "its pixels can't be decoded"
    if quality.fault:
        return {"covered": "nothing to see, the lens may be covered", "blurred": "too blurred to register"}[
            quality.fault
        ]
    return f"not registered: too few of its {feature_count} features are seen by others where they should be"


def _triple(place: Float64Array) -> tuple[float, float, float]:
    east, north, up = (float(value) for value in place)
    return east, north, up


def report(flight: Flight, solution: Solution, survey: Survey, context: Context) -> None:
    """State the figures of the survey."""
    registered = sorted(solution.poses)
    context.figure("photographs", len(flight))
    context.figure("registered_photographs", len(registered))
    context.figure("sparse_points", len(survey.sparse_points))
    context.figure("reprojection_error_px", float(np.mean(survey.sparse_errors)) if len(survey.sparse_errors) else 0.0)
    context.figure("rtk_fixed_share", float(np.mean([flight.records[index].fix == "fixed" for index in registered])))
    if solution.refined:
        _report_centres(flight, registered, survey, context)
        _report_gimbal(flight, registered, survey, context)
    _report_scale(solution, survey, context)


def _report_centres(flight: Flight, registered: list[int], survey: Survey, context: Context) -> None:
    """State how far the camera centres moved from the metadata's positions, rms."""
    residual = survey.world_from_camera[:, :, 3] - flight.positions[registered]
    for axis, value in zip(("east", "north", "up"), np.sqrt(np.mean(residual**2, axis=0)), strict=True):
        context.figure(f"centre_residual_{axis}_m", float(value))


def _report_gimbal(flight: Flight, registered: list[int], survey: Survey, context: Context) -> None:
    """State how far the gimbal angles are off, with and without one turn about the vertical for the whole survey."""
    known = flight.oriented[registered]
    if not known.any():
        return
    found = survey.world_from_camera[known, :, :3]
    stated = flight.rotations[registered][known]
    bias = yaw_bias(found, stated)
    context.figure("gimbal_yaw_bias_deg", bias)
    context.figure("gimbal_error_raw_deg", float(np.median(angle_between(found, stated))))
    context.figure("gimbal_error_deg", float(np.median(angle_between(found, about_up(bias) @ stated))))


def _report_scale(solution: Solution, survey: Survey, context: Context) -> None:
    """State pixel size on the ground, focal length, and what 1 % of it does to heights: dH = H df / f."""
    focal_length = survey.cameras[0].focal_x
    context.figure("focal_length_px", focal_length)
    context.figure("focal_length_free", solution.focal_length_free)
    if len(survey.sparse_points):
        distance = float(np.median(_distances(survey)))
        context.figure("ground_sampling_distance_m", distance / focal_length)
        context.figure("height_sensitivity_m", distance * FOCAL_LENGTH_DOUBT)


def _distances(survey: Survey) -> Float64Array:
    """Return each photograph's median depth of the points before it, m."""
    depths = []
    for index, pose in enumerate(survey.world_from_camera):
        camera = survey.camera_of(index)
        x, y, depth = ((survey.sparse_points - pose[:, 3]) @ pose[:, :3]).T
        ahead = depth > 0
        inside = ahead & (np.abs(x) < depth * camera.width / (2 * camera.focal_x))
        inside &= np.abs(y) < depth * camera.height / (2 * camera.focal_y)
        if inside.any():
            depths.append(np.median(depth[inside]))
    return np.array(depths or [0.0], np.float64)


def _points(flight: Flight, solution: Solution) -> tuple[Float64Array, UInt8Array, Float64Array]:
    """Return positions, colours and reprojection errors of the points within the accepted error."""
    accepted = [
        (number, point)
        for number, point in sorted(solution.reconstruction.points3D.items())
        if point.error <= solution.accepted and np.isfinite(point.xyz).all()
    ]
    places = np.array([point.xyz for _, point in accepted], np.float64).reshape(-1, 3)
    errors = np.array([point.error for _, point in accepted], np.float64)
    return places, _colors(flight, solution, [point for _, point in accepted]), errors


def _colors(flight: Flight, solution: Solution, points: list[object]) -> UInt8Array:
    """Return the mean colour of each point over the photographs that see it."""
    sightings: Sightings = {}
    for row, point in enumerate(points):
        for element in point.track.elements:  # type: ignore[attr-defined]
            rows, pixels = sightings.setdefault(element.image_id - 1, ([], []))
            rows.append(row)
            x, y = solution.reconstruction.image(element.image_id).point2D(element.point2D_idx).xy
            pixels.append((x, y))
    total, count = np.zeros((len(points), 3)), np.zeros((len(points), 1))
    for index, (rows, pixels) in sorted(sightings.items()):
        with Image.open(flight.records[index].path) as picture:
            colors = np.asarray(picture.convert("RGB"))
        columns, lines = np.floor(np.array(pixels)).astype(int).T
        inside = np.clip(lines, 0, colors.shape[0] - 1), np.clip(columns, 0, colors.shape[1] - 1)
        np.add.at(total, rows, colors[inside])
        np.add.at(count, rows, 1)
    return np.round(total / np.maximum(count, 1)).astype(np.uint8)
