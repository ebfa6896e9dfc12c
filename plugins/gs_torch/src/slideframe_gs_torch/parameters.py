"""The trained numbers of the splats, unbounded, and what they stand for."""

from dataclasses import dataclass

import torch
from torch import Tensor

from slideframe.products import SplatCloud
from slideframe_gs_torch.anisotropy import project_scales

# Splats that no pixel can see (alpha below 1/255) are not exported.
FAINTEST_OPACITY = 1 / 255

RawTensors = dict[str, Tensor]


@dataclass
class Parameters:
    """Raw tensors by name, the splat as their first axis.

    The further axes are centers (3), rotations (4), log_scales (3), logits (), base (1, 3) and rest (k, 3).
    """

    raw: RawTensors

    def __len__(self) -> int:
        return len(self.raw["centers"])

    def splats(self, degree: int) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Return what `rasterize` draws, with harmonics up to a degree."""
        raw = self.raw
        harmonics = torch.cat([raw["base"], raw["rest"][:, : (degree + 1) ** 2 - 1]], dim=1)
        return raw["centers"], raw["rotations"], raw["log_scales"].exp(), raw["logits"].sigmoid(), harmonics

    def export(self, anisotropy_limit: float) -> SplatCloud:
        """Return the visible splats with the anisotropy limit strictly kept."""
        raw = {name: tensor.detach() for name, tensor in self.raw.items()}
        opacities = raw["logits"].sigmoid()
        kept = opacities > FAINTEST_OPACITY
        return SplatCloud(
            centers=raw["centers"][kept].numpy(),
            rotations=torch.nn.functional.normalize(raw["rotations"][kept], dim=1).numpy(),
            scales=project_scales(raw["log_scales"][kept].exp().numpy(), anisotropy_limit),
            opacities=opacities[kept].numpy(),
            harmonics=torch.cat([raw["base"], raw["rest"]], dim=1)[kept].numpy(),
        )
