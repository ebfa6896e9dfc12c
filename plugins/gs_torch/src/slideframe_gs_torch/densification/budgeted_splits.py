"""Splits of the splats whose centres the picture pulls at most, at a pace that reaches the budget; ours."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.parameters import Parameters
from slideframe_gs_torch.reference import rotation_matrices

# Fainter splats are taken away and put to use elsewhere, and so is this share of all in each round: those whose colour
# matters least to the photographs, which lie under others or show less than a pixel. They are judged once as many
# photographs have shown them.
DEAD_OPACITY, IDLE_SHARE, FEWEST_SHOWN = 0.02, 0.05, 15
# Weight of the mean opacity in the loss.
OPACITY_WEIGHT = 0.005
# A split puts two children at +-0.8 sigma of the longest axis, each 0.6 sigma long there: 0.8^2 + 0.6^2 = 1
# keeps the covariance of the pair that of the parent, and makes needles shorter instead of breeding them.
SPLIT_OFFSET, SPLIT_SHRINK = 0.8, 0.6
# Two children of 0.6 the size hold the parent's opacity in sum when each has 1 / 1.2 of it.
SPLIT_OPACITY = 1 / (2 * SPLIT_SHRINK)


@dataclass
class Schedule:
    """When to densify and how many splats there may be by then."""

    iterations: int
    start_count: int
    budget: int

    FIRST_SHARE, LAST_SHARE, ROUNDS = 0.05, 0.6, 12

    @property
    def interval(self) -> int:
        """Iterations between two rounds."""
        return max(1, round((self.LAST_SHARE - self.FIRST_SHARE) * self.iterations / self.ROUNDS))

    @property
    def last(self) -> float:
        """Iteration after which splats are split no more."""
        return self.LAST_SHARE * self.iterations

    def is_due(self, iteration: int) -> bool:
        """Whether splats are split after this iteration, which counts from 0."""
        return self.FIRST_SHARE * self.iterations <= iteration <= self.last and iteration % self.interval == 0

    def target(self, iteration: int) -> int:
        """Return the number of splats aimed at: geometric growth from the start to the budget."""
        share = iteration / self.iterations
        passed = min(max((share - self.FIRST_SHARE) / (0.9 * (self.LAST_SHARE - self.FIRST_SHARE)), 0), 1)
        return round(self.start_count * math.pow(self.budget / self.start_count, passed))


class BudgetedSplits:
    """Splits the highest scores of each round into two; dead splats make room first."""

    def __init__(self, iterations: int, start_count: int, budget: int) -> None:
        """Fix the pace."""
        self._schedule = Schedule(iterations, start_count, budget)

    def start(self, state: State) -> None:
        """Begin with every splat as it is."""

    def pressure(self) -> tuple[float, float]:
        """Let opacity fade that the picture doesn't ask for: floaters vanish and are put to use elsewhere."""
        return OPACITY_WEIGHT, 0.0

    def observe(self, state: State, rows: Tensor, screen_gradients: Tensor, width: int) -> None:
        """Keep each splat's largest gradient, per px of the whole photograph, so that reduced views weigh the same."""
        if state.iteration <= self._schedule.last:
            pull = torch.hypot(screen_gradients[:, 0], screen_gradients[:, 1]) * width
            state.score[rows] = torch.maximum(state.score.index_select(0, rows), pull)

    def after_step(self, state: State, center_rate: float) -> None:
        """Split where a round is due."""
        if self._schedule.is_due(state.iteration):
            state.parameters = densify(
                state.parameters, state.adam, state.score, self._schedule.target(state.iteration)
            )
            state.score = torch.zeros(len(state.parameters))


def densify(parameters: Parameters, adam: Adam, score: Tensor, target: int) -> Parameters:
    """Split the splats with the highest scores (splat,); useless ones make room first, new rows follow."""
    raw = dict(parameters.raw)
    useless = (raw["logits"].sigmoid() < DEAD_OPACITY) | idle(adam, len(parameters))
    dead = torch.nonzero(useless)[:, 0]
    wanted = max(target - len(parameters), 0) + len(dead)
    candidates = torch.where(useless, -1.0, score)
    ranked = torch.argsort(candidates, descending=True, stable=True)
    parents = ranked[: min(wanted, int((candidates > 0).sum()))]
    into_dead = dead[: len(parents)]
    added = len(parents) - len(into_dead)
    first, second = split(raw, parents)
    for name, tensor in raw.items():
        tensor[parents] = first[name]
        tensor[into_dead] = second[name][: len(into_dead)]
        raw[name] = torch.cat([tensor, second[name][len(into_dead) :]])
    adam.forget(torch.cat([parents, into_dead]), added)
    return Parameters(raw)


def idle(adam: Adam, count: int) -> Tensor:
    """Tell of each splat (splat,) whether it is among those whose colour matters least."""
    if not adam.square:
        return torch.zeros(count, dtype=torch.bool)
    weights = torch.where(adam.steps >= FEWEST_SHOWN, adam.colour_gradients(), torch.inf)
    return weights < weights.kthvalue(1 + int(IDLE_SHARE * count)).values


def split(raw: dict[str, Tensor], parents: Tensor) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
    """Return the two children of each parent along its longest axis."""
    child = {name: tensor[parents].clone() for name, tensor in raw.items()}
    rows = torch.arange(len(parents))
    longest = child["log_scales"].argmax(dim=1)
    length = child["log_scales"][rows, longest].exp()
    axis = rotation_matrices(child["rotations"])[rows, :, longest]
    offset = SPLIT_OFFSET * length[:, None] * axis
    child["log_scales"][rows, longest] += math.log(SPLIT_SHRINK)
    child["logits"] = torch.logit(child["logits"].sigmoid() * SPLIT_OPACITY)
    other = {name: tensor.clone() for name, tensor in child.items()}
    child["centers"] += offset
    other["centers"] -= offset
    return child, other
