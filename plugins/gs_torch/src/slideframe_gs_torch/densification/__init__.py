"""Ways to have splats where the picture asks for them."""

from typing import Protocol

import torch
from torch import Tensor

from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.reconstructor import Densification


class Densifier(Protocol):
    """What training tells a way of densifying, and what that does to the state.

    Every random choice follows from the seed and the iteration, so that training that was cut off goes on to the
    same result.
    """

    def start(self, state: State) -> None:
        """Prepare the state before the first iteration."""

    def pressure(self) -> tuple[float, float]:
        """Return the weights in the loss of the mean opacity and of the mean scale, the latter per metre."""

    def observe(self, state: State, rows: Tensor, screen_gradients: Tensor, width: int) -> None:
        """Take note of the gradients (row, 2), per px, of those splats' centres in a picture of that width in px."""

    def after_step(self, state: State, center_rate: float) -> None:
        """Change the state after an iteration whose step of positions was `center_rate`, m."""


def densifier(
    kind: Densification, iterations: int, start_count: int, budget: int, extent: float, seed: int
) -> Densifier:
    """Return the way of that name for a training of so many iterations, up to `budget` splats."""
    if kind == "mcmc":
        from slideframe_gs_torch.densification.mcmc import MarkovChain

        return MarkovChain(iterations, budget, extent, seed)
    if kind == "clone_and_split":
        from slideframe_gs_torch.densification.clone_and_split import CloneAndSplit

        return CloneAndSplit(iterations, budget, extent, seed)
    from slideframe_gs_torch.densification.budgeted_splits import BudgetedSplits

    return BudgetedSplits(iterations, start_count, budget)


def random_numbers(seed: int, iteration: int) -> torch.Generator:
    """Return a generator that depends on nothing else."""
    return torch.Generator().manual_seed((seed << 32) + iteration)
