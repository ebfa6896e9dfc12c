"""A dam break: Ritter's similarity solution of shallow water, by a material that has next to no strength.

At the dam the depth stays at 4/9 of the height, and the front runs at 2 sqrt(g H), once the flow is as shallow as the
solution takes it to be.
"""

import math
from collections.abc import Iterator

import numpy as np

from slideframe.problem import DruckerPrager, Simulation, SimulationProblem
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.collapse import Deposit
from slideframe.verification.contact import GRAVITY
from slideframe.verification.rig import Rig
from slideframe.verification.scenes import slice_of

HEIGHT, LENGTH = 1.0, 5.0
CELLS = 12
# the wave that runs back into the reservoir hasn't reached its end, and the front not that of the box
DURATION, FRAMES = 1.2, 12
BOX = 14.0
# the front is where the flow is this thick, as a share of the height: it ends in a feather's edge
FRONT_THICKNESS = 0.02
SOURCE = "Ritter 1892"


def dam_break(rig: Rig) -> Iterator[Line]:
    """Depth at the dam at the end, and the speed of the front over the last third."""
    spacing = HEIGHT / CELLS
    problem = SimulationProblem(
        material=DruckerPrager(
            friction_angle=0.01, friction_match="plane_strain", density=1000, youngs_modulus=5e5, poisson_ratio=0.45
        ),
        simulation=Simulation(duration=DURATION, frame_rate=FRAMES / DURATION, grid_spacing=spacing),
    )
    motion = rig.run(slice_of((0, 0), (LENGTH, HEIGHT), spacing, BOX), problem)
    end = Deposit.of(motion)
    depth = float(np.interp(LENGTH, end.middles, end.thickness)) / HEIGHT
    yield Line("dam break: depth at the dam, to the height", "", 4 / 9, depth, 0.04, SOURCE)
    late = range(2 * FRAMES // 3, FRAMES + 1)
    fronts = [Deposit.of(motion, frame).front(FRONT_THICKNESS * HEIGHT) for frame in late]
    speed = float(np.polynomial.Polynomial.fit(motion.times[late.start :], fronts, 1).convert().coef[1])
    yield Line("dam break: speed of the front, to sqrt(g H)", "", 2.0, speed / math.sqrt(GRAVITY * HEIGHT), 0.1, SOURCE)


CASES = (Case("dam break", dam_break),)
