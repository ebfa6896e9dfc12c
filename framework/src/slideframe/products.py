"""The five products that pass between the stages.

All coordinates are metres in one local east-north-up frame (z up) whose origin is the survey's
georeference. Camera axes are x right, y down, z forward; pixel (0.5, 0.5) is the centre of the
upper-left pixel, as in COLMAP. Quaternions are (w, x, y, z), of unit length.
"""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from slideframe.arrays import Array, Float32Array, Float64Array, Int32Array, Product, UInt8Array

Triple = tuple[float, float, float]
PositionFix = Literal["fixed", "float", "single", "none"]
PictureFault = Literal["blurred", "covered"]
PoseOrigin = Literal["adjusted", "metadata", "imported"]


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Georeference(_Record):
    """The origin of the local east-north-up frame on the WGS84 ellipsoid (EPSG:4979)."""

    latitude: float = Field(ge=-90, le=90, description="degrees north")
    longitude: float = Field(ge=-180, le=180, description="degrees east")
    ellipsoidal_height: float = Field(description="metres above the WGS84 ellipsoid")


class Camera(_Record):
    """A pinhole with the distortion (k1, k2, p1, p2, k3) of OpenCV's model; lengths in pixels."""

    width: int = Field(gt=0)
    height: int = Field(gt=0)
    focal_x: float = Field(gt=0)
    focal_y: float = Field(gt=0)
    principal_x: float
    principal_y: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)


class Photograph(_Record):
    """One image file, the camera that took it, the digest of its bytes, and what is known of its quality."""

    path: Path
    camera: int = Field(ge=0, description="index into Survey.cameras")
    sha256: str
    fix: PositionFix | None = Field(default=None, description="kind of the satellite position, where it is stated")
    stated_position: Triple | None = Field(default=None, description="the camera's place as its metadata has it, m")
    sharpness: float | None = Field(default=None, description="fine over coarse detail, see slideframe.quality")
    fault: PictureFault | None = Field(default=None, description="why its pixels are of little use")
    pose: PoseOrigin | None = Field(default=None, description="what its pose comes from, where that is known")
    mask: Path | None = Field(default=None, description="picture that is black where pixels are not to be used")
    mask_sha256: str = ""

    @property
    def name(self) -> str:
        """The file's name without its folder."""
        return self.path.name


class LeftOut(_Record):
    """A photograph that the survey does without, and why."""

    path: Path
    reason: str
    fix: PositionFix | None = None
    stated_position: Triple | None = Field(default=None, description="m")
    fault: PictureFault | None = None

    @property
    def name(self) -> str:
        """The file's name without its folder."""
        return self.path.name


class GroundPoint(_Record):
    """A surveyed point: control has shaped the survey, a check has only been compared with it."""

    name: str
    role: Literal["control", "check"]
    position: Triple = Field(description="as surveyed, m")
    residual: Triple | None = Field(default=None, description="as the photographs see it minus as surveyed, m")
    reprojection_error: float | None = Field(default=None, description="rms over its sightings, px")
    sightings: int = Field(default=0, ge=0, description="photographs that it was marked in and that have a pose")


class Survey(Product):
    """Georeferenced photographs, their cameras, and the sparse points they share.

    `left_out` and `ground_points` are for the survey's appraisal; later stages do without.
    """

    georeference: Georeference
    cameras: tuple[Camera, ...]
    photographs: tuple[Photograph, ...]
    world_from_camera: Annotated[Float64Array, Array(("photograph", 3, 4), "float64", "m")]
    position_sigma: Annotated[Float64Array, Array(("photograph", 3), "float64", "m")]
    sparse_points: Annotated[Float32Array, Array(("point", 3), "float32", "m")]
    sparse_colors: Annotated[UInt8Array, Array(("point", 3), "uint8", "sRGB")]
    sparse_errors: Annotated[Float32Array, Array(("point",), "float32", "px")]
    left_out: tuple[LeftOut, ...] = ()
    ground_points: tuple[GroundPoint, ...] = ()

    @model_validator(mode="after")
    def _photographs_fit(self) -> "Survey":
        if len(self.photographs) != len(self.world_from_camera):
            raise ValueError(f"{len(self.photographs)} photographs but {len(self.world_from_camera)} poses")
        if any(photograph.camera >= len(self.cameras) for photograph in self.photographs):
            raise ValueError("a photograph names a camera that is not in 'cameras'")
        return self

    def camera_of(self, index: int) -> Camera:
        """Return the camera that took photograph `index`."""
        return self.cameras[self.photographs[index].camera]


class SplatCloud(Product):
    """3D Gaussians. `scales` are standard deviations; `harmonics` are real spherical harmonics as in
    Kerbl et al. 2023 (colour = 0.5 + sum of basis times coefficient), with 1, 4, 9 or 16 per channel.
    """

    centers: Annotated[Float32Array, Array(("splat", 3), "float32", "m")]
    rotations: Annotated[Float32Array, Array(("splat", 4), "float32", "quaternion wxyz")]
    scales: Annotated[Float32Array, Array(("splat", 3), "float32", "m")]
    opacities: Annotated[Float32Array, Array(("splat",), "float32", "1")]
    harmonics: Annotated[Float32Array, Array(("splat", "coefficient", 3), "float32", "1")]

    @model_validator(mode="after")
    def _degree_known(self) -> "SplatCloud":
        if self.harmonics.shape[1] not in (1, 4, 9, 16):
            raise ValueError(f"harmonics must have 1, 4, 9 or 16 coefficients, not {self.harmonics.shape[1]}")
        return self

    def __len__(self) -> int:
        return len(self.centers)

    @classmethod
    def empty(cls) -> "SplatCloud":
        """Return a cloud without splats."""
        return cls(
            centers=np.zeros((0, 3), np.float32),
            rotations=np.zeros((0, 4), np.float32),
            scales=np.zeros((0, 3), np.float32),
            opacities=np.zeros(0, np.float32),
            harmonics=np.zeros((0, 1, 3), np.float32),
        )


class Filling(Product):
    """The soil volume under the splats: its surface, its particles and the splats that follow them.

    Particle `i` represents `particle_volumes[i]` of soil. `interior` holds the inferred splats, each
    riding on particle `interior_particles[k]`; `surface_particles[j]` is the particle that the
    reconstructed (observed) splat `j` follows, or -1 where the splat stays as scanned.
    `surface_support` says of each vertex 0 observed, 1 interpolated, 2 extrapolated.

    `bounds` are the lowest and the highest corner of the region's volume, where the walls of a simulated
    box stand. The terrain is the ground that remains once the soil is taken out, the base below it
    included, its triangles counter-clockwise seen from the air; `scar` are splats that stay on that base
    and show it once it is bare. A filler that knows neither leaves them empty.
    `particle_velocities` are those at t = 0; empty, as every filler leaves them, means at rest.
    """

    bounds: Annotated[Float64Array, Array((2, 3), "float64", "m")]

    particle_positions: Annotated[Float32Array, Array(("particle", 3), "float32", "m")]
    particle_volumes: Annotated[Float32Array, Array(("particle",), "float32", "m3")]
    interior: SplatCloud
    interior_particles: Annotated[Int32Array, Array(("interior_splat",), "int32", "index")]
    surface_particles: Annotated[Int32Array, Array(("surface_splat",), "int32", "index")]
    surface_vertices: Annotated[Float32Array, Array(("vertex", 3), "float32", "m")]
    surface_triangles: Annotated[Int32Array, Array(("triangle", 3), "int32", "index")]
    surface_support: Annotated[UInt8Array, Array(("vertex",), "uint8", "class")]
    particle_velocities: Annotated[Float32Array, Array(("moving_particle", 3), "float32", "m/s")] = Field(
        default_factory=lambda: np.zeros((0, 3), np.float32)
    )
    terrain_vertices: Annotated[Float32Array, Array(("terrain_vertex", 3), "float32", "m")] = Field(
        default_factory=lambda: np.zeros((0, 3), np.float32)
    )
    terrain_triangles: Annotated[Int32Array, Array(("terrain_triangle", 3), "int32", "index")] = Field(
        default_factory=lambda: np.zeros((0, 3), np.int32)
    )
    scar: SplatCloud = Field(default_factory=lambda: SplatCloud.empty())

    @model_validator(mode="after")
    def _carriers_exist(self) -> "Filling":
        if len(self.interior) != len(self.interior_particles):
            raise ValueError(f"{len(self.interior)} interior splats but {len(self.interior_particles)} carriers")
        particle_count = len(self.particle_positions)
        for name in ("interior_particles", "surface_particles"):
            carriers = getattr(self, name)
            if carriers.size and (carriers.max() >= particle_count or carriers.min() < -1):
                raise ValueError(f"{name} names a particle that does not exist (there are {particle_count})")
        return self

    @model_validator(mode="after")
    def _all_move_or_none(self) -> "Filling":
        if len(self.particle_velocities) not in (0, len(self.particle_positions)):
            raise ValueError(
                f"{len(self.particle_velocities)} particle_velocities for {len(self.particle_positions)} particles: "
                "give one for each, or none for a mass at rest"
            )
        return self

    def start_velocities(self) -> Float32Array:
        """Return the velocity of every particle at t = 0, (particle, 3), m/s."""
        return self.particle_velocities if len(self.particle_velocities) else np.zeros_like(self.particle_positions)

    @model_validator(mode="after")
    def _bounds_in_order(self) -> "Filling":
        if not (self.bounds[0] < self.bounds[1]).all():
            raise ValueError(f"bounds must be the lowest, then the highest corner, not {self.bounds.tolist()}")
        return self


class ParticleFrame(Product):
    """The state of every particle at one output time.

    `deformation_gradients` carry neighbourhoods from t = 0 to now, for the renderer. `escaped` counts
    the particles that reached the edge of the grid and were held there.
    The stresses are Cauchy's: their mean, tension positive, and the deviatoric stress q = sqrt(3 J2). The plastic
    strain is the norm of each step's plastic deviatoric strain, summed since t = 0. They are empty unless the
    problem asks for them.
    """

    time: float
    positions: Annotated[Float32Array, Array(("particle", 3), "float32", "m", compact="fixed")]
    velocities: Annotated[Float32Array, Array(("particle", 3), "float32", "m/s", compact="half")]
    deformation_gradients: Annotated[Float32Array, Array(("particle", 3, 3), "float32", "1", compact="half")]
    escaped: int = 0
    mean_stresses: Annotated[Float32Array, Array(("stressed_particle",), "float32", "Pa")] = Field(
        default_factory=lambda: np.zeros(0, np.float32)
    )
    deviatoric_stresses: Annotated[Float32Array, Array(("stressed_particle",), "float32", "Pa")] = Field(
        default_factory=lambda: np.zeros(0, np.float32)
    )
    plastic_strains: Annotated[Float32Array, Array(("stressed_particle",), "float32", "1", compact="half")] = Field(
        default_factory=lambda: np.zeros(0, np.float32)
    )


class Picture(Product):
    """One rendered image of the film, and the maps of it that were asked for; the others are empty.

    `depth` is along the view axis, the mean over what is seen of each pixel, 0 where nothing is. `alpha` is
    the share of light that the scene holds back. `normal` are unit vectors in the local frame, towards the
    camera, 0 where nothing is seen.
    """

    time: float
    pixels: Annotated[UInt8Array, Array(("row", "column", 3), "uint8", "sRGB")]
    depth: Annotated[Float32Array, Array(("depth_row", "depth_column"), "float32", "m")] = Field(
        default_factory=lambda: np.zeros((0, 0), np.float32)
    )
    alpha: Annotated[Float32Array, Array(("alpha_row", "alpha_column"), "float32", "1")] = Field(
        default_factory=lambda: np.zeros((0, 0), np.float32)
    )
    normal: Annotated[Float32Array, Array(("normal_row", "normal_column", 3), "float32", "1")] = Field(
        default_factory=lambda: np.zeros((0, 0, 3), np.float32)
    )

    @model_validator(mode="after")
    def _maps_fit(self) -> "Picture":
        for name in ("depth", "alpha", "normal"):
            shape = getattr(self, name).shape[:2]
            if shape not in ((0, 0), self.pixels.shape[:2]):
                raise ValueError(f"{name} has {shape} rows and columns, the picture {self.pixels.shape[:2]}")
        return self
