"""The trained numbers of the splats, unbounded, and what they stand for."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from slideframe.products import SplatCloud
from slideframe_gs_torch import compiled
from slideframe_gs_torch.anisotropy import project_scales
from slideframe_gs_torch.reference import camera_from

if TYPE_CHECKING:
    from slideframe_gs_torch.views import TrainingView

# Splats that no pixel can see (alpha below 1/255) are not exported.
FAINTEST_OPACITY = 1 / 255

RawTensors = dict[str, Tensor]
NAMES = ("centers", "rotations", "log_scales", "logits", "harmonics")


@dataclass
class Parameters:
    """Raw tensors by name, the splat as their first axis.

    The further axes are centers (3), rotations (4), log_scales (3), logits () and harmonics (term, 3).
    """

    raw: RawTensors

    def __len__(self) -> int:
        return len(self.raw["centers"])

    def in_view(self, view: "TrainingView") -> Tensor:
        """Return the rows (row,) of the splats that a photograph may show."""
        camera_from_world = camera_from(torch.tensor(view.world_from_camera))
        rows = compiled.in_view(
            self.raw["centers"].numpy(),
            self.raw["log_scales"].numpy(),
            compiled.View.of(view.camera, camera_from_world.numpy(), antialiased=False),
        )
        return torch.from_numpy(rows)

    def leaves(self, rows: Tensor, degree: int) -> RawTensors:
        """Return, by the names of what it is made of, what `rasterize` draws of rows, with harmonics up to a degree.

        That is what takes gradients; from there to the raw tensors `Adam` knows the way.
        """
        raw = {name: tensor.index_select(0, rows) for name, tensor in self.raw.items()}
        drawn = {
            "centers": raw["centers"],
            "rotations": raw["rotations"],
            "log_scales": raw["log_scales"].exp_(),
            "logits": raw["logits"].sigmoid_(),
            "harmonics": raw["harmonics"][:, : (degree + 1) ** 2].contiguous(),
        }
        return {name: tensor.requires_grad_() for name, tensor in drawn.items()}

    def export(self, anisotropy_limit: float) -> SplatCloud:
        """Return the visible splats with the anisotropy limit strictly kept."""
        raw = self.raw
        opacities = raw["logits"].sigmoid()
        kept = opacities > FAINTEST_OPACITY
        return SplatCloud(
            centers=raw["centers"][kept].numpy(),
            rotations=torch.nn.functional.normalize(raw["rotations"][kept], dim=1).numpy(),
            scales=project_scales(raw["log_scales"][kept].exp().numpy(), anisotropy_limit),
            opacities=opacities[kept].numpy(),
            harmonics=raw["harmonics"][kept].numpy(),
        )
