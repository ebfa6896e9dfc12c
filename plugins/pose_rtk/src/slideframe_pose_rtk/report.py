"""The survey as a product, and the figures that say how good it is."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.products import LeftOut, Photograph, Survey
from slideframe.quality.pictures import PictureQuality
from slideframe.stages import Context
from slideframe_pose_rtk.features import PictureFile
from slideframe_pose_rtk.flight import Flight
from slideframe_pose_rtk.placing import gimbal_bias
from slideframe_pose_rtk.solution import Solution

FOCAL_LENGTH_DOUBT = 0.01  # of the focal length, for the statement of what it does to heights


def survey_of(
    flight: Flight,
    solution: Solution,
    files: Sequence[Path],
    pictures: Sequence[PictureFile],
    qualities: Sequence[PictureQuality | None],
) -> Survey:
    """Return the registered photographs in file order, the cameras they use, and the accepted points.

    `files` are all that were found; those without a pose are named with the reason. `qualities` has None for
    pictures that can't be decoded.
    """
    registered = sorted(solution.poses)
    used = sorted({solution.camera_of[index] for index in registered})
    return Survey(
        georeference=flight.georeference,
        cameras=tuple(solution.cameras[camera] for camera in used),
        photographs=tuple(
            _photograph(flight, solution, index, used.index(solution.camera_of[index]), pictures, qualities)
            for index in registered
        ),
        world_from_camera=np.array([solution.poses[index] for index in registered]),
        position_sigma=solution.sigma_scale * flight.position_sigma[registered],
        sparse_points=solution.points.places.astype(np.float32),
        sparse_colors=solution.points.colors,
        sparse_errors=solution.points.errors.astype(np.float32),
        left_out=_left_out(flight, solution, files, qualities),
        ground_points=solution.ground_points,
    )


def _photograph(
    flight: Flight,
    solution: Solution,
    index: int,
    camera: int,
    pictures: Sequence[PictureFile],
    qualities: Sequence[PictureQuality | None],
) -> Photograph:
    picture, quality = pictures[index], qualities[index]
    measured = flight.records[index].states_position
    return Photograph(
        path=picture.path,
        camera=camera,
        sha256=picture.sha256,
        fix=flight.records[index].fix if measured else None,
        stated_position=_triple(flight.positions[index]) if measured else None,
        pose="metadata" if index in solution.from_metadata else solution.origin,
        sharpness=quality.sharpness if quality else None,
        fault=quality.fault if quality else None,
        mask=picture.mask,
        mask_sha256=picture.mask_sha256,
    )


def _left_out(
    flight: Flight, solution: Solution, files: Sequence[Path], qualities: Sequence[PictureQuality | None]
) -> tuple[LeftOut, ...]:
    """Name the photographs without a pose: unusable by their metadata, or not registered."""
    by_path = {record.path: index for index, record in enumerate(flight.records)}
    found = []
    for path in files:
        index = by_path.get(path)
        if index is None:
            found.append(LeftOut(path=path, reason="its file or metadata can't be used, see the warnings"))
        elif index not in solution.poses:
            quality = qualities[index]
            found.append(
                LeftOut(
                    path=path,
                    reason=_reason(quality),
                    fix=flight.records[index].fix,
                    stated_position=_triple(flight.positions[index]),
                    fault=quality.fault if quality else None,
                )
            )
    return tuple(found)


def _reason(quality: PictureQuality | None) -> str:
    if quality is None:
        return "its pixels can't be decoded"
    if quality.fault == "covered":
        return "nothing to see: the lens may be covered"
    return "too blurred to register" if quality.fault else "too little of it is seen by others where it should be"


def _triple(place: Float64Array) -> tuple[float, float, float]:
    east, north, up = (float(value) for value in place)
    return east, north, up


def report(flight: Flight, solution: Solution, survey: Survey, context: Context) -> None:
    """State the figures of the survey."""
    registered = sorted(solution.poses)
    context.figure("photographs", len(flight))
    context.figure("flights", len(solution.sessions))
    context.figure("registered_photographs", len(registered) - len(solution.from_metadata))
    context.figure("sparse_points", len(survey.sparse_points))
    if survey.sparse_errors.any():  # an imported model may not keep them
        context.figure("reprojection_error_px", float(np.mean(survey.sparse_errors)))
    context.figure("rtk_fixed_share", float(np.mean([flight.records[index].fix == "fixed" for index in registered])))
    if solution.origin != "metadata":
        _report_centres(flight, solution, survey, context)
        _report_gimbal(flight, solution, context)
    _report_scale(solution, survey, context)


def _report_centres(flight: Flight, solution: Solution, survey: Survey, context: Context) -> None:
    """State how far the camera centres moved from the metadata's positions, rms."""
    registered = sorted(solution.poses)
    measured = [
        row
        for row, index in enumerate(registered)
        if flight.records[index].states_position and index not in solution.from_metadata
    ]
    if not measured:
        return
    residual = (survey.world_from_camera[:, :, 3] - flight.positions[registered])[measured]
    for axis, value in zip(("east", "north", "up"), np.sqrt(np.mean(residual**2, axis=0)), strict=True):
        context.figure(f"centre_residual_{axis}_m", float(value))


def _report_gimbal(flight: Flight, solution: Solution, context: Context) -> None:
    """State how far the gimbal angles are off, by what is taken from them, see `placing.GimbalBias`."""
    adjusted = {index: pose for index, pose in solution.poses.items() if index not in solution.from_metadata}
    found = {session.name: gimbal_bias(flight, adjusted, session) for session in solution.sessions}
    biases = {name: bias for name, bias in found.items() if bias is not None}
    if biases:
        context.figure("gimbal_yaw_bias_deg", {name: bias.yaw for name, bias in biases.items()})
        for figure, errors in (
            ("gimbal_error_raw_deg", [bias.raw for bias in biases.values()]),
            ("gimbal_error_deg", [bias.unbiased for bias in biases.values()]),
            ("gimbal_error_without_mount_deg", [bias.remaining for bias in biases.values()]),
        ):
            context.figure(figure, float(np.median(np.concatenate(errors))))


def _report_scale(solution: Solution, survey: Survey, context: Context) -> None:
    """State pixel size on the ground, focal length, and what 1 % of it does to heights: dH = H df / f."""
    focal_length = survey.cameras[0].focal_x
    context.figure("focal_length_px", focal_length)
    context.figure("focal_length_rule", solution.focal_length_rule)
    context.figure("principal_point_rule", solution.principal_point_rule)
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
