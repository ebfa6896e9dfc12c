"""Splats as samples of a Markov chain (Kheradmand et al. 2024): noise explores, dead splats move to live ones.

Lengths are measured in scene extents where the paper's constants are those of scenes of size 1.
"""

import math

import torch
from torch import Tensor

from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.densification import random_numbers
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.parameters import Parameters, RawTensors
from slideframe_gs_torch.reference import rotation_matrices

DEAD_OPACITY = 0.005
START_OPACITY, START_SHRINK = 0.5, 0.3
OPACITY_WEIGHT, SCALE_WEIGHT = 0.01, 0.01
GROWTH = 1.05
# The paper relocates every 100 of 30 000 iterations from the 500th to the 25 000th.
ROUNDS, FIRST_SHARE, LAST_SHARE = 245, 500 / 30_000, 25_000 / 30_000
FEWEST_BETWEEN_ROUNDS = 10
NOISE_RATE, NOISE_STEEPNESS, NOISE_OPACITY = 5e5, 100.0, 0.005
MOST_COPIES = 51


class MarkovChain:
    """Relocates, adds and shakes splats; their number grows by 5 % a round up to the budget."""

    def __init__(self, iterations: int, budget: int, extent: float, seed: int) -> None:
        """Fix the pace."""
        self._first, self._last = FIRST_SHARE * iterations, LAST_SHARE * iterations
        self._interval = max(FEWEST_BETWEEN_ROUNDS, round((self._last - self._first) / ROUNDS))
        self._rounds = max(1, int((self._last - self._first) / self._interval))
        self._budget, self._extent, self._seed = budget, extent, seed

    def start(self, state: State) -> None:
        """Begin small and half opaque, so that room is left to move in."""
        raw = state.parameters.raw
        raw["logits"].fill_(math.log(START_OPACITY / (1 - START_OPACITY)))
        raw["log_scales"].add_(math.log(START_SHRINK))

    def pressure(self) -> tuple[float, float]:
        """Let opacities and sizes fade that the picture doesn't ask for."""
        return OPACITY_WEIGHT, SCALE_WEIGHT / self._extent

    def observe(self, state: State, rows: Tensor, screen_gradients: Tensor, width: int) -> None:
        """Gradients play no part."""

    def after_step(self, state: State, center_rate: float) -> None:
        """Relocate and add where a round is due; shake always."""
        random = random_numbers(self._seed, state.iteration)
        if self._first <= state.iteration <= self._last and state.iteration % self._interval == 0:
            growth = max(GROWTH, (self._budget / state.start_count) ** (1.5 / self._rounds))
            target = min(self._budget, max(len(state.parameters), round(growth * len(state.parameters))))
            state.parameters = relocate_and_add(state.parameters, state.adam, target, random)
            state.score = torch.zeros(len(state.parameters))
        self._shake(state.parameters.raw, center_rate, random)

    def _shake(self, raw: RawTensors, center_rate: float, random: torch.Generator) -> None:
        """Move faint splats along their own shape (eq. 9 of the paper)."""
        opacities = raw["logits"].sigmoid()
        axes = rotation_matrices(raw["rotations"]) * (raw["log_scales"].exp() / self._extent)[:, None, :]
        gate = torch.sigmoid(NOISE_STEEPNESS * (NOISE_OPACITY - opacities))
        noise = torch.randn(len(opacities), 3, generator=random) * (gate * NOISE_RATE * center_rate)[:, None]
        raw["centers"].add_((axes @ (axes.transpose(1, 2) @ noise[:, :, None]))[:, :, 0])


def relocate_and_add(parameters: Parameters, adam: Adam, target: int, random: torch.Generator) -> Parameters:
    """Put dead splats, and new ones up to `target`, where live ones are, drawn by opacity; the picture stays alike."""
    raw = dict(parameters.raw)
    opacities = raw["logits"].sigmoid()
    dead = torch.nonzero(opacities <= DEAD_OPACITY)[:, 0]
    added = target - len(parameters)
    weights = torch.where(opacities > DEAD_OPACITY, opacities, 0.0)
    if len(dead) + added == 0 or weights.sum() <= 0:
        return parameters
    hosts = torch.multinomial(weights, len(dead) + added, replacement=True, generator=random)
    copies = 1 + torch.bincount(hosts, minlength=len(parameters))
    chosen = torch.nonzero(copies > 1)[:, 0]
    shared, shrink = shared_opacity(opacities[chosen].double(), copies[chosen].clamp_max(MOST_COPIES))
    raw["logits"][chosen] = torch.logit(shared.clamp(DEAD_OPACITY, 1 - 1e-6)).float()
    raw["log_scales"][chosen] += shrink.log().float()[:, None]
    for name, tensor in raw.items():
        tensor[dead] = tensor[hosts[: len(dead)]]
        raw[name] = torch.cat([tensor, tensor[hosts[len(dead) :]]])
    adam.forget(torch.cat([chosen, dead]), added)
    return Parameters(raw)


def shared_opacity(opacities: Tensor, copies: Tensor) -> tuple[Tensor, Tensor]:
    """Return the opacity of each of N equal splats that together replace one, and the factor of their scales.

    Source: Kheradmand et al. 2024, "3D Gaussian splatting as Markov chain Monte Carlo", eq. 9: the light that passes
    the centre stays, and so does the integral of the opacity along a line through it.

    Args:
        opacities: (n,) float64.
        copies: (n,) N, whole numbers up to MOST_COPIES.
    """
    shared = 1 - (1 - opacities) ** (1 / copies.double())
    integral = torch.zeros_like(opacities)
    for first in range(1, MOST_COPIES + 1):
        taken = copies >= first
        if not taken.any():
            break
        # sum over k of C(i - 1, k) (-1)^k o^(k + 1) / sqrt(k + 1)
        for k in range(first):
            factor = math.comb(first - 1, k) * (-1) ** k / math.sqrt(k + 1)
            integral = torch.where(taken, integral + factor * shared ** (k + 1), integral)
    return shared, opacities / integral
