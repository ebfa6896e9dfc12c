"""Where the moving mass is."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, Tag, model_validator

from slideframe.problem.base import ProblemModel, kind_or
from slideframe.problem.slip_surface import FlatBase, MapHeights, SlipSurface

Corner = tuple[float, float]


class BoxRegion(ProblemModel):
    """The box that holds the moving mass; the ground surface closes it above."""

    kind: Literal["box"] = "box"
    x_min: float = Field(description="west side, m")
    x_max: float = Field(description="east side, m")
    y_min: float = Field(description="south side, m")
    y_max: float = Field(description="north side, m")
    z_min: float | None = Field(default=None, description="flat base, m; none: see base")
    base: SlipSurface | None = None

    @model_validator(mode="after")
    def _sides_in_order(self) -> "BoxRegion":
        for low, high in (("x_min", "x_max"), ("y_min", "y_max")):
            if not getattr(self, low) < getattr(self, high):
                raise ValueError(f"{low} must be less than {high}")
        if (self.z_min is None) == (self.base is None):
            raise ValueError("give z_min for a flat base, or a table base for any other, and not both")
        return self

    @property
    def slip_surface(self) -> SlipSurface:
        """What the mass rests on."""
        if self.base is None:
            assert self.z_min is not None
            return FlatBase(z_min=self.z_min)
        return self.base

    @property
    def plan_size(self) -> tuple[float, float] | None:
        """Width and depth of the plan, m; none where only the survey can tell."""
        return self.x_max - self.x_min, self.y_max - self.y_min


class PolygonRegion(ProblemModel):
    """An area with holes in it, down to the slip surface; the ground surface closes it above."""

    kind: Literal["polygon"] = "polygon"
    corners: tuple[Corner, ...] = Field(default=(), description="x, y of the outline's corners, m; or give path")
    holes: tuple[tuple[Corner, ...], ...] = Field(default=(), description="x, y of the corners of each hole, m")
    path: Path | None = Field(default=None, description="GeoJSON, GeoPackage or Shapefile with the polygons instead")
    layer: str | None = Field(default=None, description="layer of that file; none: its first")
    epsg: int | None = Field(
        default=None, description="EPSG code of the coordinates; none: the file's own, and the local frame for corners"
    )
    base: SlipSurface

    @model_validator(mode="after")
    def _one_outline(self) -> "PolygonRegion":
        if bool(self.corners) == (self.path is not None):
            raise ValueError("give corners or path, and not both")
        if self.path is not None and self.holes:
            raise ValueError("holes belong to corners; a file has its own")
        if self.corners:
            self._require_sound()
        return self

    def _require_sound(self) -> None:
        from slideframe.problem.outline import fault_of

        if fault := fault_of(self.corners, self.holes):
            raise ValueError(f"the outline {fault}")

    @property
    def slip_surface(self) -> SlipSurface:
        """What the mass rests on."""
        return self.base

    @property
    def plan_size(self) -> tuple[float, float] | None:
        """Width and depth of the plan, m; none where only the survey can tell."""
        if not self.corners or self.epsg is not None:
            return None
        x, y = zip(*self.corners, strict=True)
        return max(x) - min(x), max(y) - min(y)


class MeshRegion(MapHeights):
    """A closed surface of triangles from a PLY, OBJ, STL or OFF file: what soil is in it moves."""

    kind: Literal["mesh"] = "mesh"
    path: Path

    @property
    def plan_size(self) -> tuple[float, float] | None:
        """None: only the file can tell."""
        return None


Region = Annotated[
    Annotated[BoxRegion, Tag("box")] | Annotated[PolygonRegion, Tag("polygon")] | Annotated[MeshRegion, Tag("mesh")],
    kind_or("box"),
    Field(description="where the moving mass is"),
]


class FillingProblem(ProblemModel):
    """What a volume filler is asked for."""

    region: Region
    particle_spacing: float = Field(gt=0, description="m")
