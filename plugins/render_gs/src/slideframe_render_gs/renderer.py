"""The renderer stage; its backend is imported only when it computes."""

from collections.abc import Iterable, Iterator
from typing import ClassVar

from slideframe.problem import View
from slideframe.products import Filling, ParticleFrame, Picture, SplatCloud, Survey
from slideframe.stages import Context, Renderer


class SplatRenderer(Renderer):
    """Draws the splats, moved by the particles that carry them, with the rasteriser they were trained with."""

    name: ClassVar[str] = "render_gs"
    backend: ClassVar[tuple[str, ...]] = ("torch", "numba", "slideframe_gs_torch")

    def render(
        self,
        survey: Survey,
        splats: SplatCloud,
        filling: Filling,
        motion: Iterable[ParticleFrame],
        view: View,
        context: Context,
    ) -> Iterator[Picture]:
        """Yield one picture per frame of the motion, in order, reading each frame once."""
        from slideframe_render_gs.film import pictures

        return pictures(survey, splats, filling, motion, view, context)
