"""Small problems for solvers: a block of sand in a box."""

from collections.abc import Sequence

import numpy as np

from slideframe.arrays import Float32Array
from slideframe.problem import Boundary, Sand, Simulation, SimulationProblem, Vector, Wall
from slideframe.products import Filling
from slideframe.verification.scenes import filling, lattice

# Soft enough for large substeps, stiff enough to settle by less than a percent.
YOUNGS_MODULUS = 1e6
# Plan of the box that the blocks stand in, m.
SIZE = (4.0, 1.0)
GRAVITY = (0.0, 0.0, -9.81)


def sand_problem(
    *,
    spacing: float = 0.25,
    duration: float = 0.2,
    frame_rate: float = 10.0,
    gravity: Vector = GRAVITY,
    friction_angle: float = 30.0,
    poisson_ratio: float = 0.3,
    youngs_modulus: float = YOUNGS_MODULUS,
    sides: Wall | None = None,
    floor: Wall | None = None,
    precision: str = "float32",
    time_step: str = "fixed",
) -> SimulationProblem:
    """Return sand of 2000 kg/m3."""
    return SimulationProblem(
        material=Sand(
            friction_angle=friction_angle,
            density=2000,
            youngs_modulus=youngs_modulus,
            poisson_ratio=poisson_ratio,
        ),
        boundary=Boundary(sides=sides or Wall(), floor=floor or Wall()),
        simulation=Simulation.model_validate(
            {
                "duration": duration,
                "frame_rate": frame_rate,
                "grid_spacing": spacing,
                "gravity": gravity,
                "precision": precision,
                "time_step": time_step,
            }
        ),
    )


def block_filling(
    low: Sequence[float], high: Sequence[float], *, size: tuple[float, float] = SIZE, particle_spacing: float = 0.125
) -> Filling:
    """Return a lattice of particles that fills the block from `low` to `high`, m, in a box of that plan `size`."""
    counts = [round((end - start) / particle_spacing) for start, end in zip(low, high, strict=True)]
    positions, volume = lattice(low, high, counts)
    return filling_of(positions.astype(np.float32), volume, size=size)


def filling_of(positions: Float32Array, particle_volume: float, *, size: tuple[float, float] = SIZE) -> Filling:
    """Return particles (n, 3), m, without splats or surface, in a box of plan `size` as high as they stand."""
    top = max(float(positions[:, 2].max(initial=0.0)), 1e-3)
    return filling(positions, particle_volume, ((0, 0, 0), (*size, top)))


def on_level_ground(filling: Filling, height: float) -> Filling:
    """Return the filling with a level terrain at `height`, m, that reaches beyond its bounds."""
    (west, south, _), (east, north, _) = filling.bounds
    corners = [(west - 1, south - 1), (east + 1, south - 1), (east + 1, north + 1), (west - 1, north + 1)]
    return filling.model_copy(
        update={
            "terrain_vertices": np.array([(*corner, height) for corner in corners], np.float32),
            "terrain_triangles": np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        }
    )
