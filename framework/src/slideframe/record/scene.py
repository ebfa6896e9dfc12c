"""The scan and the volume: what doesn't move."""

from collections.abc import Mapping

import rerun as rr
from PIL import Image

from slideframe.arrays import Float64Array
from slideframe.photographs import load_photograph
from slideframe.products import Camera, SplatCloud, Survey
from slideframe.record.drawing import DRAWN_SPLATS, jpeg, log_picture, real_part_last, rgba, thinned

PHOTOGRAPH_WIDTH = 480
DRAWN_PHOTOGRAPHS = 120


def pinhole(
    camera: Camera, world_from_camera: Float64Array, image_plane_distance: float
) -> tuple[rr.Transform3D, rr.Pinhole]:
    """Return what tells the viewer of a camera and its pose (3, 4), the picture so many metres before it."""
    return (
        rr.Transform3D(translation=world_from_camera[:, 3], mat3x3=world_from_camera[:, :3]),
        rr.Pinhole(
            resolution=[camera.width, camera.height],
            focal_length=[camera.focal_x, camera.focal_y],
            principal_point=[camera.principal_x, camera.principal_y],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=image_plane_distance,
        ),
    )


def log_survey(stream: rr.RecordingStream, survey: Survey) -> None:
    """Log cameras with their photographs, and the sparse points."""
    stream.log("survey/points", rr.Points3D(survey.sparse_points, colors=survey.sparse_colors, radii=-1.5), static=True)
    for index in thinned(len(survey.photographs), DRAWN_PHOTOGRAPHS):
        pixels, camera, _ = load_photograph(survey, index, width=PHOTOGRAPH_WIDTH)
        entity = f"survey/cameras/{index:04d}_{survey.photographs[index].path.stem}"
        pose = survey.world_from_camera[index]
        stream.log(
            entity,
            *pinhole(camera, pose, image_plane_distance=4.0),
            rr.EncodedImage(contents=jpeg(pixels), media_type="image/jpeg"),
            static=True,
        )


def log_survey_maps(stream: rr.RecordingStream, maps: Mapping[str, Image.Image]) -> None:
    """Log the maps of the survey's quality, by name."""
    for name, picture in maps.items():
        log_picture(stream, f"survey/maps/{name}", picture)


def log_splats(stream: rr.RecordingStream, splats: SplatCloud) -> None:
    """Log the reconstruction as scanned."""
    drawn = thinned(len(splats), DRAWN_SPLATS)
    stream.log(
        "reconstruction/splats",
        rr.GaussianSplats3D(
            splats.centers[drawn],
            colors=rgba(splats.harmonics[drawn], splats.opacities[drawn]),
            spherical_harmonics_degree=0,
            scales=splats.scales[drawn],
            quaternions=real_part_last(splats.rotations[drawn]),
        ),
        static=True,
    )
