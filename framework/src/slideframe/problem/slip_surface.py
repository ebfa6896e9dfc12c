"""The slip surface: what the moving mass rests on."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, Tag

from slideframe.problem.base import ProblemModel, Vector, kind_or


class MapHeights(ProblemModel):
    """Coordinates and heights that may be a map's."""

    epsg: int | None = Field(
        default=None, description="EPSG code of the coordinates; none: the file's own, else the local frame"
    )
    vertical_epsg: int | None = Field(
        default=None, description="EPSG code of the level of heights; none: that of `epsg`, else the WGS84 ellipsoid"
    )
    geoid_offset: float | None = Field(default=None, description="height of that level above the WGS84 ellipsoid, m")


class FlatBase(ProblemModel):
    """A level base, as in the paper."""

    kind: Literal["flat"] = "flat"
    z_min: float = Field(description="m")


class DepthBase(ProblemModel):
    """The same depth everywhere below the ground."""

    kind: Literal["constant_depth"] = "constant_depth"
    depth: float = Field(gt=0, description="vertical, m")


class PlaneBase(MapHeights):
    """The plane through three points, or nearest to more."""

    kind: Literal["plane"] = "plane"
    points: tuple[Vector, ...] = Field(min_length=3, description="x, y, z of each, m")


class EllipsoidBase(MapHeights):
    """The lower half of an upright ellipsoid through given points, or nearest to them."""

    kind: Literal["ellipsoid"] = "ellipsoid"
    points: tuple[Vector, ...] = Field(min_length=4, description="x, y, z, m; 4 or more with axis_ratio, else 7")
    axis_ratio: tuple[float, float, float] | None = Field(
        default=None,
        description="lengths along azimuth, across and upright, such as [2, 1, 1]; [1, 1, 1]: a sphere; none: fitted",
    )
    azimuth: float = Field(default=0.0, description="compass direction of the first axis, degrees, with axis_ratio")


class SlblBase(ProblemModel):
    """Sloping local base level: the ground replaced by a bowl of constant curvature that hangs from the outline."""

    kind: Literal["slbl"] = "slbl"
    maximum_depth: float = Field(gt=0, description="greatest vertical depth below the ground, m")


class RasterBase(MapHeights):
    """Heights of the slip surface, or depths of it below the ground, from a GeoTIFF or an ESRI ASCII grid."""

    kind: Literal["raster"] = "raster"
    path: Path
    quantity: Literal["height", "depth"] = Field(
        default="height", description="height: of the surface, m; depth: below the ground, m, whatever the sign"
    )


class MeshBase(MapHeights):
    """A surface of triangles from a PLY, OBJ, STL or OFF file."""

    kind: Literal["mesh"] = "mesh"
    path: Path


class EarlierGroundBase(MapHeights):
    """The ground as it was before: what has come on it since moves. A GeoTIFF or an ESRI ASCII grid."""

    kind: Literal["earlier_ground"] = "earlier_ground"
    path: Path
    align: bool = Field(
        default=True, description="shift it to the scan's level by the median difference outside the region"
    )
    least_thickness: float = Field(default=0.2, ge=0, description="thinner differences are noise and stay, m")


SlipSurface = Annotated[
    Annotated[FlatBase, Tag("flat")]
    | Annotated[DepthBase, Tag("constant_depth")]
    | Annotated[PlaneBase, Tag("plane")]
    | Annotated[EllipsoidBase, Tag("ellipsoid")]
    | Annotated[SlblBase, Tag("slbl")]
    | Annotated[RasterBase, Tag("raster")]
    | Annotated[MeshBase, Tag("mesh")]
    | Annotated[EarlierGroundBase, Tag("earlier_ground")],
    kind_or("flat"),
    Field(description="slip surface: what the moving mass rests on"),
]
