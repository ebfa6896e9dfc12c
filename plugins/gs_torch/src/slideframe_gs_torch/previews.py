"""Pictures of how training comes along, for the recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import torch

from slideframe.stages import Context
from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.evaluation import draw_view
from slideframe_gs_torch.views import TrainingView

if TYPE_CHECKING:
    from slideframe_gs_torch.reconstructor import TorchSplats

# px, about: wide enough to tell grass from gravel; a picture takes some 150 kB.
WIDTH = 480


@dataclass(frozen=True)
class Previews:
    """Draws a view beside its photograph, so many times, evenly over the iterations.

    Attributes:
        options: of the training.
        view: the one that is drawn.
        behind: sRGB, 0 to 1, where no splat is.
        first: the iteration of the whole site's training that this one begins with.
    """

    options: "TorchSplats"
    view: TrainingView
    behind: tuple[float, float, float]
    first: int

    @classmethod
    def of(
        cls, options: "TorchSplats", views: Sequence[TrainingView], behind: tuple[float, float, float], first: int
    ) -> Self:
        """Choose the middle one of the views: the first of a flight lies at its corner."""
        view = views[len(views) // 2]
        return cls(options, view.reduced(max(1, round(view.camera.width / WIDTH))), behind, first)

    def show_if_due(self, state: State, context: Context) -> None:
        """Draw where one of the equal parts of the iterations has ended."""
        if self._parts_done(state.iteration) > self._parts_done(state.iteration - 1):
            self._show(state, context)

    def show_last(self, state: State, context: Context) -> None:
        """Draw what training came to, where it ended within a part."""
        if self.options.previews and self._parts_done(state.iteration) == self._parts_done(state.iteration - 1):
            self._show(state, context)

    def _parts_done(self, iteration: int) -> int:
        return iteration * self.options.previews // self.options.iterations

    def _show(self, state: State, context: Context) -> None:
        """Draw the splats as they would now be exported, to the right of the photograph."""
        drawn = draw_view(state.parameters.export(self.options.anisotropy_limit), self.view, self.behind)
        both = torch.cat([self.view.truth, drawn], dim=2).mul_(255).round_().to(torch.uint8)
        context.show(self.view.name, self.first + state.iteration, both.permute(1, 2, 0).contiguous().numpy())
