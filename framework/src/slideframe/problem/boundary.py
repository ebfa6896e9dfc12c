"""What the mass meets."""

import math
from typing import Literal

from pydantic import Field, model_validator

from slideframe.problem.base import ProblemModel


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
