"""The bodies that the mass meets beside the ground."""

import numpy as np
import rerun as rr

from slideframe.contact import bodies_of
from slideframe.problem import Boundary
from slideframe.products import Georeference

COLOR = np.array([150, 155, 165])


def log_bodies(stream: rr.RecordingStream, boundary: Boundary, georeference: Georeference) -> None:
    """Log the boundary's meshes, each triangle shaded by how steep it is."""
    for index, body in enumerate(bodies_of(boundary, georeference)):
        shade = (0.5 + 0.5 * np.abs(body.mesh.face_normals[:, 2:])) * COLOR
        stream.log(
            f"boundary/{index}",
            rr.Mesh3D(
                vertex_positions=body.mesh.corners.reshape(-1, 3).astype(np.float32),
                triangle_indices=np.arange(3 * len(body.mesh.triangles)).reshape(-1, 3),
                vertex_colors=np.repeat(shade.astype(np.uint8), 3, axis=0),
            ),
            static=True,
        )
