"""Photographs that only measure: how far training has come, when it has settled, and what it reached."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from slideframe.stages import Context
from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.evaluation import Likeness, likeness
from slideframe_gs_torch.views import TrainingView

if TYPE_CHECKING:
    from slideframe_gs_torch.reconstructor import TorchSplats

# Measured that often, in shares of the iterations, from the time when photographs are shown in full.
MEASURE_SHARE, FIRST_SHARE = 0.05, 0.4
# Settled when nothing is gained over this share, and not while steps are still so long that the likeness wavers.
SETTLE_SHARE, LEAST_SHARE = 0.1, 0.85


class HeldOut:
    """The views that training doesn't see."""

    def __init__(
        self, options: "TorchSplats", views: Sequence[TrainingView], background: tuple[float, float, float]
    ) -> None:
        """Take the views; there may be none."""
        self._options, self._views, self._background = options, views, background

    def settled(self, state: State) -> bool:
        """Measure where that is due, and tell whether more iterations would gain little."""
        iterations = self._options.iterations
        every = max(1, round(MEASURE_SHARE * iterations))
        if not self._views or state.iteration < FIRST_SHARE * iterations or state.iteration % every:
            return False
        splats = state.parameters.export(self._options.anisotropy_limit)
        psnr = float(np.mean([likeness(splats, view, self._background).psnr for view in self._views]))
        state.curve.append((state.iteration, state.seconds, psnr))
        before = [old for iteration, _, old in state.curve if iteration <= state.iteration - SETTLE_SHARE * iterations]
        late = state.iteration >= LEAST_SHARE * iterations
        best = max(old for _, _, old in state.curve)
        return late and bool(before) and best - max(before) < self._options.settle_gain


def report_held_out(found: dict[str, Likeness], context: Context) -> None:
    """Report PSNR and SSIM of every photograph held out, by its name."""
    if not found:
        context.warn("no photograph was held out, so the likeness of the splats is not measured")
        return
    context.figure("held_out_psnr_db", float(np.mean([one.psnr for one in found.values()])))
    context.figure("held_out_ssim", float(np.mean([one.ssim for one in found.values()])))
    context.figure("held_out_psnr_db_exposure_fitted", float(np.mean([one.fitted_psnr for one in found.values()])))
    context.figure("held_out_psnr_db_by_photograph", {name: one.psnr for name, one in found.items()})
    context.figure("held_out_ssim_by_photograph", {name: one.ssim for name, one in found.items()})
