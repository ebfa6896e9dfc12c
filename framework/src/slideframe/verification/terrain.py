"""Blocks on scanned ground and on bodies from files: Coulomb's law on a surface that no grid line follows.

The ground is a plane of two triangles, the body a slab below the same plane, tilted and turned against the grid;
gravity is vertical.
"""

import math
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import Boundary, ColliderMesh, Elastic, Simulation, SimulationProblem, Wall
from slideframe.products import Filling
from slideframe.verification import formulas
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.contact import FRAMES, GRAVITY, MU_22, SLIDES, floor_of
from slideframe.verification.rig import Motion, Rig
from slideframe.verification.scenes import filling, lattice

SPACING = 0.25
DURATION = 0.6
HEADINGS = (0.0, 20.0, 45.0, 90.0)
# the surface cuts cells, and the block settles into them while it slides
TOLERANCE = 2e-3
OPEN = Wall(kind="open")
SLAB = 1.5


def axes(slope: float, heading: float) -> Float64Array:
    """Return unit vectors (3, 3), as rows: down the slope, across it, and out of the ground."""
    a, b = math.radians(slope), math.radians(heading)
    downhill = np.array([math.cos(a) * math.cos(b), math.cos(a) * math.sin(b), -math.sin(a)])
    across = np.array([-math.sin(b), math.cos(b), 0.0])
    return np.stack([downhill, across, np.cross(downhill, across)])


def incline(slope: float, heading: float) -> tuple[Filling, Float64Array]:
    """Return an elastic block of 2 m x 1 m x 0.5 m on a plane of 8.5 m by 5 m, and the plane's corners (4, 3), m."""
    frame = axes(slope, heading)
    block, volume = lattice((-1.0, -0.5, 0.0), (1.0, 0.5, 0.5), (16, 8, 4))
    corners = np.array([[-2.5, -2.5, 0], [6, -2.5, 0], [6, 2.5, 0], [-2.5, 2.5, 0]]) @ frame
    low, high = corners.min(axis=0) - 0.5, corners.max(axis=0) + 1.5
    return filling(block @ frame, volume, (list(low), list(high))), corners


def sliding(boundary: Boundary, youngs_modulus: float) -> SimulationProblem:
    """Return a block's problem."""
    return SimulationProblem(
        material=Elastic(density=2000, youngs_modulus=youngs_modulus, poisson_ratio=0.3),
        boundary=boundary,
        simulation=Simulation(duration=DURATION, frame_rate=FRAMES / DURATION, grid_spacing=SPACING),
    )


def slide(rig: Rig, slope: float, heading: float, ground: Wall, youngs_modulus: float = 1e6) -> Motion:
    """Return the motion of a block on scanned ground."""
    start, corners = incline(slope, heading)
    ground_mesh = {
        "terrain_vertices": corners.astype(np.float32),
        "terrain_triangles": np.array([[0, 1, 2], [0, 2, 3]], np.int32),
    }
    boundary = Boundary(sides=OPEN, floor=OPEN, terrain=ground)
    return rig.run(start.model_copy(update=ground_mesh), sliding(boundary, youngs_modulus))


def slide_on_body(rig: Rig, slope: float, heading: float, ground: Wall) -> Motion:
    """Return the motion of a block on a slab from a file."""
    start, corners = incline(slope, heading)
    with tempfile.TemporaryDirectory(prefix="slideframe-verify-") as folder:
        path = Path(folder) / "slab.obj"
        path.write_text(slab(corners, axes(slope, heading)[2]), encoding="ascii")
        body = ColliderMesh(path=path, kind=ground.kind, friction_angle=ground.friction_angle)
        return rig.run(start, sliding(Boundary(sides=OPEN, floor=OPEN, meshes=(body,)), 1e6))


def slab(top: Float64Array, normal: Float64Array) -> str:
    """Return a closed body below four corners (4, 3), m, as an OBJ file's text."""
    corners = np.concatenate([top, top - SLAB * normal])
    around = [(a, b, b + 4, a + 4) for a, b in ((1, 0), (2, 1), (3, 2), (0, 3))]
    faces = [(0, 1, 2, 3), (7, 6, 5, 4), *around]
    lines = ["v {} {} {}".format(*corner) for corner in corners.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}\nf {a + 1} {c + 1} {d + 1}" for a, b, c, d in faces]
    return "\n".join(lines) + "\n"


def acceleration(motion: Motion, slope: float, heading: float, friction: float) -> float:
    """Return the mean acceleration down the slope, m/s2, with the bounce taken out as in `contact`."""
    velocity = motion.mean(motion.velocities) @ axes(slope, heading).T
    change = velocity[-1] - velocity[4]
    return float((change[0] + friction * change[2]) / (motion.times[-1] - motion.times[4]))


def coulomb_block(slope: float, heading: float, friction: float, rig: Rig) -> Iterator[Line]:
    """Slide down a slope that faces `heading`, degrees from the grid's x axis."""
    expected = formulas.incline_acceleration(slope, friction)
    got = acceleration(slide(rig, slope, heading, floor_of(friction)), slope, heading, friction)
    name = f"block on ground of {slope:g} degrees to {heading:g}, mu = {friction:.3f}: acceleration"
    yield Line(name, "m/s2", expected, got, TOLERANCE * expected, "Coulomb")


def block_on_body(slope: float, heading: float, friction: float, rig: Rig) -> Iterator[Line]:
    """The same against a body from a file."""
    expected = formulas.incline_acceleration(slope, friction)
    got = acceleration(slide_on_body(rig, slope, heading, floor_of(friction)), slope, heading, friction)
    name = f"block on a mesh of {slope:g} degrees to {heading:g}, mu = {friction:.3f}: acceleration"
    yield Line(name, "m/s2", expected, got, TOLERANCE * expected, "Coulomb")


def sticking_block(rig: Rig) -> Iterator[Line]:
    """20 degrees are less than the 22 of the ground; what the bounce lets slip is the tolerance."""
    motion = slide(rig, 20.0, 20.0, floor_of(MU_22), youngs_modulus=1e7)
    free = 0.5 * GRAVITY * math.sin(math.radians(20.0)) * motion.times[-1] ** 2
    place = motion.mean(motion.positions)
    slipped = float((place[-1] - place[0]) @ axes(20.0, 20.0)[0])
    yield Line("block on ground of 20 degrees to 20, mu = tan 22: slip", "", 0.0, slipped / free, 0.01, "Coulomb")


PLACED = (*((30.0, heading, 0.2) for heading in HEADINGS), *((slope, 0.0, friction) for slope, friction in SLIDES[1:]))
CASES = (
    *(
        Case(
            f"block on ground of {slope:g} to {heading:g}",
            partial(coulomb_block, slope, heading, friction),
            heading == 20,
        )
        for slope, heading, friction in PLACED
    ),
    Case("block that sticks on ground", sticking_block),
    Case("block on a mesh of 30 to 20", partial(block_on_body, 30.0, 20.0, 0.2)),
    Case("block on a mesh of 35 to 200", partial(block_on_body, 35.0, 200.0, MU_22)),
)
