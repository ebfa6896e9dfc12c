"""Element tests without an element: the middle of a block whose particles all start with v = L (x - centre).

Such a block deforms homogeneously, F = 1 + L t, wherever the release wave from its free faces hasn't arrived yet,
and the middle doesn't know of it before half the edge over c_p. So a path of deformation can be prescribed through
the public interface, and the strength at its end is read from the frame's stress invariants.

Without dilatancy the mean stress is K times the volumetric strain, whatever yields: the strain is chosen for the
confining stress of a textbook test, and the deviatoric strain far beyond yield.
"""

import math
from collections.abc import Iterator
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import DruckerPrager, Simulation, SimulationProblem
from slideframe.verification import formulas
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.rig import Rig
from slideframe.verification.scenes import filling, lattice

YOUNGS_MODULUS = 5e7
POISSON_RATIO = 0.3
BULK_MODULUS = YOUNGS_MODULUS / (3 * (1 - 2 * POISSON_RATIO))
SHEAR_MODULUS = YOUNGS_MODULUS / (2 * (1 + POISSON_RATIO))
CELLS = 8
SPACING = 0.1
# of the time that a wave takes from a face to the middle: what the grid smears ahead of it stays away
WAITED = 0.6
# share of a cell in a substep: small, since plastic flow is integrated step by step
CFL = 0.1
# deviatoric strain at the end
SHEAR = 0.02
# of the stress: what the faces' release wave, smeared by the grid, does in the middle
TOLERANCE = 2e-3
# of the plastic strain, which that wave changes itself, in proportion to the stress that is released
STRAIN_TOLERANCE = 8e-3
Match = Literal["triaxial_compression", "triaxial_extension", "plane_strain", "mohr_coulomb"]


def soil(cohesion: float, friction_angle: float, match: Match) -> DruckerPrager:
    """Return a soil without dilatancy; cohesion in Pa."""
    return DruckerPrager(
        friction_angle=friction_angle,
        cohesion=cohesion,
        friction_match=match,
        density=2000,
        youngs_modulus=YOUNGS_MODULUS,
        poisson_ratio=POISSON_RATIO,
    )


class Element(NamedTuple):
    """The middle of the block at the end: pressure (compression positive), q = sqrt(3 J2), Pa, and plastic strain."""

    pressure: float
    deviatoric: float
    plastic_strain: float


def strained(rig: Rig, material: DruckerPrager, gradient: Float64Array) -> Element:
    """Return the middle once F = `gradient`."""
    edge = CELLS * SPACING
    middle = np.full(3, edge)
    # one particle in the middle of each cell is enough for a field that is linear
    positions, volume = lattice(list(middle - edge / 2), list(middle + edge / 2), (CELLS,) * 3)
    duration = WAITED * (edge / 2) / material.pressure_wave_speed
    velocities = (positions - middle) @ (gradient - np.eye(3)).T / duration
    start = filling(positions, volume, ([0.0] * 3, [2 * edge] * 3), particle_velocities=velocities.astype(np.float32))
    simulation = Simulation(
        duration=duration,
        frame_rate=1 / duration,
        grid_spacing=SPACING,
        gravity=(0, 0, 0),
        cfl=CFL,
        precision="float64",
        record_stress=True,
    )
    motion = rig.run(start, SimulationProblem(material=material, simulation=simulation))
    inner = np.abs(positions - middle).max(axis=1) < SPACING
    last = motion.frames[-1]
    fields = (-last.mean_stresses, last.deviatoric_stresses, last.plastic_strains)
    return Element(*(float(values[inner].mean(dtype=np.float64)) for values in fields))


def stretches(pressure: float, axial: float) -> Float64Array:
    """Return F of a triaxial test: the volumetric strain for a pressure, Pa, and the axial deviatoric strain."""
    volume = -pressure / BULK_MODULUS
    return np.diag(np.exp(np.array([-axial / 2, -axial / 2, axial]) + volume / 3))


def loaded(rig: Rig, material: DruckerPrager, pressure: float, axial: float) -> Element:
    """Return the end of a triaxial test, steered to a pressure as by a servo."""
    reached = strained(rig, material, stretches(pressure, axial)).pressure
    return strained(rig, material, stretches(2 * pressure - reached, axial))


def compression(cohesion: float, friction_angle: float, confinement: float, match: Match, rig: Rig) -> Iterator[Line]:
    """Triaxial compression; stresses in kPa."""
    expected = formulas.triaxial_strength(cohesion, friction_angle, confinement)
    pressure = confinement + expected / 3
    end = loaded(rig, soil(1e3 * cohesion, friction_angle, match), 1e3 * pressure, -SHEAR)
    name = f"triaxial compression, c {cohesion:g}, phi {friction_angle:g}, {match.replace('_', ' ')}: "
    yield Line(f"{name}q_f", "kPa", expected, 1e-3 * end.deviatoric, TOLERANCE * expected, "Mohr-Coulomb")
    # what of the deviatoric strain isn't elastic: Kirchhoff's q over sqrt(6) G
    change = math.exp(-1e3 * pressure / BULK_MODULUS)
    plastic = math.sqrt(1.5) * SHEAR - 1e3 * expected * change / (math.sqrt(6) * SHEAR_MODULUS)
    yield Line(
        f"{name}plastic strain",
        "",
        plastic,
        end.plastic_strain,
        STRAIN_TOLERANCE * plastic,
        "strain less q / (sqrt 6 G)",
    )


def extension(match: Match, rig: Rig) -> Iterator[Line]:
    """Triaxial extension of phi = 30 under 100 kPa of lateral stress."""
    expected = formulas.extension_strength(0, 30, 100)
    pressure = (200 + expected) / 3
    end = loaded(rig, soil(0, 30, match), 1e3 * pressure, SHEAR)
    got = 1e-3 * (end.pressure - 2 * end.deviatoric / 3)
    name = f"triaxial extension, phi 30, {match.replace('_', ' ')}: axial stress"
    yield Line(name, "kPa", expected, got, TOLERANCE * 100, "Mohr-Coulomb")


def simple_shear(friction_angle: float, rig: Rig) -> Iterator[Line]:
    """Shear in the x-z plane under a pressure of 100 kPa, with no strain across it."""
    narrowed = math.exp(-1e5 / BULK_MODULUS / 2)
    gradient = np.diag([narrowed, 1.0, narrowed])
    gradient[0, 2] = 4 * SHEAR
    end = strained(rig, soil(0, friction_angle, "plane_strain"), gradient)
    expected, got = math.sin(math.radians(friction_angle)), end.deviatoric / math.sqrt(3) / end.pressure
    name = f"simple shear, phi {friction_angle:g}, plane strain: tau / sigma_n"
    yield Line(name, "", expected, got, 0.01 * expected, "Davis 1968: sin phi")


TRIAXIAL = ((0.0, 30.0, 100.0), (5.0, 35.0, 50.0), (0.0, 22.0, 50.0))
CASES = (
    *(
        Case(
            f"triaxial compression of {c:g} kPa, {phi:g}, {match}",
            partial(compression, c, phi, confinement, match),
            fast=match == "mohr_coulomb" and phi == 35.0,
        )
        for c, phi, confinement in TRIAXIAL
        for match in ("triaxial_compression", "mohr_coulomb")
    ),
    Case("triaxial extension, triaxial_extension", partial(extension, "triaxial_extension")),
    Case("triaxial extension, mohr_coulomb", partial(extension, "mohr_coulomb"), fast=True),
    *(Case(f"simple shear of {phi:g}", partial(simple_shear, phi), fast=phi == 22.0) for phi in (22.0, 30.0, 35.0)),
)
