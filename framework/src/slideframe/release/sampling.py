"""Values of a raster at points of the local frame."""

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import ConfigurationError
from slideframe.formats.rasters import Raster
from slideframe.problem import MapHeights
from slideframe.products import Georeference
from slideframe.release.coordinates import local_points, map_points


def sample_heights(
    raster: Raster, given: MapHeights, points: Float64Array, georeference: Georeference, where: str
) -> Float64Array:
    """Return a height model's values at points (point, 3), as heights in the local frame, m; NaN where it has none.

    Raises:
        ConfigurationError: it has no value at any of the points, or its coordinates can't be what they are said to be.
        InputError, MissingDependency: as `to_local`.
    """
    epsg = raster.epsg if given.epsg is None else given.epsg
    values, on_map = _sample(raster, given, points, georeference, where)
    if epsg is not None:
        there = np.isfinite(values)
        moved = np.column_stack([on_map[there, :2], values[there]])
        resolved = given.model_copy(update={"epsg": epsg})
        values[there] = local_points(moved, resolved, georeference, where)[:, 2]
    return values


def sample_values(
    raster: Raster, given: MapHeights, points: Float64Array, georeference: Georeference, where: str
) -> Float64Array:
    """Return a raster's values at points (point, 3) as they are, such as depths. Raises as `sample_heights`."""
    return _sample(raster, given, points, georeference, where)[0]


def _sample(
    raster: Raster, given: MapHeights, points: Float64Array, georeference: Georeference, where: str
) -> tuple[Float64Array, Float64Array]:
    """Return values (point,) and the points on the raster's map (point, 3)."""
    epsg = raster.epsg if given.epsg is None else given.epsg
    on_map = map_points(points, epsg, given, georeference, where)
    values = raster.sample(on_map[:, 0], on_map[:, 1])
    _require_cover(raster, values, on_map, epsg, where)
    return values, on_map


def _require_cover(raster: Raster, values: Float64Array, places: Float64Array, epsg: int | None, where: str) -> None:
    if np.isfinite(values).any():
        return
    west, south, east, north = raster.bounds
    (x, y), (swapped_x, swapped_y) = np.median(places[:, :2], axis=0), np.median(places[:, 1::-1], axis=0)
    swapped = west <= swapped_x <= east and south <= swapped_y <= north
    system = f"EPSG:{epsg}" if epsg else "the local frame, since neither the file nor epsg names another"
    raise ConfigurationError(
        f"the raster has no value over the region, which is at ({_shown(x)}, {_shown(y)}) in {system}; it covers "
        f"x {_shown(west)} to {_shown(east)}, y {_shown(south)} to {_shown(north)}"
        + ("; its axes are swapped" if swapped else ""),
        where=where,
        cure="write eastings along x" if swapped else "check the region and the raster's coordinate system (epsg)",
    )


def _shown(coordinate: float) -> str:
    """Write metres to the millimetre or degrees to the metre, without idle zeros."""
    return f"{round(float(coordinate), 5):.9g}"
