"""Adam over named tensors whose first axis may grow."""

from dataclasses import dataclass, field

import torch
from torch import Tensor

from slideframe_gs_torch import optimiser_kernels
from slideframe_gs_torch.parameters import RawTensors

FIRST_DECAY, SECOND_DECAY, EPSILON = 0.9, 0.999, 1e-15


@dataclass
class Adam:
    """The running moments of every tensor, and the number of steps taken."""

    mean: RawTensors = field(default_factory=dict)
    square: RawTensors = field(default_factory=dict)
    steps: int = 0

    def step(self, raw: RawTensors, rates: dict[str, float]) -> None:
        """Move every tensor along its gradient in place."""
        self.steps += 1
        for name, tensor in raw.items():
            if tensor.grad is None:
                continue
            for moments in (self.mean, self.square):
                moments.setdefault(name, torch.zeros_like(tensor, requires_grad=False))
            values, gradient, mean, square = (
                part.detach().reshape(-1).numpy() for part in (tensor, tensor.grad, self.mean[name], self.square[name])
            )
            optimiser_kernels.adam(
                values, gradient, mean, square, rates[name], self.steps, FIRST_DECAY, SECOND_DECAY, EPSILON
            )

    def forget(self, replaced: Tensor, added: int) -> None:
        """Zero the moments of replaced rows and append zero rows for added ones."""
        for moments in (self.mean, self.square):
            for name, tensor in moments.items():
                tensor[replaced] = 0
                moments[name] = torch.cat([tensor, tensor.new_zeros(added, *tensor.shape[1:])])

    def keep(self, kept: Tensor) -> None:
        """Drop the moments of the rows that are not kept (row,)."""
        for moments in (self.mean, self.square):
            for name, tensor in moments.items():
                moments[name] = tensor[kept]
