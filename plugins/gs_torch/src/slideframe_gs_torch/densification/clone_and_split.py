"""The original densification (Kerbl et al. 2023), by absolute gradients (Ye et al. 2024, "AbsGS"), held to a budget.

Its schedule, made for 30 000 iterations, is stretched or pressed to the iterations at hand.
"""

import math

import torch
from torch import Tensor

from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.densification import random_numbers
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.parameters import Parameters, RawTensors
from slideframe_gs_torch.reference import rotation_matrices

# Mean |dL/d centre| in normalised device coordinates above which a splat is too little for what it shows.
GRADIENT_LIMIT = 0.0008
FIRST_SHARE, LAST_SHARE, ROUNDS = 500 / 30_000, 0.5, 145
FEWEST_BETWEEN_ROUNDS = 20
# Opacities are put down now and then, after which only what the picture asks for comes back.
RESET_SHARE, RESET_OPACITY = 0.1, 0.01
SMALL_SHARE, LARGE_SHARE = 0.01, 0.1  # of the scene's extent
SPLIT_SHRINK = 1.6
DEAD_OPACITY = 0.005


class CloneAndSplit:
    """Clones small and splits large splats of high mean gradient; takes away faint and huge ones."""

    def __init__(self, iterations: int, budget: int, extent: float, seed: int) -> None:
        """Fix the pace."""
        self._first, self._last = FIRST_SHARE * iterations, LAST_SHARE * iterations
        self._interval = max(FEWEST_BETWEEN_ROUNDS, round((self._last - self._first) / ROUNDS))
        self._reset = max(self._interval, round(RESET_SHARE * iterations))
        self._budget, self._extent, self._seed = budget, extent, seed

    def start(self, state: State) -> None:
        """Begin to sum gradients and to count in how many pictures each splat was seen."""
        state.score = torch.zeros(len(state.parameters), 2)

    def pressure(self) -> tuple[float, float]:
        """Add nothing."""
        return 0.0, 0.0

    def observe(self, state: State, rows: Tensor, screen_gradients: Tensor, width: int) -> None:
        """Add up gradients in normalised device coordinates, and pictures."""
        found = screen_gradients.norm(dim=1) * (width / 2)
        state.score[rows, 0] += found
        state.score[rows, 1] += found > 0

    def after_step(self, state: State, center_rate: float) -> None:
        """Clone, split and take away where a round is due; reset opacities where that is."""
        if not self._first <= state.iteration <= self._last:
            return
        if state.iteration % self._interval == 0:
            mean = state.score[:, 0] / state.score[:, 1].clamp_min(1)
            random = random_numbers(self._seed, state.iteration)
            state.parameters = self._grow(state.parameters, state.adam, mean, random)
            state.parameters = self._prune(state.parameters, state.adam)
            state.score = torch.zeros(len(state.parameters), 2)
        if state.iteration % self._reset == 0:
            state.parameters.raw["logits"].clamp_(max=math.log(RESET_OPACITY / (1 - RESET_OPACITY)))

    def _grow(self, parameters: Parameters, adam: Adam, mean: Tensor, random: torch.Generator) -> Parameters:
        """Double the splats of the highest gradients, as far as the budget goes."""
        raw = dict(parameters.raw)
        wanted = int((mean > GRADIENT_LIMIT).sum())
        room = max(self._budget - len(parameters), 0)
        parents = torch.argsort(mean, descending=True, stable=True)[: min(wanted, room)]
        large = raw["log_scales"][parents].amax(dim=1).exp() > SMALL_SHARE * self._extent
        divided = parents[large]
        twins = {name: tensor[parents].clone() for name, tensor in raw.items()}
        twins["log_scales"][large] -= math.log(SPLIT_SHRINK)
        twins["centers"][large] = _drawn(raw, divided, random)
        raw["centers"][divided] = _drawn(raw, divided, random)
        raw["log_scales"][divided] -= math.log(SPLIT_SHRINK)
        adam.forget(divided, len(parents))
        return Parameters({name: torch.cat([tensor, twins[name]]) for name, tensor in raw.items()})

    def _prune(self, parameters: Parameters, adam: Adam) -> Parameters:
        """Take faint and huge splats away, unless that leaves none."""
        raw = dict(parameters.raw)
        kept = raw["logits"].sigmoid() >= DEAD_OPACITY
        kept &= raw["log_scales"].amax(dim=1).exp() <= LARGE_SHARE * self._extent
        if kept.all() or not kept.any():
            return parameters
        adam.keep(kept)
        return Parameters({name: tensor[kept] for name, tensor in raw.items()})


def _drawn(raw: RawTensors, rows: Tensor, random: torch.Generator) -> Tensor:
    """Return places (n, 3) drawn from the splats' own shapes."""
    axes = rotation_matrices(raw["rotations"][rows]) * raw["log_scales"][rows].exp()[:, None, :]
    offsets = torch.randn(len(rows), 3, generator=random)
    return raw["centers"][rows] + (axes @ offsets[:, :, None])[:, :, 0]
