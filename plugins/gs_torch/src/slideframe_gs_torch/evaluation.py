"""How well splats resemble photographs that they were not trained on."""

from dataclasses import dataclass

import torch

from slideframe.errors import InputError
from slideframe.products import SplatCloud
from slideframe_gs_torch.exposure import fitted
from slideframe_gs_torch.image_loss import structural_similarity
from slideframe_gs_torch.rasterize import rasterize
from slideframe_gs_torch.views import TrainingView

# 8-bit pictures can't differ by less than this mean square; an exact match would be infinite decibels.
SMALLEST_SQUARE = 1e-10


@dataclass(frozen=True)
class Likeness:
    """Peak signal-to-noise ratio, dB, and structural similarity of one view; PSNR also with the exposure fitted."""

    psnr: float
    ssim: float
    fitted_psnr: float


def draw_view(splats: SplatCloud, view: TrainingView, background: tuple[float, float, float]) -> torch.Tensor:
    """Return the splats as the view's camera sees them, (3, height, width), 0 to 1."""
    centers, rotations, scales, opacities, harmonics = (
        torch.tensor(array)
        for array in (splats.centers, splats.rotations, splats.scales, splats.opacities, splats.harmonics)
    )
    raster = rasterize(
        centers, rotations, scales, opacities, harmonics,
        camera=view.camera, world_from_camera=view.world_from_camera, background=background,
    )  # fmt: skip
    return raster.colour.permute(2, 0, 1).clamp(0, 1)


def likeness(splats: SplatCloud, view: TrainingView, background: tuple[float, float, float]) -> Likeness:
    """Compare the splats with one photograph, where its lens saw something."""
    drawn, truth = draw_view(splats, view, background), view.truth
    if view.mask is not None:
        drawn = torch.where(view.mask, drawn, truth)
    share = 1.0 if view.mask is None else float(view.mask.double().mean())
    if share == 0:
        raise InputError("the lens saw nothing in this photograph", where=view.name, cure="leave it out, or its mask")
    # where the lens saw nothing both pictures are alike and count as 1: take that part off again
    ssim = (structural_similarity(drawn, truth) - (1 - share)) / share
    same_exposure = fitted(drawn, truth, view.mask)
    if view.mask is not None:
        same_exposure = torch.where(view.mask, same_exposure, truth)
    return Likeness(_psnr(drawn, truth, share), ssim, _psnr(same_exposure, truth, share))


def _psnr(drawn: torch.Tensor, truth: torch.Tensor, share: float) -> float:
    square = (drawn - truth).double().square().mean() / share
    return float(-10 * torch.log10(square.clamp_min(SMALLEST_SQUARE)))
