"""The solvers that the card is checked on; a problem is solved once for all tests."""

import pytest

from slideframe.reference.solver import ReferenceSolver
from slideframe.verification.rig import Rig
from slideframe_mpm_taichi.solver import TaichiSolver
from slideframe_mpm_warp.solver import WarpSolver

SOLVERS = (ReferenceSolver(), WarpSolver(), TaichiSolver())


@pytest.fixture(scope="session", params=SOLVERS, ids=lambda solver: solver.name)
def rig(request):
    return Rig(request.param)
