"""The kit must be able to fail: renderers with one fault each, and the check that finds it."""

import pytest

from slideframe.problem import OrbitView
from slideframe.products import SplatCloud
from slideframe.testing import checks_for
from slideframe_render_gs.renderer import SplatRenderer


class Altered(SplatRenderer):
    """The renderer with its inputs or its pictures altered."""

    def filling(self, filling):
        return filling

    def view(self, view):
        return view

    def render(self, survey, splats, filling, motion, view, context):
        return super().render(survey, splats, self.filling(filling), motion, self.view(view), context)


class OrbitsOnly(Altered):
    def view(self, view):
        return OrbitView(width=view.width, height=view.height, maps=view.maps)


class GivesNoMaps(Altered):
    def view(self, view):
        return view.model_copy(update={"maps": ()})


class LeavesTheScarOut(Altered):
    def filling(self, filling):
        return filling.model_copy(update={"scar": SplatCloud.empty()})


class ShowsTheScarThroughTheGround(Altered):
    def render(self, survey, splats, filling, motion, view, context):
        scar = filling.scar.model_copy(update={"centers": filling.scar.centers + 9})
        yield from super().render(survey, splats, filling.model_copy(update={"scar": scar}), motion, view, context)


class GoesOnFromTheWrongPicture(Altered):
    def render(self, survey, splats, filling, motion, view, context):
        pictures = list(super().render(survey, splats, filling, motion, view, context))
        yield from pictures[::-1]


@pytest.mark.parametrize(
    ("stage", "check_name"),
    [
        (OrbitsOnly(), "every_kind_of_view"),
        (GivesNoMaps(), "maps_are_what_they_say"),
        (OrbitsOnly(), "maps_are_what_they_say"),
        (LeavesTheScarOut(), "the_scar_is_seen_once_it_is_bare"),
        (ShowsTheScarThroughTheGround(), "the_scar_is_seen_once_it_is_bare"),
        (GoesOnFromTheWrongPicture(), "a_film_that_broke_off_goes_on"),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_each_fault_is_found(stage, check_name):
    (check,) = [check for check in checks_for(stage) if check.name == check_name]
    with pytest.raises((AssertionError, ValueError)):
        check()
