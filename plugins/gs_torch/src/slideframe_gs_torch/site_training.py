"""The splats of a whole site: block by block, one after the other, and how they resemble photographs held out."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from slideframe.errors import InputError
from slideframe.products import SplatCloud, Survey
from slideframe.stages import Context
from slideframe_gs_torch import checkpoint
from slideframe_gs_torch.anisotropy import share_above
from slideframe_gs_torch.blocks import Block, blocks_of, merge, survey_of
from slideframe_gs_torch.evaluation import Likeness, likeness
from slideframe_gs_torch.held_out import HeldOut, report_held_out
from slideframe_gs_torch.initialisation import warn_of_few_points
from slideframe_gs_torch.previews import Previews
from slideframe_gs_torch.shelf import Shelf, ShelvedViews
from slideframe_gs_torch.threads import one_torch_thread
from slideframe_gs_torch.training import Scene, train
from slideframe_gs_torch.views import TrainingView, load_views

if TYPE_CHECKING:
    from slideframe_gs_torch.reconstructor import TorchSplats

# A photograph shown in training that is so much less like the splats than the middle one, dB, has a false pose, or
# shows what the others don't.
OUTLIER_DB = 8.0


class Trained(NamedTuple):
    """A block's splats, those beyond it left out, the colour behind them, and how training went.

    `share_above` is the share of all splats trained that are above the anisotropy limit before they are exported.
    """

    splats: SplatCloud
    behind: tuple[float, float, float]
    share_above: float
    start_count: int
    iterations: int
    seconds: float
    curve: list[tuple[int, float, float]]


def train_site(options: "TorchSplats", survey: Survey, context: Context) -> SplatCloud:
    """Return the trained splats; figures say how they compare with photographs shown and held out.

    Raises:
        InputError: there are no photographs, or masks leave nothing of them.
    """
    if not survey.photographs:
        raise InputError(
            "the survey has no photographs", cure="give a folder with at least two overlapping photographs"
        )
    warn_of_few_points(survey, context)
    blocks = blocks_of(survey, options.blocks)
    with one_torch_thread():
        trained = [
            train_block(options, survey, block, number, context_of_block(context, number, len(blocks)))
            for number, block in enumerate(blocks)
        ]
        splats = merge([block.splats for block in trained])
        report_training(trained, splats, context)
        report_likeness(options, survey, splats, np.mean([block.behind for block in trained], axis=0), context)
    return splats


def train_block(options: "TorchSplats", survey: Survey, block: Block, number: int, context: Context) -> Trained:
    """Train on the photographs that see a block and keep what lies in it."""
    held_out, shown = split_photographs(block.photographs, options.hold_out_every)
    shelf = Shelf(context.scratch / "photographs", options.photographs_megabytes * 1_000_000)
    views = ShelvedViews(views_of(options, survey, shown, context), shelf)
    if not views:
        raise InputError(
            "nothing of any photograph is left to train on",
            where=", ".join(survey.photographs[index].name for index in shown[:3]),
            cure="look at the masks, which leave out all of them",
        )
    scene = Scene.of(options, survey if block.is_whole else survey_of(survey, block), views)
    measuring = ShelvedViews(views_of(options, survey, held_out, context), shelf)
    previews = Previews.of(options, measuring or views, scene.behind, number * options.iterations)
    state = train(options, scene, HeldOut(options, measuring, scene.behind), previews, context)
    if not block.is_whole:
        checkpoint.Writer(context).save(state)  # so that a run that breaks off in the next block finds this one done
    scales = state.parameters.raw["log_scales"].exp().numpy()
    return Trained(
        block.keep(state.parameters.export(options.anisotropy_limit)), scene.behind,
        share_above(scales, options.anisotropy_limit), state.start_count, state.iteration, state.seconds, state.curve,
    )  # fmt: skip


def views_of(
    options: "TorchSplats", survey: Survey, indices: Sequence[int], context: Context
) -> Iterator[TrainingView]:
    """Read photographs as the options ask for them, one by one."""
    return load_views(survey, indices, options.image_width, context, clear_sky=options.sky == "clear")


def split_photographs(indices: Sequence[int], hold_out_every: int) -> tuple[list[int], list[int]]:
    """Return the photographs held out, every n-th of the survey, and those shown; a single one is always shown."""
    if hold_out_every == 0 or len(indices) < 2:
        return [], list(indices)
    shown = [index for index in indices if index % hold_out_every]
    return (sorted(set(indices) - set(shown)), shown) if shown else ([], list(indices))


def context_of_block(context: Context, number: int, count: int) -> Context:
    """Return the context with a folder of the block's own, and its progress as a part of the whole."""
    if count == 1:
        return context
    folder = context.scratch / f"block-{number + 1}"
    folder.mkdir(exist_ok=True)

    def progress(done: float, total: float, figures: dict[str, float]) -> None:
        context.on_progress(number * total + done, count * total, figures)

    return replace(context, scratch=folder, on_progress=progress)


def report_training(trained: Sequence[Trained], splats: SplatCloud, context: Context) -> None:
    """Report what training took, summed over the blocks."""
    iterations, seconds = sum(block.iterations for block in trained), sum(block.seconds for block in trained)
    context.figure("share_above_anisotropy_limit", float(np.mean([block.share_above for block in trained])))
    context.figure("initial_splats", sum(block.start_count for block in trained))
    context.figure("splats", len(splats))
    context.figure("iterations", iterations)
    context.figure("iterations_per_second", iterations / max(seconds, 1e-9))
    if len(trained) > 1:
        context.figure("blocks", len(trained))
    elif trained[0].curve:
        curve = {f"{passed:.1f}": psnr for _, passed, psnr in trained[0].curve}
        context.figure("held_out_psnr_db_by_second", curve)


def report_likeness(
    options: "TorchSplats", survey: Survey, splats: SplatCloud, behind: Sequence[float], context: Context
) -> None:
    """Report how the splats resemble all photographs, held out and shown, one by one so that few are in memory."""
    red, green, blue = (float(level) for level in behind)
    held_out, shown = split_photographs(range(len(survey.photographs)), options.hold_out_every)
    found: dict[int, Likeness] = {}
    quiet = replace(context, warnings=[])
    for index in (*held_out, *shown):
        for view in views_of(options, survey, [index], quiet):
            found[index] = likeness(splats, view, (red, green, blue))
    report_held_out({survey.photographs[index].name: found[index] for index in held_out if index in found}, context)
    alike = {survey.photographs[index].name: found[index].psnr for index in shown if index in found}
    context.figure("shown_psnr_db", float(np.mean(list(alike.values()))))
    middle = float(np.median(list(alike.values())))
    for name, psnr in sorted(alike.items(), key=lambda one: one[1]):
        if psnr < middle - OUTLIER_DB:
            context.warn(
                f"{name} is {middle - psnr:.0f} dB less like the splats than the other photographs, though it was "
                "shown in training: its pose may be false, or it shows what the others don't"
            )
