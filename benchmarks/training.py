"""How splats come to look like the photographs, second by second, and what the anisotropy term is worth.

    python benchmarks/training.py SURVEY_RESULT [--variants NAME ...] [--picture FILE.jpg] [--set OPTION=VALUE ...]

SURVEY_RESULT is a stored survey, `store/pose_source-<key>` of a run that reached that stage. Every variant is one
training from scratch with otherwise default options. Held-out photographs measure the likeness. For the streaks, each
splat is turned at random about its centre, as grains of a moving mass turn: compact splats leave the picture much as it
was, needles smear it. The streak figure is the root mean square change of the picture, in grey levels of 255.
The photographs held out are compared before a sky too, and pixels counted that let a tenth of the light through:
splats that are translucent where the background of training has the right colour look better than they are.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import torch
from machine import print_machine
from PIL import Image

from slideframe.device import Device
from slideframe.products import SplatCloud, Survey
from slideframe.stages import Context
from slideframe.store import Entry
from slideframe_gs_torch.evaluation import draw_view, likeness
from slideframe_gs_torch.reconstructor import TorchSplats
from slideframe_gs_torch.views import TrainingView, load_views

VARIANTS = {
    "default": {},
    "no anisotropy term": {"anisotropy_weight": 0.0, "anisotropy_limit": 100.0},
    "mcmc": {"densification": "mcmc"},
    "clone_and_split": {"densification": "clone_and_split"},
    "exposure": {"exposure_correction": True},
    "depth": {"depth_weight": 0.1},
    "two blocks": {"blocks": 2},
    "opaque_weight 0": {"opaque_weight": 0.0},
    "opaque_weight 0.1": {"opaque_weight": 0.1},
}
LIMIT = 3.0
# The photograph, a held-out one, that the picture shows.
SHOWN = 16
BACKGROUND = (0.5, 0.5, 0.5)
BLACK, WHITE, SKY = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.62, 0.74, 0.86)
TRANSLUCENT = 0.1  # share of light that passes


def turned_at_random(splats: SplatCloud, seed: int = 0) -> SplatCloud:
    """Return the splats, each with an orientation drawn at random."""
    rotations = np.random.default_rng(seed).normal(size=splats.rotations.shape)
    unit = rotations / np.linalg.norm(rotations, axis=1, keepdims=True)
    return splats.model_copy(update={"rotations": unit.astype(np.float32)})


def streaks(splats: SplatCloud, view: TrainingView) -> tuple[float, torch.Tensor, torch.Tensor]:
    """Return how much the view changes when all splats turn, in grey levels, and how it looks before and after."""
    still = draw_view(splats, view, BACKGROUND)
    turned = draw_view(turned_at_random(splats), view, BACKGROUND)
    return float(255 * (turned - still).square().mean().sqrt()), still, turned


def before_sky(splats: SplatCloud, views: list[TrainingView]) -> tuple[float, float]:
    """Return the mean PSNR of the views before a sky, dB, and the share of their pixels that are translucent."""
    ratios = [likeness(splats, view, SKY).psnr for view in views]
    passing = [(draw_view(splats, view, WHITE) - draw_view(splats, view, BLACK)).mean(dim=0) for view in views]
    return float(np.mean(ratios)), float(
        torch.cat([light.ravel() for light in passing]).gt(TRANSLUCENT).double().mean()
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("survey", type=Path)
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, default=["default", "no anisotropy term"])
    parser.add_argument(
        "--picture", type=Path, help="file for a row of each variant: photograph, splats, splats turned"
    )
    parser.add_argument("--photographs", type=Path, help="their folder, where it is no longer that of the survey")
    parser.add_argument("--set", nargs="*", default=[], help="options for all variants, such as iterations=4000")
    arguments = parser.parse_args()
    print_machine("slideframe-gs-torch", "torch", "numba", "numpy")
    survey = moved(Entry(arguments.survey).read(Survey), arguments.photographs)
    common = dict(assignment.split("=", 1) for assignment in arguments.set)
    rows = []
    for name in arguments.variants:
        options = TorchSplats.model_validate(common | VARIANTS[name])
        context = Context(device=Device(), scratch=Path(tempfile.mkdtemp()))
        splats = options.reconstruct(survey, context)
        (view,) = load_views(survey, [SHOWN], options.image_width, context)
        changed, still, turned = streaks(splats, view)
        rows.append(torch.cat([view.truth, still, turned], dim=2))
        print_variant(name, splats, changed, context.figures)
        held_out = range(0, len(survey.photographs), options.hold_out_every)
        sky, share = before_sky(splats, list(load_views(survey, held_out, options.image_width, context)))
        print(f"  held out before a sky: {sky:.2f} dB; translucent: {share:.2%} of the pixels", flush=True)
    if arguments.picture:
        grid = torch.cat(rows, dim=1).permute(1, 2, 0).mul(255).round().to(torch.uint8)
        Image.fromarray(grid.numpy()).save(arguments.picture, quality=88)


def moved(survey: Survey, folder: Path | None) -> Survey:
    if folder is None:
        return survey
    photographs = tuple(photo.model_copy(update={"path": folder / photo.path.name}) for photo in survey.photographs)
    return survey.model_copy(update={"photographs": photographs})


def print_variant(name: str, splats: SplatCloud, changed: float, figures: dict) -> None:
    ratios = splats.scales.max(axis=1) / splats.scales.min(axis=1)
    print(f"\n{name}: {len(splats):,} splats, {figures['iterations']:,} iterations", end="")
    print(f" at {figures['iterations_per_second']:.1f}/s")
    print(f"  held out: {figures['held_out_psnr_db']:.2f} dB PSNR, {figures['held_out_ssim']:.4f} SSIM, ", end="")
    print(f"{figures['held_out_psnr_db_exposure_fitted']:.2f} dB with the exposure fitted")
    print(f"  trained above the limit: {figures['share_above_anisotropy_limit']:.2%} of the splats;", end="")
    print(f" exported above {LIMIT:g}: {(ratios > LIMIT * 1.0001).mean():.2%}, ", end="")
    print(f"99th percentile {np.quantile(ratios, 0.99):.2f}")
    print(f"  streaks once all splats have turned: {changed:.2f} grey levels")
    print(f"  shown in training: {figures['shown_psnr_db']:.2f} dB PSNR")
    curve = figures.get("held_out_psnr_db_by_second", {}).items()
    print("  seconds and dB: " + ", ".join(f"{float(seconds):.0f} {psnr:.2f}" for seconds, psnr in curve))


if __name__ == "__main__":
    main()
