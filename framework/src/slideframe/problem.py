"""The problem: what is simulated and seen, handed identically to every backend. SI units, angles in degrees."""

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from slideframe.arrays import Float32Array, Float64Array
from slideframe.products import Camera

Vector = tuple[float, float, float]
Share = Annotated[float, Field(ge=0, le=1)]


class ProblemModel(BaseModel):
    """Base of every problem model: immutable, no unknown keys, no infinities."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Site(ProblemModel):
    """The place and its photographs."""

    photographs: Path = Field(description="folder of JPEG photographs with GPS metadata, searched recursively")


class Region(ProblemModel):
    """The box that holds the moving mass; the ground surface closes it above."""

    x_min: float = Field(description="west side, m")
    x_max: float = Field(description="east side, m")
    y_min: float = Field(description="south side, m")
    y_max: float = Field(description="north side, m")
    z_min: float = Field(description="flat base, m")

    @model_validator(mode="after")
    def _sides_in_order(self) -> "Region":
        for low, high in (("x_min", "x_max"), ("y_min", "y_max")):
            if not getattr(self, low) < getattr(self, high):
                raise ValueError(f"{low} must be less than {high}")
        return self


class Sand(ProblemModel):
    """Cohesionless Drucker-Prager soil with Hencky elasticity (Klar et al. 2016)."""

    kind: Literal["sand"] = "sand"
    friction_angle: float = Field(gt=0, lt=90, description="degrees")
    density: float = Field(gt=0, description="kg/m3, in place")
    youngs_modulus: float = Field(gt=0, description="Pa")
    poisson_ratio: float = Field(ge=0, lt=0.5, description="0 <= nu < 0.5")
    friction_match: Literal["triaxial_compression", "triaxial_extension", "plane_strain"] = Field(
        default="triaxial_compression",
        description="test in which the cone has the strength of Mohr-Coulomb; the paper uses triaxial compression",
    )

    @property
    def shear_modulus(self) -> float:
        """Lame's mu = E / (2 (1 + nu)), Pa."""
        return self.youngs_modulus / (2 * (1 + self.poisson_ratio))

    @property
    def lame_lambda(self) -> float:
        """Lame's lambda = E nu / ((1 + nu)(1 - 2 nu)), Pa."""
        return self.youngs_modulus * self.poisson_ratio / ((1 + self.poisson_ratio) * (1 - 2 * self.poisson_ratio))

    @property
    def pressure_wave_speed(self) -> float:
        """c_p = sqrt((lambda + 2 mu) / rho), m/s."""
        return math.sqrt((self.lame_lambda + 2 * self.shear_modulus) / self.density)

    @property
    def friction_coefficient(self) -> float:
        """Klar's alpha = sqrt(2/3) M / 3, with the slope M of the matched cone."""
        sine = math.sin(math.radians(self.friction_angle))
        slope = {
            "triaxial_compression": 6 * sine / (3 - sine),
            "triaxial_extension": 6 * sine / (3 + sine),
            "plane_strain": math.sqrt(3) * sine,
        }[self.friction_match]
        return math.sqrt(2 / 3) * slope / 3


Material = Annotated[Sand, Field(description="the law of the soil")]


class Wall(ProblemModel):
    """How one-sided contact with a plane acts: no penetration, free separation, and tangential friction."""

    kind: Literal["slip", "stick", "friction"] = Field(
        default="slip", description="slip: none; stick: no motion at all; friction: Coulomb's law"
    )
    friction_angle: float = Field(default=0.0, ge=0, lt=90, description="degrees, for kind = 'friction' only")

    @model_validator(mode="after")
    def _angle_belongs(self) -> "Wall":
        if (self.kind == "friction") != (self.friction_angle > 0):
            raise ValueError("friction_angle must be above 0 for kind = 'friction', and absent for any other kind")
        return self

    @property
    def friction(self) -> float:
        """Coulomb coefficient mu = tan(friction_angle)."""
        return math.tan(math.radians(self.friction_angle))


class Boundary(ProblemModel):
    """The walls of the region's box; it is open above."""

    sides: Wall = Wall()
    floor: Wall = Wall()


class Simulation(ProblemModel):
    """Time, space and accuracy of the simulation."""

    duration: float = Field(gt=0, description="s")
    frame_rate: float = Field(default=25.0, gt=0, description="output frames per simulated second")
    grid_spacing: float = Field(gt=0, description="m")
    particles_per_cell: int = Field(default=8, ge=1, le=64)
    gravity: Vector = Field(default=(0.0, 0.0, -9.81), description="m/s2")
    cfl: float = Field(default=0.4, gt=0, lt=1, description="share of a cell that a wave may cross in one substep")
    precision: Literal["float32", "float64"] = "float32"

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


class View(ProblemModel):
    """The camera of the film, looking at the region."""

    width: int = Field(default=960, ge=16, le=7680, multiple_of=2, description="px")
    height: int = Field(default=540, ge=16, le=4320, multiple_of=2, description="px")
    azimuth: float = Field(default=180.0, description="compass direction from the region to the camera, degrees")
    elevation: float = Field(default=30.0, gt=-90, lt=90, description="degrees above the horizon")
    distance: float | None = Field(
        default=None, gt=0, description="m from the region's centre; none: the region fills the picture"
    )
    turn: float = Field(default=0.0, description="degrees of azimuth that the camera turns during the film")
    field_of_view: float = Field(default=50.0, gt=1, lt=150, description="horizontal, degrees")
    background: tuple[Share, Share, Share] = Field(default=(0.62, 0.74, 0.86), description="sRGB, 0 to 1")


class FillingProblem(ProblemModel):
    """What a volume filler is asked for."""

    region: Region
    particle_spacing: float = Field(gt=0, description="m")


class SimulationProblem(ProblemModel):
    """What a solver is asked for."""

    region: Region
    material: Material
    boundary: Boundary = Boundary()
    simulation: Simulation

    def grid(self, particle_positions: Float32Array) -> "Grid":
        """Place the grid for particles at t = 0."""
        return place_grid(self.region, self.simulation.grid_spacing, particle_positions)

    def time_step(self, grid: "Grid") -> tuple[float, int]:
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


class Grid(ProblemModel):
    """A uniform background grid. Node (i, j, k) stands at origin + spacing (i, j, k).

    The region's low walls lie on the nodes with index `padding`; its high walls on the first nodes at
    or beyond `x_max` and `y_max`, `high` in index; there is no wall above.
    """

    origin: Vector
    spacing: float
    shape: tuple[int, int, int]
    high: tuple[int, int]

    padding: int = 3

    @property
    def extent(self) -> Vector:
        """From wall to wall, and from the floor to the top of the grid, m."""
        across = [self.spacing * (high - self.padding) for high in self.high]
        return across[0], across[1], self.spacing * (self.shape[2] - 1 - self.padding)

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return math.prod(self.shape)


def place_grid(region: Region, spacing: float, particle_positions: Float32Array) -> Grid:
    """Cover the region from its base to a quarter of the mass's height above its top, with padding all around."""
    pad = Grid.model_fields["padding"].default
    top = float(np.max(particle_positions[:, 2]))
    headroom = max(4 * spacing, 0.25 * (top - region.z_min))
    # 1e-6 of a cell forgives the rounding of decimal input such as 40.0 / 0.1
    cells = [
        math.ceil(extent / spacing - 1e-6)
        for extent in (region.x_max - region.x_min, region.y_max - region.y_min, top + headroom - region.z_min)
    ]
    return Grid(
        origin=(region.x_min - pad * spacing, region.y_min - pad * spacing, region.z_min - pad * spacing),
        spacing=spacing,
        shape=(cells[0] + 2 * pad + 1, cells[1] + 2 * pad + 1, cells[2] + 2 * pad + 1),
        high=(cells[0] + pad, cells[1] + pad),
    )


class ViewProblem(ProblemModel):
    """What a renderer is asked for."""

    region: Region
    view: View

    def camera(self, share: float, bounds: Float32Array) -> tuple[Camera, Float64Array]:
        """Return the camera and its world_from_camera (3, 4) when `share` (0 to 1) of the film has passed.

        `bounds` (2, 3), m, are the lowest and highest corner of what to look at; its centre is the
        target, and without a given distance its bounding sphere just fits the picture.
        """
        view = self.view
        focal = view.width / (2 * math.tan(math.radians(view.field_of_view) / 2))
        camera = Camera(
            width=view.width,
            height=view.height,
            focal_x=focal,
            focal_y=focal,
            principal_x=view.width / 2,
            principal_y=view.height / 2,
        )
        target = np.asarray(bounds, np.float64).mean(axis=0)
        radius = float(np.linalg.norm(np.ptp(bounds, axis=0))) / 2
        half_angle = math.atan(min(view.width, view.height) / (2 * focal))
        distance = view.distance or radius / math.sin(half_angle)
        azimuth, elevation = math.radians(view.azimuth + view.turn * share), math.radians(view.elevation)
        outward = np.array(
            [math.sin(azimuth) * math.cos(elevation), math.cos(azimuth) * math.cos(elevation), math.sin(elevation)]
        )
        right = np.array([-math.cos(azimuth), math.sin(azimuth), 0.0])
        down = np.cross(-outward, right)
        return camera, np.column_stack([right, down, -outward, target + distance * outward])
