"""Collapse of a pile of aluminium bars against its measured profile (Bui et al. 2008, "Lagrangian meshfree particles
method (SPH) for large deformation and failure flows of geomaterial using elastic-plastic soil constitutive model").
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import Boundary, Sand, Simulation, SimulationProblem, Wall
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.collapse import Deposit
from slideframe.verification.rig import Rig
from slideframe.verification.scenes import slice_of

LENGTH, HEIGHT = 0.2, 0.1
CELLS = 16
FRONT, FRONT_THICKNESS = 0.442, 0.0015
FRONT_TOLERANCE, SURFACE_TOLERANCE = 0.07, 0.05
SOURCE = "Bui et al. 2008, measured"


def deposit(rig: Rig, match: Literal["plane_strain", "triaxial_compression"]) -> Deposit:
    """Return the deposit after 1 s: rough floor, smooth wall on the left."""
    problem = SimulationProblem(
        material=Sand(
            friction_angle=19.8, friction_match=match, density=2650, youngs_modulus=0.84e6, poisson_ratio=0.3
        ),
        boundary=Boundary(floor=Wall(kind="stick")),
        simulation=Simulation(duration=1.0, frame_rate=2.0, grid_spacing=HEIGHT / CELLS),
    )
    return Deposit.of(rig.run(slice_of((0, 0), (LENGTH, HEIGHT), HEIGHT / CELLS, 0.6), problem))


def measured_surface() -> Float64Array | None:
    """Return the measured surface (point, 2), x and z in m, or nothing where the shared data isn't at hand.

    The folder is named by the environment variable SLIDEFRAME_SHARED, by default `../shared`.
    """
    path = Path(os.environ.get("SLIDEFRAME_SHARED", "../shared")) / "data/benchmarks/bui2008_aluminium_bars/surface.csv"
    if not path.is_file():
        return None
    surface: Float64Array = np.loadtxt(path, delimiter=",")
    return surface


def surface_error(deposit: Deposit, surface: Float64Array) -> float:
    """Return the root mean square of the thickness error at the measured points, as a share of the height at t = 0."""
    error = np.interp(surface[:, 0], deposit.middles, deposit.thickness) - surface[:, 1]
    return float(np.sqrt(np.mean(error**2))) / HEIGHT


def aluminium_bars(rig: Rig) -> Iterator[Line]:
    """Front and, where the measured points are at hand, surface."""
    good = deposit(rig, "plane_strain")
    front = good.front(FRONT_THICKNESS)
    yield Line("aluminium bars: front", "m", FRONT, front, FRONT_TOLERANCE * FRONT, SOURCE)
    surface = measured_surface()
    if surface is not None:
        error = surface_error(good, surface)
        yield Line("aluminium bars: surface, RMS to height", "", 0.0, error, SURFACE_TOLERANCE, SOURCE)


def wrong_cone(rig: Rig) -> Iterator[Line]:
    """The cone that is right in triaxial compression makes 19.8 degrees act as 26 in plane strain."""
    front = deposit(rig, "triaxial_compression").front(FRONT_THICKNESS)
    missed = float(abs(front - FRONT) > FRONT_TOLERANCE * FRONT)
    name = "control: the triaxial cone misses the bars' front"
    yield Line(name, "", 1.0, missed, 0.0, "the check can fail", note=f"front {front:.3f} m")


CASES = (
    Case("aluminium bars", aluminium_bars),
    Case("aluminium bars with the cone of triaxial compression", wrong_cone),
)
