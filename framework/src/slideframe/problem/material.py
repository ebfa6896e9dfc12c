"""The laws of the soil: a closed union, told apart by `kind`. A further law is one class here and one function in
each solver's `kernels/materials.py`.
"""

import math
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, Tag, model_validator

from slideframe.problem.base import ProblemModel, kind_or

# The return mappings that every solver knows; a material names one of them and gives its constants.
LAWS = ("elastic", "drucker_prager", "mohr_coulomb")
Law = Literal["elastic", "drucker_prager", "mohr_coulomb"]

# Waves run through granite with 6 km/s and through diamond with 18: what is faster is a slip of the pen, and would take
# substeps without end.
FASTEST_WAVE = 20e3  # m/s

# Stands for no tension cut-off, in strain: no soil gets there, and float32 holds it.
NO_CUTOFF = 1e6


class LawConstants(NamedTuple):
    """What a return mapping needs to know of a material; strains are Hencky's, tension is positive.

    Attributes:
        shear_modulus: Lame's mu, Pa.
        lame_lambda: Pa.
        cone_slope: deviatoric strain that the cone allows per compressive volumetric strain;
            for Mohr-Coulomb that of the cone inscribed in its pyramid.
        dilation: volumetric plastic strain per deviatoric plastic strain.
        apex: volumetric strain at the tip of cone or pyramid.
        cutoff: largest volumetric strain (cone), or largest principal stress over 2 mu (pyramid).
        keeps_expansion: 1 where expansion without stress must be closed before compression meets resistance, else 0.
        sine_friction: sin phi.
        sine_dilatancy: sin psi.
        cohesion: 2 c cos(phi) / (2 mu).
    """

    shear_modulus: float
    lame_lambda: float
    cone_slope: float = 0.0
    dilation: float = 0.0
    apex: float = NO_CUTOFF
    cutoff: float = NO_CUTOFF
    keeps_expansion: float = 0.0
    sine_friction: float = 0.0
    sine_dilatancy: float = 0.0
    cohesion: float = 0.0


class ElasticSoil(ProblemModel):
    """What all materials share: mass, and isotropic elasticity between Hencky strain and Kirchhoff stress."""

    density: float = Field(gt=0, description="kg/m3, in place; soil has 1400 to 2300")
    youngs_modulus: float = Field(gt=0, description="Pa; soil has 1e6 (soft clay) to 2e8 (dense gravel)")
    poisson_ratio: float = Field(ge=0, lt=0.5, description="soil has 0.2 to 0.4")

    @model_validator(mode="after")
    def _waves_of_soil(self) -> Self:
        if self.pressure_wave_speed > FASTEST_WAVE:
            raise ValueError(
                f"pressure waves would run through this soil with {self.pressure_wave_speed / 1e3:,.0f} km/s, and "
                f"through granite with 6: write youngs_modulus in Pa (5e7 is usual) and density in kg/m3 (2000), "
                "and keep poisson_ratio below 0.49"
            )
        return self

    @property
    def shear_modulus(self) -> float:
        """Lame's mu = E / (2 (1 + nu)), Pa."""
        return self.youngs_modulus / (2 * (1 + self.poisson_ratio))

    @property
    def lame_lambda(self) -> float:
        """Lame's lambda = E nu / ((1 + nu)(1 - 2 nu)), Pa."""
        return self.youngs_modulus * self.poisson_ratio / ((1 + self.poisson_ratio) * (1 - 2 * self.poisson_ratio))

    @property
    def bulk_modulus(self) -> float:
        """K = lambda + 2 mu / 3, Pa."""
        return self.lame_lambda + 2 * self.shear_modulus / 3

    @property
    def pressure_wave_speed(self) -> float:
        """c_p = sqrt((lambda + 2 mu) / rho), m/s."""
        return math.sqrt((self.lame_lambda + 2 * self.shear_modulus) / self.density)

    @property
    def law(self) -> Law:
        """The return mapping that applies."""
        return "elastic"

    @property
    def constants(self) -> LawConstants:
        """What the return mapping needs to know."""
        return LawConstants(self.shear_modulus, self.lame_lambda)

    @property
    def earth_pressure_at_rest(self) -> float:
        """K0 of confined elastic compression, nu / (1 - nu)."""
        return self.poisson_ratio / (1 - self.poisson_ratio)

    def without_yield(self) -> "Elastic":
        """Return the same soil with its elasticity alone."""
        return Elastic(density=self.density, youngs_modulus=self.youngs_modulus, poisson_ratio=self.poisson_ratio)


class Elastic(ElasticSoil):
    """Hencky elasticity without yield: for waves, settlement and verification."""

    kind: Literal["elastic"] = "elastic"


FrictionMatch = Literal["triaxial_compression", "triaxial_extension", "plane_strain", "mohr_coulomb"]


class Strength(NamedTuple):
    """What a frictional soil has beside friction: cohesion c, Pa; dilatancy angle psi, degrees; tension cut-off, Pa."""

    cohesion: float = 0.0
    dilatancy_angle: float = 0.0
    tension_cutoff: float | None = None


class FrictionalSoil(ElasticSoil):
    """What sand and Drucker-Prager soil share."""

    friction_angle: float = Field(gt=0, lt=90, description="degrees; sand and gravel have 28 to 45")
    friction_match: FrictionMatch = Field(
        default="triaxial_compression",
        description="test in which the cone has the strength of Mohr-Coulomb; the paper uses triaxial compression; "
        "mohr_coulomb: no cone, Mohr-Coulomb's pyramid itself",
    )
    volume_correction: bool = Field(
        default=True, description="expansion without stress must be closed again before compression meets resistance"
    )

    @property
    def law(self) -> Law:
        """Mohr-Coulomb's pyramid, or a cone."""
        return "mohr_coulomb" if self.friction_match == "mohr_coulomb" else "drucker_prager"

    @property
    def earth_pressure_at_rest(self) -> float:
        """K0 = 1 - sin phi (Jaky 1944)."""
        return 1 - math.sin(math.radians(self.friction_angle))

    @property
    def strength(self) -> Strength:
        """Cohesion, dilatancy and tension cut-off."""
        return Strength()

    @property
    def constants(self) -> LawConstants:
        """The yield surface in terms of Hencky strain; see docs/physics.md."""
        cohesion, dilatancy_angle, tension_cutoff = self.strength
        friction, dilatancy = math.radians(self.friction_angle), math.radians(dilatancy_angle)
        mu, bulk = self.shear_modulus, self.bulk_modulus
        pyramid = self.law == "mohr_coulomb"
        tip = cohesion / math.tan(friction)
        cutoff = min(math.inf if tension_cutoff is None else tension_cutoff, tip) / bulk
        if pyramid:
            cutoff = NO_CUTOFF if tension_cutoff is None else tension_cutoff / (2 * mu)
        return LawConstants(
            shear_modulus=mu,
            lame_lambda=self.lame_lambda,
            cone_slope=3 * bulk / (2 * mu) * math.sqrt(2) * self.cone_friction,
            dilation=3 * math.sqrt(2) * _potential_slope(math.sin(dilatancy), self.friction_match),
            apex=tip / bulk,
            cutoff=cutoff,
            keeps_expansion=float(self.volume_correction),
            sine_friction=math.sin(friction),
            sine_dilatancy=math.sin(dilatancy),
            cohesion=2 * cohesion * math.cos(friction) / (2 * mu),
        )

    @property
    def cone_friction(self) -> float:
        """Slope a of the cone sqrt(J2) + a I1 - k = 0 (Klar's alpha is sqrt(2) a); for the pyramid the inscribed one.

        The plane-strain match is that of flow with the given dilatancy, a = s / (3 (sqrt(1 - 3 b^2) + s b)) with
        the potential's slope b, from Mohr's circle in the plane where the strain across it vanishes:
        sin(phi) / 3 for b = 0, tan(phi) / sqrt(9 + 12 tan^2(phi)) for associated flow.
        """
        sine = math.sin(math.radians(self.friction_angle))
        if self.friction_match == "plane_strain":
            slope = _potential_slope(math.sin(math.radians(self.strength.dilatancy_angle)), "plane_strain")
            return sine / (3 * (math.sqrt(1 - 3 * slope**2) + sine * slope))
        return _potential_slope(sine, self.friction_match)


def _potential_slope(sine: float, match: FrictionMatch) -> float:
    """Return b of the plastic potential sqrt(J2) + b I1 that dilates as Mohr-Coulomb's with sin(psi) does.

    In plane strain and for the pyramid's inscribed cone that is the associated match.
    """
    if match == "triaxial_compression":
        return 2 * sine / (math.sqrt(3) * (3 - sine))
    if match == "triaxial_extension":
        return 2 * sine / (math.sqrt(3) * (3 + sine))
    return sine / math.sqrt(9 + 3 * sine**2)


class Sand(FrictionalSoil):
    """Cohesionless Drucker-Prager soil with Hencky elasticity (Klar et al. 2016); the paper's material."""

    kind: Literal["sand"] = "sand"


class DruckerPrager(FrictionalSoil):
    """Frictional soil with cohesion, dilatancy and a tension cut-off."""

    kind: Literal["drucker_prager"] = "drucker_prager"
    friction_match: FrictionMatch = Field(
        default="mohr_coulomb",
        description="mohr_coulomb: its pyramid itself; else the test in which a cone has its strength",
    )
    cohesion: float = Field(default=0.0, ge=0, description="Pa")
    dilatancy_angle: float = Field(default=0.0, ge=0, lt=90, description="degrees, at most the friction angle")
    tension_cutoff: float | None = Field(
        default=None,
        ge=0,
        description="largest tension, Pa: of the mean stress for a cone, of any principal stress for mohr_coulomb; "
        "none: the tip of the yield surface, c cot(phi)",
    )

    @model_validator(mode="after")
    def _dilatancy_below_friction(self) -> "DruckerPrager":
        if self.dilatancy_angle > self.friction_angle:
            raise ValueError("dilatancy_angle must not exceed friction_angle: the soil would create energy")
        return self

    @property
    def strength(self) -> Strength:
        """Cohesion, dilatancy and tension cut-off."""
        return Strength(self.cohesion, self.dilatancy_angle, self.tension_cutoff)


Material = Annotated[
    Annotated[Sand, Tag("sand")] | Annotated[DruckerPrager, Tag("drucker_prager")] | Annotated[Elastic, Tag("elastic")],
    kind_or("sand"),
    Field(description="the law of the soil"),
]
