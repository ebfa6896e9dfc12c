"""Gradient descent from the sparse cloud to splats that look like the photographs shown."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
import torch

from slideframe.errors import StageFailed
from slideframe.products import Survey
from slideframe.stages import Context
from slideframe_gs_torch import checkpoint
from slideframe_gs_torch.allocator import freed_memory_kept
from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.densification import Densifier, densifier
from slideframe_gs_torch.exposure import Exposures
from slideframe_gs_torch.held_out import HeldOut
from slideframe_gs_torch.image_loss import image_loss
from slideframe_gs_torch.initialisation import initial_parameters, scene_extent
from slideframe_gs_torch.optimiser import Adam, Pressure
from slideframe_gs_torch.previews import Previews
from slideframe_gs_torch.rasterize import Raster, rasterize
from slideframe_gs_torch.shelf import ShelvedViews
from slideframe_gs_torch.views import TrainingView

if TYPE_CHECKING:
    from slideframe_gs_torch.reconstructor import TorchSplats

# Steps for each photograph that shows a splat; positions in scene extents, falling a hundredfold by the end. They are
# far bolder than those of Kerbl et al. 2023, whose training is ten times as long.
CENTER_RATE, CENTER_DECAY = 1.7e-3, 0.01
# The others fall to a tenth over the last part: until then what a step adds to the error hardly matters, in the end it
# would show as half a decibel of noise.
SETTLING_FROM, SETTLED_RATE = 0.6, 0.1
RATES = {"rotations": 6e-3, "log_scales": 6e-2, "logits": 0.12, "constant": 6e-2, "view_dependent": 3e-3}
# Shares of the iterations at which the picture has a quarter and a half of its width.
QUARTER_UNTIL, HALF_UNTIL = 0.15, 0.4
# A splat's largest scale, in scene extents: beyond it lies a curtain behind the scene, not the ground.
LARGEST_SHARE = 0.05
# Its smallest: far below a pixel, and far above the underflow that would void the limit on its shape.
SMALLEST_SHARE = 1e-7
# Colours begin to depend on the view, one degree more each time that this share of the iterations has passed.
DEGREE_SHARE = 0.1
# Floaters are looked for that often, in iterations.
CLEAR_EVERY = 100
INVISIBLE_LOGIT = -12.0
# Weight in the loss of the mean share of light that splats keep off the sky.
CLEAR_WEIGHT = 0.3
# Share of the light that may pass all splats: nobody sees it, and ground that few splats show would be blurred to stop
# the last of it.
TOLERATED_LIGHT = 0.05
CHECKPOINT_EVERY = 200
REPORT_EVERY = 10


@dataclass(frozen=True)
class Scene:
    """What splats are trained on: the survey, the views shown, the colour behind them and the scene's length, m."""

    survey: Survey
    shown: ShelvedViews
    behind: tuple[float, float, float]
    extent: float

    @classmethod
    def of(cls, options: "TorchSplats", survey: Survey, shown: ShelvedViews) -> Self:
        """Take the views and measure them."""
        return cls(survey, shown, options.background or mean_colour(shown), scene_extent(survey))


def train(options: "TorchSplats", scene: Scene, measure: HeldOut, previews: Previews, context: Context) -> State:
    """Return the state after the last iteration, gone on from a checkpoint where there is one."""
    state = checkpoint.load(context)
    fresh = state is None
    if state is None:
        parameters = initial_parameters(scene.survey, scene.shown, options, context.seed)
        exposures = Exposures.of(len(scene.survey.photographs))
        state = State(parameters, Adam(), torch.zeros(len(parameters)), len(parameters), exposures)
    growth = densifier(
        options.densification, options.iterations, state.start_count, options.splat_budget, scene.extent, context.seed
    )
    if fresh:
        growth.start(state)
    with freed_memory_kept():
        optimise(options, scene, state, growth, measure, previews, context)
    previews.show_last(state, context)
    return state


def optimise(
    options: "TorchSplats",
    scene: Scene,
    state: State,
    growth: Densifier,
    measure: HeldOut,
    previews: Previews,
    context: Context,
) -> None:
    """Carry the state to the last iteration, or until it has settled, with a checkpoint now and then."""
    if options.depth_weight > 0:
        scene.shown.add_depths(scene.survey.sparse_points)
    cameras = torch.tensor(scene.survey.world_from_camera[:, :, 3], dtype=torch.float32)
    checkpoints = checkpoint.Writer(context)
    while state.iteration < options.iterations and not state.settled:
        began = time.perf_counter()
        share = state.iteration / options.iterations
        place = view_index(len(scene.shown), state.iteration, context.seed)
        view = scene.shown.reduced(place, reduction(share))
        loss = descend(options, view, scene.behind, state, growth, scene.extent)
        growth.after_step(state, rates(share, scene.extent)["centers"])
        if state.iteration % CLEAR_EVERY == 0:
            fade_near(state.parameters.raw, cameras, options.near_share * scene.extent)
        state.iteration += 1
        state.seconds += time.perf_counter() - began
        if state.iteration % REPORT_EVERY == 0 or state.iteration == options.iterations:
            figures = {"loss": loss, "splats": float(len(state.parameters))}
            figures |= {"held_out_psnr_db": state.curve[-1][2]} if state.curve else {}
            context.progress(state.iteration, options.iterations, **figures)
        state.settled = measure.settled(state)
        previews.show_if_due(state, context)
        if state.iteration % CHECKPOINT_EVERY == 0:
            checkpoints.save(state)


def descend(
    options: "TorchSplats",
    view: TrainingView,
    behind: tuple[float, float, float],
    state: State,
    growth: Densifier,
    extent: float,
) -> float:
    """Take one step towards one photograph and return the loss before it.

    Raises:
        StageFailed: the loss or a gradient is not a number.
    """
    share = state.iteration / options.iterations
    rows = state.parameters.in_view(view)
    leaves = state.parameters.leaves(rows, active_degree(options.harmonics_degree, share))
    pulls = torch.zeros(len(rows), 2)
    raster = rasterize(
        *leaves.values(),
        camera=view.camera,
        world_from_camera=view.world_from_camera,
        background=behind,
        depth=view.depths is not None,
        screen_gradients=pulls,
    )
    correction = state.exposures.corrections[view.index].clone().requires_grad_()
    loss = photograph_loss(options, view, raster, state.exposures, correction)
    loss.backward()  # type: ignore[no-untyped-call]
    require_numbers(loss, leaves, view.name, state.iteration)
    opacity_weight, size_weight = growth.pressure()
    pressure = Pressure(
        options.anisotropy_weight, options.anisotropy_limit, opacity_weight, size_weight,
        SMALLEST_SHARE * extent, LARGEST_SHARE * extent,
    )  # fmt: skip
    state.adam.step(state.parameters.raw, rows, leaves, pulls, rates(share, extent), pressure)
    if correction.grad is not None:
        state.exposures.step(view.index, correction.grad)
    growth.observe(state, rows, pulls, view.camera.width)
    return float(loss.detach())


def photograph_loss(
    options: "TorchSplats", view: TrainingView, raster: Raster, exposures: Exposures, correction: torch.Tensor
) -> torch.Tensor:
    """Return how a drawn view differs from its photograph, in colour and in the depth of its sparse points."""
    drawn, truth = raster.colour.permute(2, 0, 1), view.truth
    if options.exposure_correction:
        drawn = exposures.correct(drawn, correction)
    if view.mask is not None:
        drawn = torch.where(view.mask, drawn, truth)
    loss = image_loss(drawn, truth, options.ssim_weight)
    if options.exposure_correction:
        loss = loss + exposures.regularisation(correction)
    if options.opaque_weight > 0:
        passed = (1 - TOLERATED_LIGHT - raster.alpha).clamp_min(0)
        loss = loss + options.opaque_weight * (passed if view.mask is None else passed * view.mask).mean()
    if view.sky is not None:
        loss = loss + CLEAR_WEIGHT * (raster.alpha * view.sky).mean()
    if view.depths is not None and raster.depth is not None:
        loss = loss + options.depth_weight * view.depths.loss(raster.depth, raster.alpha)
    return loss


def fade_near(raw: dict[str, torch.Tensor], cameras: torch.Tensor, nearest: float) -> None:
    """Make splats invisible that hang before a camera (camera, 3) nearer than `nearest` m: a drone flies in clear air.

    What is dead is then put to use elsewhere, or not exported.
    """
    centers = raw["centers"]
    near = (centers > cameras.amin(dim=0) - nearest) & (centers < cameras.amax(dim=0) + nearest)
    for part in torch.nonzero(near.all(dim=1))[:, 0].split(65_536):
        hanging = part[torch.cdist(centers[part], cameras).amin(dim=1) < nearest]
        raw["logits"][hanging] = INVISIBLE_LOGIT


def active_degree(degree: int, share: float) -> int:
    """Return the degree of the harmonics in use when `share` of the iterations has passed."""
    return min(degree, int(share / DEGREE_SHARE))


def mean_colour(views: Iterable[TrainingView]) -> tuple[float, float, float]:
    """Return the mean sRGB of the photographs but the sky, 0 to 1: the best guess where nothing is known."""
    levels = [view.pixels if view.sky is None else view.pixels[:, ~view.sky][..., None] for view in views]
    red, green, blue = np.mean([part.double().mean(dim=(1, 2)).numpy() for part in levels], axis=0) / 255
    return float(red), float(green), float(blue)


def rates(share: float, extent: float) -> dict[str, float]:
    """Return the step of every tensor when `share` of the iterations has passed."""
    passed = max(share - SETTLING_FROM, 0) / (1 - SETTLING_FROM)
    others = {name: rate * SETTLED_RATE**passed for name, rate in RATES.items()}
    return {"centers": CENTER_RATE * extent * CENTER_DECAY**share, **others}


def reduction(share: float) -> int:
    """Return the factor by which photographs are reduced when `share` of the iterations has passed."""
    return 4 if share < QUARTER_UNTIL else 2 if share < HALF_UNTIL else 1


def view_index(count: int, iteration: int, seed: int) -> int:
    """Return which view an iteration shows: each once in an epoch, in an order that depends on nothing else."""
    epoch, position = divmod(iteration, count)
    return int(np.random.default_rng((seed, epoch)).permutation(count)[position])


def require_numbers(loss: torch.Tensor, leaves: dict[str, torch.Tensor], photograph: str, iteration: int) -> None:
    """Raise where the loss or a gradient is no number, naming it."""
    where = f"iteration {iteration}, photograph {photograph}"
    if not torch.isfinite(loss):
        raise StageFailed(
            "the loss of the splats is not a number", where=where, cure="check this photograph and its pose"
        )
    for name, tensor in leaves.items():
        if tensor.grad is not None and not torch.isfinite(tensor.grad.sum()):
            raise StageFailed(
                f"the gradient of '{name}' is not a number", where=where, cure="check this photograph and its pose"
            )
