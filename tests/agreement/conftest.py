"""The solvers whose answers are compared, and their runs."""

import pytest

from slideframe.reference.solver import ReferenceSolver
from slideframe.testing.evidence import fresh_context
from slideframe_mpm_taichi.solver import TaichiSolver
from slideframe_mpm_warp.solver import WarpSolver

SOLVERS = {"reference": ReferenceSolver(), "mpm_warp": WarpSolver(), "mpm_taichi": TaichiSolver()}
_results = {}


@pytest.fixture(params=["mpm_warp", "mpm_taichi"])
def backend(request):
    return request.param


@pytest.fixture(params=list(SOLVERS))
def solver(request):
    return request.param


@pytest.fixture
def motion(tmp_path):
    """Solve a problem by name of solver, once for all tests."""

    def solve(name, filling, problem):
        key = name, problem.model_dump_json(), filling.particle_positions.tobytes()
        if key not in _results:
            _results[key] = list(SOLVERS[name].solve(filling, problem, fresh_context(tmp_path, f"{len(_results)}")))
        return _results[key]

    return solve
