"""The laws of the soil."""

import math
from typing import Annotated, Literal

from pydantic import Field

from slideframe.problem.base import ProblemModel


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
