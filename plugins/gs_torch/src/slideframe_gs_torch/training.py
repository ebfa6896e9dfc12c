"""Gradient descent from the sparse cloud to splats that look like the photographs."""

import math
import time
from typing import TYPE_CHECKING

import numpy as np
import torch

from slideframe.errors import StageFailed
from slideframe.products import SplatCloud, Survey
from slideframe.stages import Context
from slideframe_gs_torch import checkpoint
from slideframe_gs_torch.anisotropy import anisotropy_loss, share_above
from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.densification import Schedule, densify
from slideframe_gs_torch.evaluation import likeness
from slideframe_gs_torch.image_loss import image_loss
from slideframe_gs_torch.initialisation import initial_parameters, scene_extent, warn_of_few_points
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.rasterize import rasterize
from slideframe_gs_torch.threads import one_torch_thread
from slideframe_gs_torch.views import TrainingView, load_views

if TYPE_CHECKING:
    from slideframe_gs_torch.reconstructor import TorchSplats

# Steps per iteration; positions in scene extents, falling a hundredfold by the end. They are bolder than those
# of Kerbl et al. 2023, whose training is ten times as long.
CENTER_RATE, CENTER_DECAY = 6e-4, 0.01
RATES = {"rotations": 2e-3, "log_scales": 2e-2, "logits": 4e-2, "base": 2e-2, "rest": 1e-3}
# Opacity that the picture does not ask for fades: floaters in front of the cameras vanish and are put to use.
OPACITY_WEIGHT = 0.005
# Shares of the iterations at which the picture has a quarter and a half of its width.
QUARTER_UNTIL, HALF_UNTIL = 0.15, 0.4
# A splat's largest scale, in scene extents: beyond it lies a curtain behind the scene, not the ground.
LARGEST_SHARE = 0.05
# Its smallest: far below a pixel, and far above the underflow that would void the limit on its shape.
SMALLEST_SHARE = 1e-7
# Where photographs are compared; with opaque ground it matters little.
NEUTRAL_BACKGROUND = (0.5, 0.5, 0.5)
CHECKPOINT_EVERY = 200
REPORT_EVERY = 10


def train(options: "TorchSplats", survey: Survey, context: Context) -> SplatCloud:
    """Return the trained splats; figures say how they compare with photographs held out."""
    views = load_views(survey, options.image_width, context)
    held_out, shown = split_views(views, options.hold_out_every)
    warn_of_few_points(survey, context)
    state = checkpoint.load(context.scratch) or start(options, survey, context.seed)
    with one_torch_thread():
        optimise(options, shown, state, scene_extent(survey), context)
    raw_scales = state.parameters.raw["log_scales"].detach().exp().numpy()
    context.figure("share_above_anisotropy_limit", share_above(raw_scales, options.anisotropy_limit))
    splats = state.parameters.export(options.anisotropy_limit)
    context.figure("initial_splats", state.start_count)
    context.figure("splats", len(splats))
    context.figure("iterations_per_second", options.iterations / max(state.seconds, 1e-9))
    report_likeness(splats, held_out, options.background or NEUTRAL_BACKGROUND, context)
    return splats


def split_views(views: list[TrainingView], hold_out_every: int) -> tuple[list[TrainingView], list[TrainingView]]:
    """Return the views held out, every n-th from the first, and those shown; a single view is always shown."""
    if hold_out_every == 0 or len(views) < 2:
        return [], views
    shown = [view for index, view in enumerate(views) if index % hold_out_every]
    return views[::hold_out_every], shown


def start(options: "TorchSplats", survey: Survey, seed: int) -> State:
    """Return the state before the first iteration."""
    parameters = initial_parameters(survey, options.splat_budget, options.harmonics_degree, seed)
    for tensor in parameters.raw.values():
        tensor.requires_grad_()
    return State(parameters, Adam(), torch.zeros(len(parameters)), len(parameters))


def optimise(options: "TorchSplats", shown: list[TrainingView], state: State, extent: float, context: Context) -> None:
    """Carry the state to the last iteration, with a checkpoint now and then."""
    pyramids = [{factor: view.reduced(factor) for factor in (4, 2, 1)} for view in shown]
    schedule = Schedule(options.iterations, state.start_count, options.splat_budget)
    while state.iteration < options.iterations:
        began = time.perf_counter()
        pyramid = pyramids[view_index(len(shown), state.iteration, context.seed)]
        view = pyramid[reduction(state.iteration / options.iterations)]
        loss = descend(options, view, state, extent, context.seed)
        if schedule.is_due(state.iteration):
            target = schedule.target(state.iteration)
            state.parameters = densify(state.parameters, state.adam, state.score, target)
            state.score = torch.zeros(len(state.parameters))
        state.iteration += 1
        state.seconds += time.perf_counter() - began
        if state.iteration % REPORT_EVERY == 0 or state.iteration == options.iterations:
            context.progress(state.iteration, options.iterations, loss=loss, splats=float(len(state.parameters)))
        if state.iteration % CHECKPOINT_EVERY == 0:
            checkpoint.save(state, context.scratch)


def descend(options: "TorchSplats", view: TrainingView, state: State, extent: float, seed: int) -> float:
    """Take one step towards one photograph and return the loss before it.

    Raises:
        StageFailed: the loss or a gradient is not a number.
    """
    raw = state.parameters.raw
    screen_gradients = torch.zeros(len(state.parameters), 2)
    raster = rasterize(
        *state.parameters.splats(),
        camera=view.camera,
        world_from_camera=view.world_from_camera,
        background=background(options, state.iteration, seed),
        screen_gradients=screen_gradients,
    )
    drawn, truth = raster.colour.permute(2, 0, 1), view.truth
    if view.mask is not None:
        drawn = torch.where(view.mask, drawn, truth)
    loss = image_loss(drawn, truth, options.ssim_weight) + OPACITY_WEIGHT * raw["logits"].sigmoid().mean()
    if options.anisotropy_weight > 0:
        loss = loss + options.anisotropy_weight * anisotropy_loss(raw["log_scales"], options.anisotropy_limit)
    for tensor in raw.values():
        tensor.grad = None
    loss.backward()  # type: ignore[no-untyped-call]
    require_numbers(loss, raw, view.name, state.iteration)
    state.adam.step(raw, rates(state.iteration / options.iterations, extent))
    with torch.no_grad():
        raw["log_scales"].clamp_(math.log(SMALLEST_SHARE * extent), math.log(LARGEST_SHARE * extent))
    # per px of the whole photograph, so that reduced views weigh the same
    state.score = torch.maximum(state.score, screen_gradients.norm(dim=1) * view.camera.width)
    return float(loss.detach())


def background(options: "TorchSplats", iteration: int, seed: int) -> tuple[float, float, float]:
    """Return what an iteration shows behind the splats.

    Behind one constant colour the ground may stay translucent and let that colour do a part of the work: the film,
    where the ground moves and opens, would show it.
    """
    if options.background is not None:
        return options.background
    red, green, blue = np.random.default_rng((seed, iteration, 1)).uniform(size=3)
    return float(red), float(green), float(blue)


def rates(share: float, extent: float) -> dict[str, float]:
    """Return the step of every tensor when `share` of the iterations has passed."""
    return {"centers": CENTER_RATE * extent * CENTER_DECAY**share, **RATES}


def reduction(share: float) -> int:
    """Return the factor by which photographs are reduced when `share` of the iterations has passed."""
    return 4 if share < QUARTER_UNTIL else 2 if share < HALF_UNTIL else 1


def view_index(count: int, iteration: int, seed: int) -> int:
    """Return which view an iteration shows: each once in an epoch, in an order that depends on nothing else."""
    epoch, position = divmod(iteration, count)
    return int(np.random.default_rng((seed, epoch)).permutation(count)[position])


def require_numbers(loss: torch.Tensor, raw: dict[str, torch.Tensor], photograph: str, iteration: int) -> None:
    """Raise where the loss or a gradient is no number, naming it."""
    where = f"iteration {iteration}, photograph {photograph}"
    if not torch.isfinite(loss):
        raise StageFailed(
            "the loss of the splats is not a number", where=where, cure="check this photograph and its pose"
        )
    for name, tensor in raw.items():
        if tensor.grad is not None and not torch.isfinite(tensor.grad.sum()):
            raise StageFailed(
                f"the gradient of '{name}' is not a number", where=where, cure="check this photograph and its pose"
            )


def report_likeness(
    splats: SplatCloud, held_out: list[TrainingView], background: tuple[float, float, float], context: Context
) -> None:
    """Report PSNR and SSIM of the photographs that training has not seen."""
    if not held_out:
        context.warn("no photograph was held out, so the likeness of the splats is not measured")
        return
    found = {view.name: likeness(splats, view, background) for view in held_out}
    context.figure("held_out_psnr_db", float(np.mean([one.psnr for one in found.values()])))
    context.figure("held_out_ssim", float(np.mean([one.ssim for one in found.values()])))
    context.figure("held_out_psnr_db_by_photograph", {name: one.psnr for name, one in found.items()})
