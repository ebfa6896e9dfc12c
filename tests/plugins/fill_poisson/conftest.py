"""Splats on bodies whose volume is known, and a survey that looks at them."""

from pathlib import Path

import numpy as np
import pytest

from slideframe.device import Device
from slideframe.problem import BoxRegion, FillingProblem
from slideframe.products import Camera, Georeference, Photograph, SplatCloud, Survey
from slideframe.stages import Context


@pytest.fixture
def context(tmp_path):
    return Context(device=Device(), scratch=tmp_path)


@pytest.fixture(scope="session")
def make_context(tmp_path_factory):
    """One fresh context after the other."""
    return lambda: Context(device=Device(), scratch=tmp_path_factory.mktemp("scratch"))


@pytest.fixture(scope="session")
def survey():
    """Eight cameras on a ring 30 m up and one straight above, all looking at the origin."""
    angle = np.arange(8) * np.pi / 4
    places = [*np.column_stack([25 * np.cos(angle), 25 * np.sin(angle), np.full(8, 30.0)]), np.array([0.0, 0.1, 45.0])]
    poses = np.stack([looking_at_origin(place) for place in places])
    return Survey(
        georeference=Georeference(latitude=22.0, longitude=114.0, ellipsoidal_height=0.0),
        cameras=(Camera(width=800, height=600, focal_x=600, focal_y=600, principal_x=400, principal_y=300),),
        photographs=tuple(Photograph(path=Path(f"{i}.jpg"), camera=0, sha256="0" * 64) for i in range(len(poses))),
        world_from_camera=poses,
        position_sigma=np.full((len(poses), 3), 0.02),
        sparse_points=np.zeros((0, 3), np.float32),
        sparse_colors=np.zeros((0, 3), np.uint8),
        sparse_errors=np.zeros(0, np.float32),
    )


def looking_at_origin(place):
    forward = -place / np.linalg.norm(place)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward, place])


@pytest.fixture(scope="session")
def make_splats():
    def make(centers, *, opacity=0.9, seed=0):
        count = len(centers)
        colors = np.random.default_rng(seed).normal(0, 1, (count, 4, 3))
        return SplatCloud(
            centers=np.asarray(centers, np.float32),
            rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
            scales=np.full((count, 3), 0.1, np.float32),
            opacities=np.broadcast_to(np.asarray(opacity, np.float32), count).copy(),
            harmonics=colors.astype(np.float32),
        )

    return make


@pytest.fixture(scope="session")
def scatter():
    """Strew points over a plan at about `spacing`, and lift them onto a height field."""

    def scatter(height, spacing=0.25, reach=10.0, seed=1):
        generator = np.random.default_rng(seed)
        axis = np.arange(-reach, reach, spacing)
        x, y = (grid.ravel() + generator.uniform(-0.3, 0.3, axis.size**2) * spacing for grid in np.meshgrid(axis, axis))
        return np.column_stack([x, y, height(x, y)])

    return scatter


@pytest.fixture(scope="session")
def box():
    def box(z_min=0.0, half=5.0, spacing=0.5):
        region = BoxRegion(x_min=-half, x_max=half, y_min=-half, y_max=half, z_min=z_min)
        return FillingProblem(region=region, particle_spacing=spacing)

    return box
