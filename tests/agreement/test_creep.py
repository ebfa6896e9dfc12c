"""Motion so slow that one substep is below the rounding of a float32 position."""

import numpy as np
import pytest

from slideframe.testing.solver_scenes import block_filling, sand_problem

# frames are float32: at 40 m a position is known to 2e-6 m, and the mean of 64 to less
TOLERANCE = 0.005


@pytest.mark.parametrize("solver", ["mpm_warp", "mpm_taichi"])
def test_creep_is_not_lost_far_from_the_grid_s_origin(motion, solver):
    """x = g t^2 / 2 of a block that floats 160 cells away and reaches 2 mm/s: 2 mm in two seconds."""
    block = block_filling((40.0, 0.5, 0.5), (40.5, 1.0, 1.0), size=(44.0, 1.5))
    # the paper's stiffness: the stiffer the soil, the shorter the steps that may be lost
    problem = sand_problem(gravity=(1e-3, 0.0, 0.0), duration=2.0, frame_rate=1.0, youngs_modulus=5e7)
    frames = motion(solver, block, problem)
    travelled = (frames[-1].positions.astype(np.float64) - frames[0].positions)[:, 0]
    assert travelled.mean() == pytest.approx(2e-3, rel=TOLERANCE)
