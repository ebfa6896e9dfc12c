"""The scan and the volume: what doesn't move."""

import io
from collections.abc import Mapping

import numpy as np
import rerun as rr
from PIL import Image

from slideframe.photographs import load_photograph
from slideframe.products import Filling, SplatCloud, Survey
from slideframe.record.drawing import DRAWN_SPLATS, jpeg, real_part_last, rgba, spacing_of, thinned

PHOTOGRAPH_WIDTH = 480
DRAWN_PHOTOGRAPHS = 120
OBSERVED_COLOR = (90, 170, 120)
INFERRED_COLOR = (200, 120, 60)
SUPPORT_COLORS = np.array([OBSERVED_COLOR, (230, 190, 60), INFERRED_COLOR], np.uint8)


def log_survey(stream: rr.RecordingStream, survey: Survey) -> None:
    """Log cameras with their photographs, and the sparse points."""
    stream.log("survey/points", rr.Points3D(survey.sparse_points, colors=survey.sparse_colors, radii=-1.5), static=True)
    for index in thinned(len(survey.photographs), DRAWN_PHOTOGRAPHS):
        pixels, camera, _ = load_photograph(survey, index, width=PHOTOGRAPH_WIDTH)
        entity = f"survey/cameras/{index:04d}_{survey.photographs[index].path.stem}"
        pose = survey.world_from_camera[index]
        stream.log(
            entity,
            rr.Transform3D(translation=pose[:, 3], mat3x3=pose[:, :3]),
            rr.Pinhole(
                resolution=[camera.width, camera.height],
                focal_length=[camera.focal_x, camera.focal_y],
                principal_point=[camera.principal_x, camera.principal_y],
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=4.0,
            ),
            rr.EncodedImage(contents=jpeg(pixels), media_type="image/jpeg"),
            static=True,
        )


def log_survey_maps(stream: rr.RecordingStream, maps: Mapping[str, Image.Image]) -> None:
    """Log the maps of the survey's quality, by name."""
    for name, picture in maps.items():
        buffer = io.BytesIO()
        picture.save(buffer, "PNG")
        stream.log(
            f"survey/maps/{name}", rr.EncodedImage(contents=buffer.getvalue(), media_type="image/png"), static=True
        )


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


def log_filling(stream: rr.RecordingStream, filling: Filling) -> None:
    """Log the surface, coloured by its support, and the inferred particles beside the observed ones."""
    stream.log(
        "volume/surface",
        rr.Mesh3D(
            vertex_positions=filling.surface_vertices,
            triangle_indices=filling.surface_triangles,
            vertex_colors=SUPPORT_COLORS[filling.surface_support],
        ),
        static=True,
    )
    drawn = thinned(len(filling.particle_positions), DRAWN_SPLATS)
    stream.log(
        "volume/inferred",
        rr.Points3D(filling.particle_positions[drawn], colors=INFERRED_COLOR, radii=0.3 * spacing_of(filling)),
        static=True,
    )
