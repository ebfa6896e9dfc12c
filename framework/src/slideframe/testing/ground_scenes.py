"""A small hillside of splats, known by formula, and the soil below it."""

import hashlib
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from slideframe.arrays import Float64Array
from slideframe.problem import BoxRegion, FillingProblem, FlatBase
from slideframe.products import Camera, Filling, Georeference, ParticleFrame, Photograph, SplatCloud, Survey

REACH = 12.0
SPLAT_SPACING = 0.6
PARTICLE_SPACING = 0.5
HILLSIDE_BASE = 0.0


def hillside_height(x: Float64Array, y: Float64Array) -> Float64Array:
    """Return the height of the ground, m: a slope of 1 in 5 with low waves."""
    return 5 + 0.2 * x + 0.3 * np.sin(0.8 * x) * np.cos(0.7 * y)


HILLSIDE_BOX = BoxRegion(x_min=-6, x_max=6, y_min=-5, y_max=5, base=FlatBase(z_min=HILLSIDE_BASE))


def hillside_problem() -> FillingProblem:
    """Return a box within the hillside."""
    return FillingProblem(region=HILLSIDE_BOX, particle_spacing=PARTICLE_SPACING)


def hillside_splats() -> SplatCloud:
    """Return flat splats on the hillside, greener to the north."""
    axis = np.arange(-REACH, REACH + SPLAT_SPACING / 2, SPLAT_SPACING)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis, indexing="ij"))
    centers = np.stack([x, y, hillside_height(x, y)], axis=1)
    count = len(centers)
    color = np.stack([np.full(count, 0.5), 0.4 + 0.2 * (y / REACH), np.full(count, 0.3)], axis=1)
    return SplatCloud(
        centers=centers.astype(np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.tile(np.array([0.4, 0.4, 0.15], np.float32), (count, 1)),
        opacities=np.full(count, 0.9, np.float32),
        # colour = 0.5 + Y0 coefficient (Kerbl et al. 2023)
        harmonics=((color - 0.5) / 0.28209479)[:, None, :].astype(np.float32),
    )


@cache
def hillside_survey() -> Survey:
    """Return four cameras that look straight down on the hillside from 20 m above."""
    path = Path(tempfile.gettempdir()) / "slideframe-hillside.png"
    Image.new("RGB", (64, 64), (128, 120, 80)).save(path)
    photograph = Photograph(path=path, camera=0, sha256=hashlib.sha256(path.read_bytes()).hexdigest())
    looking_down = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
    places = np.array([[x, y, 25.0] for x in (-5.0, 5.0) for y in (-5.0, 5.0)])
    splats = hillside_splats()
    return Survey(
        georeference=Georeference(latitude=22.3, longitude=114.2, ellipsoidal_height=100),
        cameras=(Camera(width=64, height=64, focal_x=40, focal_y=40, principal_x=32, principal_y=32),),
        photographs=(photograph,) * len(places),
        world_from_camera=np.stack([np.column_stack([looking_down, place]) for place in places]),
        position_sigma=np.full((len(places), 3), 0.03),
        sparse_points=splats.centers,
        sparse_colors=np.full((len(splats), 3), 128, np.uint8),
        sparse_errors=np.full(len(splats), 0.5, np.float32),
    )


def hillside_filling() -> Filling:
    """Return soil particles in the box, one interior splat on each, and the box's own splats that follow them."""
    region, splats = HILLSIDE_BOX, hillside_splats()
    axes = [
        np.arange(low + PARTICLE_SPACING / 2, high, PARTICLE_SPACING)
        for low, high in ((region.x_min, region.x_max), (region.y_min, region.y_max), (HILLSIDE_BASE, 8.0))
    ]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    particles = lattice[lattice[:, 2] < hillside_height(lattice[:, 0], lattice[:, 1])].astype(np.float32)
    count = len(particles)
    return Filling(
        bounds=np.array(
            [[region.x_min, region.y_min, HILLSIDE_BASE], [region.x_max, region.y_max, particles[:, 2].max()]],
            np.float64,
        ),
        particle_positions=particles,
        particle_volumes=np.full(count, PARTICLE_SPACING**3, np.float32),
        interior=SplatCloud(
            centers=particles,
            rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
            scales=np.full((count, 3), 0.5 * PARTICLE_SPACING, np.float32),
            opacities=np.full(count, 0.95, np.float32),
            harmonics=np.zeros((count, 1, 3), np.float32),
        ),
        interior_particles=np.arange(count, dtype=np.int32),
        surface_particles=_followed(splats, particles),
        surface_vertices=splats.centers,
        surface_triangles=np.zeros((0, 3), np.int32),
        surface_support=np.zeros(len(splats), np.uint8),
    )


def _followed(splats: SplatCloud, particles: np.ndarray) -> np.ndarray:
    """Return the nearest particle of each splat above the box, -1 for the others."""
    distances = np.linalg.norm(splats.centers[:, None] - particles[None], axis=-1)
    nearest = distances.argmin(axis=1).astype(np.int32)
    return np.where(distances.min(axis=1) < 1.5 * PARTICLE_SPACING, nearest, np.int32(-1))


def moving_frames(filling: Filling, *, frame_count: int, step: float) -> list[ParticleFrame]:
    """Return frames 0.1 s apart in which the whole soil sinks westwards by `step` metres a frame."""
    count = len(filling.particle_positions)
    still = np.tile(np.eye(3, dtype=np.float32), (count, 1, 1))
    way = np.array([-step, 0, -step / 2], np.float32)
    return [
        ParticleFrame(
            time=0.1 * index,
            positions=filling.particle_positions + index * way,
            velocities=np.tile(10 * way, (count, 1)),
            deformation_gradients=still,
        )
        for index in range(frame_count)
    ]
