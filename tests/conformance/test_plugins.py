"""The conformance kit on the first-party plugins; they have no other contract tests."""

from slideframe.testing import parametrize_with_checks
from slideframe_fill_poisson.filler import PoissonFiller
from slideframe_gs_torch.reconstructor import TorchSplats
from slideframe_mpm_taichi.solver import TaichiSolver
from slideframe_mpm_warp.solver import WarpSolver
from slideframe_pose_rtk.source import RtkPoses
from slideframe_render_gs.renderer import SplatRenderer


@parametrize_with_checks(
    RtkPoses(),
    # a minute's training in miniature: enough to resemble the photographs, far from finished
    TorchSplats(iterations=60, image_width=160, splat_budget=12_000),
    PoissonFiller(),
    WarpSolver(),
    TaichiSolver(),
    SplatRenderer(),
)
def test_conformance(check):
    check()
