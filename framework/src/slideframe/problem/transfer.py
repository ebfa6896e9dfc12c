"""How motion passes between particles and grid: what a particle takes from the grid, and what it keeps of its own."""

from typing import Annotated, Literal, NamedTuple

from pydantic import Field, Tag

from slideframe.problem.base import ProblemModel, Share, kind_or

# A particle whose elastic volumetric strain isn't below this bears no pressure, but for what rounding makes of none.
# (Fei et al. take -1e-3, which is the weight of some metres of stiff soil.)
LOOSE_STRAIN = -1e-6


class TransferConstants(NamedTuple):
    """A transfer as numbers, in the form of Fei et al. 2021, "Revisiting integration in the material point method".

    With V(v) the grid's velocity v at the particle, v0 before a substep's forces and v1 after them, the particle's
    excess is e = v_p - V(v0). Then v_p <- V(v1) + velocity_share e, and x_p <- x_p + dt (V(v1) + position_share e).

    Attributes:
        affine: 1 where the particle hands the grid a linear field of velocity (the matrix C of APIC), 0 where not.
        velocity_share: of the excess, that the velocity keeps.
        position_share: of the excess, that a particle without pressure moves by; 0 under pressure.
    """

    affine: float
    velocity_share: float
    position_share: float

    @property
    def is_plain(self) -> bool:
        """Whether this is APIC, for which a solver needs neither v0 nor the particle's own velocity."""
        return self == (1.0, 0.0, 0.0)


class AffineTransfer(ProblemModel):
    """APIC (Jiang et al. 2015): a velocity and its gradient from the grid; keeps angular momentum, no noise."""

    kind: Literal["apic"] = "apic"

    @property
    def constants(self) -> TransferConstants:
        """The transfer as numbers."""
        return TransferConstants(affine=1.0, velocity_share=0.0, position_share=0.0)


class BlendTransfer(ProblemModel):
    """PIC and FLIP (Zhu & Bridson 2005): a velocity from the grid, or the particle's own with the grid's change."""

    kind: Literal["pic_flip"] = "pic_flip"
    flip_share: Share = Field(default=0.99, description="0: PIC, which damps; 1: FLIP, which keeps all, noise included")

    @property
    def constants(self) -> TransferConstants:
        """The transfer as numbers."""
        return TransferConstants(affine=0.0, velocity_share=self.flip_share, position_share=0.0)


class SeparableTransfer(ProblemModel):
    """ASFLIP (Fei et al. 2021): APIC that keeps a share of its own velocity, by which loose particles part."""

    kind: Literal["asflip"] = "asflip"
    velocity_share: Share = Field(
        default=0.99, description="of a particle's excess over the grid, that it keeps; 0: APIC"
    )
    separation: Share = Field(
        default=1.0, description="share of that excess by which particles without pressure also move; 0: AFLIP"
    )

    @property
    def constants(self) -> TransferConstants:
        """The transfer as numbers."""
        return TransferConstants(1.0, self.velocity_share, self.velocity_share * self.separation)


Transfer = Annotated[
    Annotated[AffineTransfer, Tag("apic")]
    | Annotated[BlendTransfer, Tag("pic_flip")]
    | Annotated[SeparableTransfer, Tag("asflip")],
    kind_or("apic"),
    Field(description="how motion passes between particles and grid"),
]
