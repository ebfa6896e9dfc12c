"""Ground known from elsewhere, to judge the scan by."""

from pathlib import Path

from pydantic import Field

from slideframe.problem.slip_surface import MapHeights


class ReferenceGround(MapHeights):
    """A height model of the same ground, such as lidar: the scan's surface is compared with it, never changed by it."""

    path: Path = Field(description="GeoTIFF or ESRI ASCII grid of heights")
