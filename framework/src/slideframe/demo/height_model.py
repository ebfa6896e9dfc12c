"""The demo's true heights as any other height model: a file of longitude, latitude and ellipsoidal height."""

from pathlib import Path

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.demo.grid import GroundGrid
from slideframe.geodesy import enu_from_geodetic, geodetic_from_enu
from slideframe.products import Georeference

NODATA = -9999.0


def write_height_model(
    path: Path, x: Float64Array, y: Float64Array, heights: Float32Array, origin: Georeference
) -> None:
    """Write an ESRI ASCII grid in WGS84 degrees (EPSG:4326), heights above the ellipsoid, m.

    Args:
        path: of the file.
        x: evenly spaced eastings (column,), m.
        y: northings (row,), m, spaced alike.
        heights: (row, column), m up of the origin.
        origin: of the frame.
    """
    level = float(heights.mean())
    ends = geodetic_from_enu(np.array([[x[0], y[0], level], [x[-1], y[-1], level]]), origin)
    (south, north), (west, east) = ends[:, 0], ends[:, 1]
    cell = (north - south) / (len(y) - 1)
    columns, rows = int((east - west) / cell) + 1, len(y)
    latitude = np.repeat(north - cell * np.arange(rows), columns)
    longitude = np.tile(west + cell * np.arange(columns), rows)
    found = _heights_at(latitude, longitude, x, y, heights, origin).reshape(rows, columns)
    header = {
        "ncols": columns,
        "nrows": rows,
        "xllcenter": repr(float(west)),
        "yllcenter": repr(float(north - cell * (rows - 1))),
        "cellsize": repr(float(cell)),
        "NODATA_value": NODATA,
    }
    with path.open("w", encoding="ascii") as stream:
        stream.writelines(f"{name} {value}\n" for name, value in header.items())
        np.savetxt(stream, found, fmt="%.3f")


def _heights_at(
    latitude: Float64Array,
    longitude: Float64Array,
    x: Float64Array,
    y: Float64Array,
    heights: Float32Array,
    origin: Georeference,
) -> Float64Array:
    """Return the ellipsoidal heights of the ground at places (place,), m.

    The ellipsoid's normal leans by 1e-5 against the frame's up 80 m from the origin, so that a second pass is exact.
    """
    grid = GroundGrid(float(x[1] - x[0]), len(x))
    middle = np.array([(x[0] + x[-1]) / 2, (y[0] + y[-1]) / 2])
    level = np.full(len(latitude), origin.ellipsoidal_height + float(heights.mean()))
    for _ in range(2):
        place = enu_from_geodetic(np.column_stack([latitude, longitude, level]), origin)
        east, north = (place[:, :2] - middle).T.astype(np.float32)
        place[:, 2] = grid.lookup(heights, east, north)
        level = geodetic_from_enu(place, origin)[:, 2]
    return level
