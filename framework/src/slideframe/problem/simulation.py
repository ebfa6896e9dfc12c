"""Time, space and accuracy, and what a solver is asked for."""

import math
from typing import Literal

from pydantic import Field, model_validator

from slideframe.problem.base import ProblemModel, Vector
from slideframe.problem.boundary import Boundary
from slideframe.problem.grid import Grid, place_grid
from slideframe.problem.material import Material
from slideframe.problem.transfer import AffineTransfer, Transfer
from slideframe.products import Filling, Georeference

# Centrifuges for models of slopes reach some 500 g.
STRONGEST_GRAVITY = 1e4  # m/s2


class Simulation(ProblemModel):
    """Time, space and accuracy of the simulation."""

    duration: float = Field(gt=0, description="simulated time, s")
    frame_rate: float = Field(default=25.0, gt=0, description="output frames per simulated second")
    grid_spacing: float = Field(gt=0, description="m")
    particles_per_cell: int = Field(default=8, ge=1, le=64)
    gravity: Vector = Field(default=(0.0, 0.0, -9.81), description="m/s2")
    cfl: float = Field(default=0.4, gt=0, lt=1, description="share of a cell that a wave may cross in one substep")
    time_step: Literal["adaptive", "fixed"] = Field(
        default="adaptive",
        description="adaptive: for the speed of the mass; fixed: for that of a fall across the whole domain",
    )
    transfer: Transfer = AffineTransfer()
    precision: Literal["float32", "float64"] = "float32"
    stored_frames: Literal["whole", "compact"] = Field(
        default="whole",
        description="compact: half the disk; positions to 1/131070 of the mass's extent, velocities and deformations "
        "to 1/2048 of themselves",
    )
    record_stress: bool = Field(
        default=False, description="whether frames carry every particle's stress invariants and plastic strain"
    )
    initial_stress: Literal["none", "k0", "ramp"] = Field(
        default="none",
        description="stress at t = 0; none: gravity acts at once; k0: the weight above, and earth_pressure times that "
        "across; ramp: gravity rises slowly on soil that doesn't yield, and a hold test is reported",
    )
    earth_pressure: float | None = Field(
        default=None,
        ge=0,
        description="coefficient K0 of initial_stress = 'k0'; none: 1 - sin(phi), nu / (1 - nu) without friction",
    )
    stop: Literal["duration", "rest"] = Field(
        default="duration", description="rest: end earlier once the kinetic energy falls below rest_share of its peak"
    )
    rest_share: float = Field(default=0.01, gt=0, lt=1, description="share of the peak that counts as rest")

    @model_validator(mode="after")
    def _earth_pressure_is_used(self) -> "Simulation":
        if self.earth_pressure is not None and self.initial_stress != "k0":
            raise ValueError("earth_pressure is for initial_stress = 'k0' only")
        return self

    @model_validator(mode="after")
    def _gravity_of_this_world(self) -> "Simulation":
        strength = math.hypot(*self.gravity)
        if not strength <= STRONGEST_GRAVITY:
            raise ValueError(
                f"gravity has {strength:g} m/s2, and the Earth's 9.81; at most {STRONGEST_GRAVITY:g} can be simulated"
            )
        return self

    @model_validator(mode="after")
    def _whole_frames(self) -> "Simulation":
        if self.frame_count < 2:
            raise ValueError("duration must hold at least one frame: raise duration or frame_rate")
        return self

    @property
    def frame_count(self) -> int:
        """Frames including the one at t = 0; the last is the whole frame nearest to `duration`."""
        return round(self.duration * self.frame_rate) + 1

    @property
    def particle_spacing(self) -> float:
        """Edge of the cube of soil that one particle stands for, m."""
        return float(self.grid_spacing / self.particles_per_cell ** (1 / 3))


# What a problem may ask of a solver beyond cones of friction between closed walls: see SimulationProblem.features.
FEATURES = frozenset(
    {
        "elastic", "drucker_prager", "mohr_coulomb", "open_walls", "terrain", "meshes", "initial_stress", "rest",
        "pic_flip", "asflip",
    }
)  # fmt: skip


class SimulationProblem(ProblemModel):
    """What a solver is asked for."""

    material: Material
    boundary: Boundary = Boundary()
    simulation: Simulation
    georeference: Georeference | None = Field(
        default=None, description="origin of the local frame, for meshes in a map's coordinates; none: not needed"
    )

    @property
    def needs_georeference(self) -> bool:
        """Whether a mesh has a map's coordinates."""
        return any(mesh.epsg is not None for mesh in self.boundary.meshes)

    def placed(self, georeference: Georeference) -> "SimulationProblem":
        """Return the problem with the origin of its frame."""
        return self.model_copy(update={"georeference": georeference})

    def grid(self, filling: Filling) -> Grid:
        """Place the grid around the domain."""
        return place_grid(self.boundary.domain.bounds(filling), self.simulation.grid_spacing)

    @property
    def features(self) -> frozenset[str]:
        """What a solver must know to solve this: the law of the soil, and those of FEATURES that are in use."""
        walls = {self.boundary.sides.kind, self.boundary.floor.kind}
        used = {
            "open_walls": "open" in walls,
            "terrain": self.boundary.terrain.kind != "open",
            "meshes": bool(self.boundary.meshes),
            "initial_stress": self.simulation.initial_stress != "none",
            "rest": self.simulation.stop == "rest",
            self.simulation.transfer.kind: self.simulation.transfer.kind != "apic",
        }
        return frozenset({self.material.law, *(name for name, needed in used.items() if needed)})

    def settling(self) -> "SimulationProblem":
        """Return the problem while stress builds up: soil that doesn't yield, held fast where there is friction."""
        return self.model_copy(update={"material": self.material.without_yield(), "boundary": self.boundary.settling()})

    def limits(self, grid: Grid) -> tuple[Vector, Vector]:
        """Return the lowest and the highest position that a particle may have, in cells from the grid's origin.

        Beyond it is taken out and counted: at open sides there, at all others where the grid ends. So below an open
        floor too, since the ground may lie on it, into which the mass presses by a part of a cell.
        """
        sides = self.boundary.sides.kind == "open"
        low = (grid.padding if sides else 1.0, grid.padding if sides else 1.0, 1.0)
        ends = [length - 2.0 for length in grid.shape]
        high = (grid.high[0] if sides else ends[0], grid.high[1] if sides else ends[1], ends[2])
        return low, high

    def time_step(self, grid: Grid) -> tuple[float, int]:
        """Return the substep in s and the whole number of substeps in a frame.

        dt = cfl dx / (c_p + v), where v = sqrt(2 sum |g_i| L_i) is the speed of a free fall from one corner
        of the grid, of extent L, to the opposite one: a bound known beforehand, so that every backend takes
        the same steps.
        The substep is shortened so that output times are met exactly.
        """
        simulation = self.simulation
        falls = zip(simulation.gravity, grid.extent, strict=True)
        fall_speed = math.sqrt(2 * sum(abs(gravity) * length for gravity, length in falls))
        longest = simulation.cfl * grid.spacing / (self.material.pressure_wave_speed + fall_speed)
        substeps = math.ceil(1 / (simulation.frame_rate * longest))
        return 1 / (simulation.frame_rate * substeps), substeps
