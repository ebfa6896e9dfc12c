"""Adam over the splats that a photograph shows, whose number may grow, with what regularises each by itself."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from slideframe_gs_torch import optimiser_kernels as kernels
from slideframe_gs_torch.parameters import NAMES, RawTensors
from slideframe_gs_torch.threads import run_shares


class Pressure(NamedTuple):
    """What pushes splats beside the photographs: weights of means over all splats, and bounds.

    Attributes:
        anisotropy_weight: lambda of mean(max(s_max / s_min, r) - r).
        anisotropy_limit: r.
        opacity_weight: of the mean opacity.
        size_weight: of the mean scale, per metre.
        smallest: scale, m.
        largest: scale, m.
    """

    anisotropy_weight: float = 0.0
    anisotropy_limit: float = 100.0
    opacity_weight: float = 0.0
    size_weight: float = 0.0
    smallest: float = 1e-12
    largest: float = 1e12

    def numbers(self, count: int) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
        """Return what the kernel takes for so many splats."""
        weights = self.anisotropy_weight / count, self.anisotropy_limit, self.opacity_weight / count
        bounds = math.log(self.smallest), math.log(self.largest)
        return np.array([*weights, self.size_weight / (3 * count), *bounds], np.float32)


@dataclass
class Adam:
    """The running moments of every tensor, and how often each splat was moved (splat,)."""

    mean: RawTensors = field(default_factory=dict)
    square: RawTensors = field(default_factory=dict)
    steps: Tensor = field(default_factory=lambda: torch.zeros(0, dtype=torch.int32))

    def step(
        self,
        raw: RawTensors,
        rows: Tensor,
        leaves: RawTensors,
        pulls: Tensor,
        rates: dict[str, float],
        pressure: Pressure,
    ) -> None:
        """Move those rows (row,) of the splats that pixels pull at (row, 2) along the gradients of `leaves`, in place.

        Leaves are what was drawn of the rows, by the same names: scales and opacities rather than what they are made
        of.
        """
        count = len(raw["logits"])
        if not self.mean:
            self.mean = {name: torch.zeros_like(tensor) for name, tensor in raw.items()}
            self.square = {name: torch.zeros_like(tensor) for name, tensor in raw.items()}
            self.steps = torch.zeros(count, dtype=torch.int32)
        numbers = [tuple(map(_flat, (raw[name], self.mean[name], self.square[name]))) for name in NAMES]
        gradients = tuple(_flat(leaves[name].grad) for name in NAMES)  # type: ignore[arg-type]  # all were drawn
        run_shares(
            kernels.step_splats, -(-len(pulls) // kernels.BLOCK), len(pulls),
            rows.numpy(), pulls.numpy(), self.steps.numpy(), _flat(leaves["log_scales"]), _flat(leaves["logits"]),
            np.array(list(rates.values()), np.float32), pressure.numbers(count), *numbers, gradients,
        )  # fmt: skip

    def colour_gradients(self) -> Tensor:
        """Return the root mean square of the gradient of each splat's constant colour (splat,) where it was shown."""
        counted = 1 - kernels.SECOND_DECAY ** self.steps.clamp_min(1).float()
        return (self.square["harmonics"][:, 0].sum(dim=1) / counted).sqrt()

    def forget(self, replaced: Tensor, added: int) -> None:
        """Zero the moments of replaced rows and append zero rows for added ones."""
        for moments in (self.mean, self.square):
            for name, tensor in moments.items():
                tensor[replaced] = 0
                moments[name] = torch.cat([tensor, tensor.new_zeros(added, *tensor.shape[1:])])
        if len(self.steps):
            self.steps[replaced] = 0
            self.steps = torch.cat([self.steps, self.steps.new_zeros(added)])

    def keep(self, kept: Tensor) -> None:
        """Drop the moments of the rows that are not kept (row,)."""
        for moments in (self.mean, self.square):
            for name, tensor in moments.items():
                moments[name] = tensor[kept]
        self.steps = self.steps[kept] if len(self.steps) else self.steps


def _flat(tensor: Tensor) -> np.ndarray[tuple[int], np.dtype[np.float32]]:
    return tensor.detach().reshape(-1).numpy()
