"""Heights on a regular grid from GeoTIFF (needs rasterio) and ESRI ASCII files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError, MissingDependency

ASCII_SUFFIXES = (".asc", ".agr", ".grd")


@dataclass(frozen=True)
class Raster:
    """Values at the middles of cells, the first row in the north.

    Attributes:
        values: (row, column); NaN where there is none.
        west: easting of the outer edge, in the units of its coordinate system.
        north: northing of the outer edge.
        cell: width and height of a cell.
        epsg: code of its coordinate system; None: the file doesn't say.
    """

    values: Float64Array
    west: float
    north: float
    cell: tuple[float, float]
    epsg: int | None

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        rows, columns = self.values.shape
        return self.west, self.north - rows * self.cell[1], self.west + columns * self.cell[0], self.north

    def sample(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Interpolate between the middles of cells (point,); NaN outside and in cells without a value.

        Beside a cell without a value, the others count for it, so that what is known reaches to the cell's edge.
        """
        rows, columns = self.values.shape
        column, row = (x - self.west) / self.cell[0] - 0.5, (self.north - y) / self.cell[1] - 0.5
        inside = (column >= -0.5) & (column <= columns - 0.5) & (row >= -0.5) & (row <= rows - 0.5)
        column = np.where(inside, np.clip(column, 0, columns - 1), 0)
        row = np.where(inside, np.clip(row, 0, rows - 1), 0)
        left, top = np.floor(column).astype(int), np.floor(row).astype(int)
        right, low = np.minimum(left + 1, columns - 1), np.minimum(top + 1, rows - 1)
        east, south = column - left, row - top
        total, weights = np.zeros(column.shape), np.zeros(column.shape)
        for i, down in ((top, 1 - south), (low, south)):
            for j, along in ((left, 1 - east), (right, east)):
                value = self.values[i, j]
                weight = np.where(np.isfinite(value), down * along, 0.0)
                total += weight * np.nan_to_num(value)
                weights += weight
        own = self.values[np.rint(row).astype(int), np.rint(column).astype(int)]
        return np.where(inside & np.isfinite(own), total / np.maximum(weights, 1e-12), np.nan)


def read_raster(path: Path) -> Raster:
    """Read the first band of a raster.

    Raises:
        InputError: the file can't be read, is turned against the axes, or holds no value.
        MissingDependency: it isn't ESRI ASCII and rasterio isn't installed.
    """
    try:
        raster = _read_ascii(path) if path.suffix.lower() in ASCII_SUFFIXES else _read_with_rasterio(path)
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"the raster can't be read: {error}", where=str(path), cure="give a GeoTIFF or an ESRI ASCII grid"
        ) from error
    if not np.isfinite(raster.values).any():
        raise InputError("the raster holds no value, only nodata", where=str(path), cure="give another file")
    return raster


def _read_ascii(path: Path) -> Raster:
    with path.open(encoding="ascii") as stream:
        header = {}
        while True:
            start = stream.tell()
            words = stream.readline().split()
            if len(words) != 2 or not words[0][0].isalpha():
                break
            header[words[0].lower()] = float(words[1])
        stream.seek(start)
        numbers = np.loadtxt(stream, ndmin=1).reshape(-1)
    rows, columns = int(header["nrows"]), int(header["ncols"])
    if numbers.size != rows * columns:
        raise ValueError(f"{numbers.size} values for {rows} rows of {columns}")
    values = numbers.reshape(rows, columns)
    values[values == header.get("nodata_value", -9999.0)] = np.nan
    cell = header["cellsize"]
    west = header["xllcorner"] if "xllcorner" in header else header["xllcenter"] - cell / 2
    south = header["yllcorner"] if "yllcorner" in header else header["yllcenter"] - cell / 2
    return Raster(values, west, south + rows * cell, (cell, cell), _epsg_beside(path))


def _read_with_rasterio(path: Path) -> Raster:
    try:
        import rasterio
    except ImportError as error:
        raise MissingDependency(
            "GeoTIFF files need rasterio", where=str(path), cure="pip install 'slideframe[geo]', or give ESRI ASCII"
        ) from error
    try:
        with rasterio.open(path) as source:
            values = source.read(1, masked=True).astype(np.float64).filled(np.nan)
            transform, crs = source.transform, source.crs
    except rasterio.errors.RasterioError as error:
        raise ValueError(str(error)) from error
    if transform.b or transform.d or transform.a <= 0 or transform.e >= 0:
        raise ValueError("its rows don't run from west to east, the first in the north: warp it first")
    return Raster(values, transform.c, transform.f, (transform.a, -transform.e), crs.to_epsg() if crs else None)


def _epsg_beside(path: Path) -> int | None:
    """Return the code of the .prj file that stands beside an ASCII grid."""
    beside = path.with_suffix(".prj")
    if not beside.is_file():
        return None
    from slideframe.georeferencing import epsg_of

    return epsg_of(beside.read_text(encoding="utf-8"))
