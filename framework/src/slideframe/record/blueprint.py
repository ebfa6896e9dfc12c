"""How the viewer lays a recording out."""

from collections.abc import Callable
from typing import NamedTuple

import rerun.blueprint as rrb

SURVEY_MAPS = ("cameras", "overlap", "angles", "distances", "residuals")
DIFFERENCE = "volume/difference"
SOIL = {"plastic_strain": "Plastic strain", "pressure": "Pressure", "deviatoric_stress": "Deviatoric stress"}


class Eye(NamedTuple):
    """A place in the local frame, m, and what is looked at from there."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]


def blueprint(
    eye: Eye | None, active_tab: int = 0, compared: bool = False, stressed: bool = False, pictured: bool = False
) -> rrb.Blueprint:
    """Lay out the motion with film, map and plots, then the scan, the survey's quality, the volume, the report.

    With `compared`, the volume has a map of its surface's difference to a reference ground; with `stressed`, particles
    are shown by plastic strain and stress too; with `pictured`, the scan has pictures of how it came about.
    """
    controls = rrb.EyeControls3D(position=eye.position, look_target=eye.target, eye_up=(0, 0, 1)) if eye else None

    def space(name: str, *contents: str) -> rrb.Spatial3DView:
        return rrb.Spatial3DView(origin="/", contents=list(contents), name=name, eye_controls=controls)

    soil = [space(title, f"/soil/{name}", "/boundary/**") for name, title in SOIL.items()] if stressed else []
    return rrb.Blueprint(
        rrb.Tabs(
            _motion(space("Motion", "/motion/splats", "/boundary/**")),
            rrb.Tabs(
                space("Splats", "/survey/points", "/survey/cameras/**", "/reconstruction/**"),
                *([rrb.Spatial2DView(origin="/training", name="Training")] if pictured else []),
                name="Scan",
            ),
            rrb.Grid(
                *(rrb.Spatial2DView(origin=f"/survey/maps/{name}", name=name.capitalize()) for name in SURVEY_MAPS),
                name="Survey",
            ),
            _volume(space, compared),
            rrb.Tabs(space("Travel", "/motion/particles", "/boundary/**"), *soil, name="Particles"),
            rrb.Horizontal(
                rrb.TextDocumentView(origin="/report/result", name="Result"),
                rrb.TextDocumentView(origin="/report/config", name="Configuration"),
                name="Report",
            ),
            active_tab=active_tab,
        ),
        rrb.TimePanel(timeline="sim_time", play_state="paused", state="collapsed"),
        collapse_panels=True,
    )


def _volume(space: Callable[..., rrb.Spatial3DView], compared: bool) -> rrb.Horizontal:
    """Put the soil's surface, slip surface, depth and origin beside a section and numbers."""
    difference = [rrb.Spatial2DView(origin=f"/{DIFFERENCE}", name="Off the reference")] if compared else []
    return rrb.Horizontal(
        rrb.Tabs(
            space("Surface", "/volume/surface", "/volume/outline"),
            space("Slip surface", "/volume/slip_surface", "/volume/outline"),
            space("Depth", "/volume/by_depth", "/volume/outline"),
            space("Observed and inferred", "/volume/by_origin", "/volume/outline"),
            *difference,
        ),
        rrb.Vertical(
            rrb.Spatial2DView(origin="/volume/section", name="Section"),
            rrb.TextDocumentView(origin="/volume/numbers", name="Numbers"),
        ),
        column_shares=[3, 2],
        name="Volume",
    )


def _motion(moving: rrb.Spatial3DView) -> rrb.Horizontal:
    """Put the moving splats beside the film, the map of thickness and the plots."""
    plots = [
        rrb.TimeSeriesView(origin=f"/figures/{name}", name=title)
        for name, title in (
            ("energy", "Energy, J"),
            ("mass", "Mass in motion, kg"),
            ("travel", "Way, m"),
            ("volume", "Volume outside the source, m³"),
        )
    ]
    return rrb.Horizontal(
        moving,
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial2DView(origin="/film", name="Film"),
                rrb.Spatial2DView(origin="/map/thickness", name="Thickness of the soil"),
                column_shares=[3, 2],
            ),
            rrb.Grid(*plots, grid_columns=2),
            row_shares=[2, 3],
        ),
        column_shares=[1, 1],
        name="Motion",
    )
