"""Layers of cohesionless sand on scanned ground: what `slopes` says of a floor, on a surface that no grid line follows.

Gravity is vertical, the ground a plane that holds the sand fast. The start is free of stress, so that the layer settles
first, and stands or flows then.
"""

import math
from collections.abc import Iterator

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.problem import Boundary, Simulation, SimulationProblem, Wall
from slideframe.verification import formulas
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.contact import GRAVITY
from slideframe.verification.rig import Rig
from slideframe.verification.scenes import filling, lattice
from slideframe.verification.slopes import FRAMES, HEIGHT, MARGIN, soil
from slideframe.verification.terrain import OPEN, axes

LENGTH = 40.0
SPACING = HEIGHT / 4
PHI = 30.0
# the ground's edge stays out of the layer's reach, m
RIM = 2.0


def speed(rig: Rig, angle: float, duration: float) -> tuple[Float64Array, Float64Array]:
    """Return times (frame,), s, and the speed (frame,), m/s, down the slope of the upper middle."""
    frame, width = axes(angle, 0.0), 2 * SPACING
    counts = (round(2 * LENGTH / SPACING), 2, round(2 * HEIGHT / SPACING))
    layer, volume = lattice((-LENGTH / 2, 0, 0), (LENGTH / 2, width, HEIGHT), counts)
    reach = LENGTH / 2 + RIM
    ground = np.array([[-reach, -RIM, 0], [reach, -RIM, 0], [reach, width + RIM, 0], [-reach, width + RIM, 0]]) @ frame
    positions = layer @ frame
    low = [positions[:, 0].min() - RIM / 2, 0.0, ground[:, 2].min() - RIM / 2]
    high = [positions[:, 0].max() + RIM / 2, width, positions[:, 2].max()]
    start = filling(
        positions,
        volume,
        (low, high),
        terrain_vertices=ground.astype(np.float32),
        terrain_triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
    )
    problem = SimulationProblem(
        material=soil(PHI),
        boundary=Boundary(floor=OPEN, terrain=Wall(kind="stick")),
        simulation=Simulation(duration=duration, frame_rate=FRAMES / duration, grid_spacing=SPACING),
    )
    motion = rig.run(start, problem)
    middle = (np.abs(layer[:, 0]) < HEIGHT) & (layer[:, 2] > HEIGHT / 2)
    return motion.times, (motion.velocities[:, middle] @ frame[0]).mean(axis=1)


def slopes_on_ground(rig: Rig) -> Iterator[Line]:
    """A little less steep than critical the layer comes to rest; a little steeper it shears with sin(phi)."""
    gentle, steep = (formulas.critical_slope(PHI) + margin for margin in (-MARGIN, MARGIN))
    times, speeds = speed(rig, gentle, 1.2)
    got = abs(float(speeds[-1])) / (GRAVITY * math.sin(math.radians(gentle)) * float(times[-1]))
    name = f"ground of {gentle:.1f} degrees, phi {PHI:g}: speed to free slide's"
    yield Line(name, "", 0.0, got, 0.01, "holds below atan(sin phi)")
    times, speeds = speed(rig, steep, 0.4)
    flowing = slice(FRAMES // 4, 3 * FRAMES // 4)
    slope = np.polynomial.Polynomial.fit(times[flowing], speeds[flowing], 1).convert().coef[1]
    tilt, expected = math.radians(steep), math.sin(math.radians(PHI))
    ratio = float((math.sin(tilt) - slope / GRAVITY) / math.cos(tilt))
    name = f"ground of {steep:.1f} degrees, phi {PHI:g}: tau / sigma_n"
    yield Line(name, "", expected, ratio, 0.03 * expected, "Davis 1968: sin phi")


CASES = (Case("slopes on ground", slopes_on_ground),)
