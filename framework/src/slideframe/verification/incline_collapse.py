"""Collapse of a block on an incline against another code: Matter (Blatny 2024, its test CollapseTest.DruckerPragerOne).

That code's cone is sqrt(J2) = tan(30) p, whatever it calls 30 degrees. In plane strain without dilatancy a cone of
slope a carries the shear stress of sin(phi) = 3 a, so that it acts as a friction angle of asin(tan 30) = 35.26 degrees.
It moves particles by a transfer that damps less than APIC, on cells of a fiftieth of the height; here the front is
extrapolated from two grids, whose error falls with the spacing. With 30 degrees it would end at 0.67 m.
"""

import math
from collections.abc import Iterator

from slideframe.problem import Boundary, Sand, Simulation, SimulationProblem, Wall
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.collapse import Deposit
from slideframe.verification.contact import tilted_gravity
from slideframe.verification.rig import Rig
from slideframe.verification.scenes import slice_of

LENGTH, HEIGHT = 0.20, 0.15
SLOPE = 10.0
FRONT = 0.56
# Matter's own test allows 0.011, on its own grid; the extrapolation adds its uncertainty
TOLERANCE = 0.05
CELLS = (12, 24)
# the farthest particle alone is an outlier; the deposit is this thick there, as a share of the height
FRONT_THICKNESS = 0.01
NOMINAL_ANGLE = 30.0
SOURCE = "Matter (Blatny 2024): sqrt(J2) = tan(30) p"


def plane_strain_angle(nominal: float) -> float:
    """Return the friction angle, degrees, as which sqrt(J2) = tan(nominal) p acts in plane strain."""
    return math.degrees(math.asin(math.tan(math.radians(nominal))))


def front(rig: Rig, friction_angle: float, cells: int) -> float:
    """Return where the deposit ends after 1.4 s, m, on cells of a `cells`-th of the height."""
    spacing = HEIGHT / cells
    problem = SimulationProblem(
        material=Sand(
            friction_angle=friction_angle,
            friction_match="plane_strain",
            density=1000,
            youngs_modulus=1e6,
            poisson_ratio=0.3,
        ),
        boundary=Boundary(floor=Wall(kind="stick")),
        simulation=Simulation(duration=1.4, frame_rate=5, grid_spacing=spacing, gravity=tilted_gravity(SLOPE)),
    )
    motion = rig.run(slice_of((0, 0), (LENGTH, HEIGHT), spacing, 1.0), problem)
    return Deposit.of(motion).front(FRONT_THICKNESS * HEIGHT)


def extrapolated(rig: Rig, friction_angle: float) -> float:
    """Return the front on cells without size, m, its error falling with the spacing."""
    coarse, fine = (front(rig, friction_angle, cells) for cells in CELLS)
    return 2 * fine - coarse


def collapse(rig: Rig) -> Iterator[Line]:
    """The block with the strength that the cone has, not the angle that it is called by."""
    got = extrapolated(rig, plane_strain_angle(NOMINAL_ANGLE))
    name = f"collapse on {SLOPE:g} degrees, phi 35.3: front, extrapolated"
    yield Line(name, "m", FRONT, got, TOLERANCE * FRONT, SOURCE)


CASES = (Case("collapse on an incline", collapse),)
