"""What the mass meets."""

import math
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from slideframe.arrays import Float64Array
from slideframe.problem.base import ProblemModel
from slideframe.problem.slip_surface import MapHeights
from slideframe.products import Filling

# What kernels are given in place of Coulomb's coefficient.
STICKS = -1.0
IS_OPEN = -2.0


class Wall(ProblemModel):
    """How one-sided contact with a surface acts: no penetration, free separation, and tangential friction."""

    kind: Literal["slip", "stick", "friction", "open"] = Field(
        default="slip",
        description="slip: no friction; stick: no motion at all; friction: Coulomb's law; "
        "open: nothing, and what passes is taken out and counted",
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

    @property
    def coefficient(self) -> float:
        """The same, or STICKS or IS_OPEN: all that a kernel must know of a wall."""
        return {"stick": STICKS, "open": IS_OPEN}.get(self.kind, self.friction)

    def settling(self) -> Self:
        """Return the wall while stress builds up: friction holds."""
        held = {"kind": "stick", "friction_angle": 0.0}
        return self.model_copy(update=held) if self.kind == "friction" else self


class ColliderMesh(MapHeights, Wall):
    """A body of triangles that the mass meets, from a PLY, OBJ, STL or OFF file: a wall, a barrier, a building."""

    path: Path = Field(description="the file; triangles, not points")
    surface: Literal["closed", "open"] = Field(
        default="closed",
        description="closed: a body that the triangles enclose; open: a sheet, such as a ground surface, solid behind "
        "the side from which its triangles turn counter-clockwise",
    )

    @model_validator(mode="after")
    def _acts(self) -> "ColliderMesh":
        if self.kind == "open":
            raise ValueError("a mesh of kind = 'open' would do nothing: leave it out, or use slip, stick or friction")
        return self


class Domain(ProblemModel):
    """Where the mass may go: the box of the grid, whose sides and floor are the walls."""

    extent: Literal["region", "terrain"] = Field(
        default="region", description="region: the walls stand at its bounds; terrain: where the scanned ground ends"
    )
    margin: float = Field(default=0.0, ge=0, description="room added on each of the four sides, m")
    x_min: float | None = Field(default=None, description="west side in place of the above, m")
    x_max: float | None = Field(default=None, description="east side, m")
    y_min: float | None = Field(default=None, description="south side, m")
    y_max: float | None = Field(default=None, description="north side, m")
    z_min: float | None = Field(default=None, description="floor, m")
    z_max: float | None = Field(default=None, description="top of the mass; a quarter more is kept as headroom, m")

    def bounds(self, filling: Filling) -> Float64Array:
        """Return the lowest and the highest corner (2, 3), m."""
        low, high = filling.bounds
        if self.extent == "terrain" and len(filling.terrain_vertices):
            low = np.minimum(low, filling.terrain_vertices.min(axis=0))
            high = np.append(np.maximum(high, filling.terrain_vertices.max(axis=0))[:2], high[2])
        room = np.array([self.margin, self.margin, 0.0])
        given = np.array([[self.x_min, self.y_min, self.z_min], [self.x_max, self.y_max, self.z_max]], dtype=np.float64)
        return np.where(np.isnan(given), np.array([low - room, high + room]), given)

    @model_validator(mode="after")
    def _sides_in_order(self) -> "Domain":
        for axis in "xyz":
            low, high = getattr(self, f"{axis}_min"), getattr(self, f"{axis}_max")
            if low is not None and high is not None and not low < high:
                raise ValueError(f"{axis}_min must be less than {axis}_max")
        return self


class Boundary(ProblemModel):
    """The walls of the domain's box, which is open above, the scanned ground in it, and further bodies."""

    sides: Wall = Wall()
    floor: Wall = Wall()
    terrain: Wall = Field(default=Wall(kind="open"), description="the ground that stays once the mass is gone")
    meshes: tuple[ColliderMesh, ...] = Field(default=(), description="further bodies that the mass meets, from files")
    domain: Domain = Domain()

    def settling(self) -> "Boundary":
        """Return the boundary while stress builds up: friction holds."""
        walls = {name: getattr(self, name).settling() for name in ("sides", "floor", "terrain")}
        return self.model_copy(update=walls | {"meshes": tuple(mesh.settling() for mesh in self.meshes)})
