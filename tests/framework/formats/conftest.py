"""A survey that every format must hold."""

from pathlib import Path

import numpy as np
import pytest

from slideframe.formats.colmap import rotation_of
from slideframe.products import Camera, Georeference, Photograph, Survey

COUNT = 4


@pytest.fixture
def survey(tmp_path: Path) -> Survey:
    """Photographs in two folders, of three cameras, looking anywhere."""
    generator = np.random.default_rng(3)
    paths = [tmp_path / "photographs" / name for name in ("a.jpg", "b.jpg", "sub/a.jpg", "sub/c.jpg")]
    for number, path in enumerate(paths):
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_bytes(bytes([number]))
    rotations = [rotation_of(generator.normal(size=4)) for _ in paths]
    size = {
        "width": 1600,
        "height": 1300,
        "focal_x": 1973.09,
        "focal_y": 1955.65,
        "principal_x": 781,
        "principal_y": 638.6,
    }
    distortions = [(0.0,) * 5, (-0.1, 0.02, 1e-3, 2e-3, 0.0), (-0.42275, 0.369101, 0.0040638, 0.0040638, -0.264306)]
    digests = [
        "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d",
        "4bf5122f344554c53bde2ebb8cd2b7e3d1600ad631c385a5d7cce23c7785459a",
        "dbc1b4c900ffe48d575b5da5c638040125f65db0fe3e24494b76ea986457d986",
        "084fed08b978af4d7d196a7446a86b58009e636b611db16211b65a9aadff29c5",
    ]
    return Survey(
        georeference=Georeference(latitude=22.28, longitude=114.2, ellipsoidal_height=148.4),
        cameras=tuple(Camera(**size, distortion=distortion) for distortion in distortions),
        photographs=tuple(
            Photograph(path=path, camera=number % 3, sha256=digest)
            for number, (path, digest) in enumerate(zip(paths, digests, strict=True))
        ),
        world_from_camera=np.stack([np.column_stack([r, generator.normal(size=3) * 50]) for r in rotations]),
        position_sigma=np.zeros((COUNT, 3)),
        sparse_points=generator.normal(size=(20, 3)).astype(np.float32),
        sparse_colors=generator.integers(0, 256, (20, 3)).astype(np.uint8),
        sparse_errors=generator.random(20).astype(np.float32),
    )
