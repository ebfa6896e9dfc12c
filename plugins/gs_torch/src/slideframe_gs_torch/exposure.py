"""How each photograph's exposure and white balance differ from the splats' own colours."""

from dataclasses import dataclass

import torch
from torch import Tensor

FIRST_DECAY, SECOND_DECAY, EPSILON = 0.9, 0.999, 1e-15
RATE = 2e-3
# Keeps the splats' colours those of the average photograph: what all photographs share is theirs.
IDENTITY_WEIGHT = 0.01
IDENTITY = torch.tensor([1.0, 0.0])


@dataclass
class Exposures:
    """Gain and offset of each channel of each photograph shown, learned beside the splats.

    Attributes:
        corrections: (photograph, channel, 2): shown = gain * colour + offset.
        mean: running mean of the gradients, of the same shape.
        square: running mean of their squares.
        steps: (photograph,), how often each has been shown.
    """

    corrections: Tensor
    mean: Tensor
    square: Tensor
    steps: Tensor

    @classmethod
    def of(cls, count: int) -> "Exposures":
        """Return the state in which all photographs are alike."""
        corrections = IDENTITY.repeat(count, 3, 1)
        return cls(corrections, torch.zeros_like(corrections), torch.zeros_like(corrections), torch.zeros(count))

    def correct(self, colours: Tensor, correction: Tensor) -> Tensor:
        """Return colours (3, height, width) as the photograph with that correction (3, 2) shows them."""
        return colours * correction[:, 0, None, None] + correction[:, 1, None, None]

    def regularisation(self, correction: Tensor) -> Tensor:
        """Return what a correction that isn't needed costs."""
        return IDENTITY_WEIGHT * (correction - IDENTITY).square().sum()

    def step(self, index: int, gradient: Tensor) -> None:
        """Move the correction of one photograph along its gradient (3, 2), by Adam."""
        self.steps[index] += 1
        steps = float(self.steps[index])
        self.mean[index].lerp_(gradient, 1 - FIRST_DECAY)
        self.square[index].lerp_(gradient.square(), 1 - SECOND_DECAY)
        mean = self.mean[index] / (1 - FIRST_DECAY**steps)
        square = self.square[index] / (1 - SECOND_DECAY**steps)
        self.corrections[index] -= RATE * mean / (square.sqrt() + EPSILON)


def fitted(drawn: Tensor, truth: Tensor, mask: Tensor | None) -> Tensor:
    """Return a drawn picture (3, height, width) with each channel's gain and offset fitted to a photograph's.

    A photograph that training hasn't seen has no correction of its own; this shows what is left without exposure.
    """
    seen = torch.ones_like(truth[0], dtype=torch.bool) if mask is None else mask
    channels = []
    for one, other in zip(drawn, truth, strict=True):
        x, y = one[seen].double(), other[seen].double()
        spread = (x - x.mean()).square().mean()
        gain = ((x - x.mean()) * (y - y.mean())).mean() / spread if spread > 0 else torch.tensor(1.0)
        channels.append((gain * (one - x.mean()) + y.mean()).float())
    return torch.stack(channels).clamp(0, 1)
