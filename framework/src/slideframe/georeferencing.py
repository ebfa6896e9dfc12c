"""Between the local east-north-up frame and any coordinate system with an EPSG code, by PROJ.

Points are (point, 3) float64 in the order x, y, height: easting and northing, or longitude and latitude,
whatever order the system's own definition lists its axes in, and in its own units. Needs pyproj (extra
`georeferencing`). No transformation is ever approximated in silence: PROJ's ballpark operations, which leave a height
or a datum as it is when a grid is absent, are refused.
"""

import warnings
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from slideframe.arrays import Float64Array
from slideframe.errors import ConfigurationError, InputError, MissingDependency
from slideframe.geodesy import enu_from_geodetic, geodetic_from_enu
from slideframe.products import Georeference

if TYPE_CHECKING:
    from pyproj import CRS, Transformer

# PROJ inverts a datum shift at the wrong ellipsoid's height, which leaves up to some mm; each pass shrinks what is left
# of it ten-thousandfold and more, so that three reach rounding.
INVERSE_PASSES = 3
FARTHEST = 10_000.0  # m; a point farther from the survey's origin is a mistaken code or swapped axes
AREA_MARGIN = 0.5  # degrees around a system's area of use, which EPSG states coarsely

Bounds = tuple[float, float, float, float]


class Heights(BaseModel):
    """The level that heights are measured from; without any field, the WGS84 ellipsoid.

    Ellipsoidal height = height + geoid undulation. The undulation is a constant (`geoid_offset`), or taken from a
    grid file (`geoid_grid`), or from the grid that PROJ knows for the vertical system `epsg`, where that is installed.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    epsg: int | None = Field(default=None, description="EPSG code of the vertical system, such as 5738 for HKPD")
    geoid_offset: float | None = Field(default=None, description="height of the level above the ellipsoid, m")
    geoid_grid: Path | None = Field(default=None, description="grid of such heights that PROJ reads: .tif, .gtx, .byn")

    @model_validator(mode="after")
    def _one_undulation(self) -> "Heights":
        if self.geoid_offset is not None and self.geoid_grid is not None:
            raise ValueError("give geoid_offset or geoid_grid, not both")
        return self

    @property
    def ellipsoidal(self) -> bool:
        """Whether heights are above the WGS84 ellipsoid."""
        return self.epsg is None and not self.undulation_given

    @property
    def undulation_given(self) -> bool:
        """Whether the user says how the level lies, so that PROJ needn't know."""
        return self.geoid_offset is not None or self.geoid_grid is not None


ELLIPSOIDAL = Heights()


def to_local(
    points: Float64Array, epsg: int, georeference: Georeference, vertical: Heights = ELLIPSOIDAL
) -> Float64Array:
    """Return metres east, north, up of the survey's origin of points in coordinate system `epsg`.

    Args:
        points: (point, 3) x, y, height in the system's units, or (point, 2), an outline without heights, which is
            taken to lie at the origin's height: 100 m of error in it moves a point 1 km away by 2 cm.
        epsg: a projected or geographic system (4326: longitude, latitude), or one with a vertical part.
        georeference: the survey's origin.
        vertical: what the heights are measured from; not for codes with a vertical part of their own.

    Returns:
        (point, 3), or (point, 2) for outlines, m.

    Raises:
        ConfigurationError: PROJ doesn't know a code, or it can't be used so.
        MissingDependency: pyproj or a grid isn't installed; the grid is named.
        InputError: points lie outside the system's area or absurdly far from the survey.
    """
    points = np.asarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points must be (point, 2) or (point, 3), not {points.shape}")
    outline = points.shape[1] == 2
    if outline:
        points, vertical = np.column_stack([points, np.full(len(points), georeference.ellipsoidal_height)]), ELLIPSOIDAL
    geodetic = to_geodetic(points, epsg, vertical)
    if outline:
        geodetic[:, 2] = georeference.ellipsoidal_height
    local = enu_from_geodetic(geodetic, georeference)
    distance = np.linalg.norm(local, axis=1)
    if len(local) and distance.max() > FARTHEST:
        raise InputError(
            f"a point at {tuple(points[distance.argmax()].tolist())} in EPSG:{epsg} lies {distance.max() / 1000:.0f} km"
            f" from the survey, at {georeference.latitude:.5f} N, {georeference.longitude:.5f} E",
            cure="check the EPSG code, and that x (easting or longitude) stands before y (northing or latitude)",
        )
    return local[:, :2] if outline else local


def from_local(
    points: Float64Array, epsg: int, georeference: Georeference, vertical: Heights = ELLIPSOIDAL
) -> Float64Array:
    """Return x, y and height in coordinate system `epsg` of (point, 3) metres east, north, up of the survey's origin.

    The inverse of `to_local`, to within a tenth of a millimetre, with the same arguments and errors.
    """
    return from_geodetic(geodetic_from_enu(np.asarray(points, np.float64), georeference), epsg, vertical)


def from_geodetic(geodetic: Float64Array, epsg: int, vertical: Heights = ELLIPSOIDAL) -> Float64Array:
    """Return (point, 3) x, y, height in system `epsg` of WGS84 latitude, longitude (degrees), ellipsoidal height (m).

    Raises:
        ConfigurationError, MissingDependency, InputError: as `to_local`.
    """
    geodetic = np.asarray(geodetic, np.float64)
    crs = _system(epsg, vertical)
    if not len(geodetic):
        return np.zeros((0, 3))
    _require_inside(crs, geodetic)
    return _Conversion(crs, vertical, _bounds(geodetic)).forward(geodetic)


def to_geodetic(points: Float64Array, epsg: int, vertical: Heights = ELLIPSOIDAL) -> Float64Array:
    """Return WGS84 latitude, longitude (degrees) and ellipsoidal height (m), (point, 3), of x, y, height in `epsg`.

    Raises:
        ConfigurationError, MissingDependency, InputError: as `to_local`.
    """
    points = np.asarray(points, np.float64)
    crs = _system(epsg, vertical)
    if not len(points):
        return np.zeros((0, 3))
    somewhere = crs.area_of_use.bounds if crs.area_of_use else (-180.0, -90.0, 180.0, 90.0)
    geodetic = _Conversion(crs, vertical, somewhere).backward(points)
    _require_inside(crs, geodetic)
    return _Conversion(crs, vertical, _bounds(geodetic)).inverse(points)


def require_projected(epsg: int, vertical: Heights = ELLIPSOIDAL) -> None:
    """Raise now what a conversion to a projected `epsg` would raise later, as far as that doesn't depend on the place.

    Raises:
        ConfigurationError, MissingDependency: as `to_local`; or the system has degrees.
    """
    if not _system(epsg, vertical).is_projected:
        raise ConfigurationError(
            f"EPSG:{epsg} has no eastings and northings", cure="give a projected system, such as 2326 or a UTM zone"
        )


def stated_accuracy(epsg: int, georeference: Georeference, vertical: Heights = ELLIPSOIDAL) -> float | None:
    """Return the accuracy in m that EPSG states for the transformation from WGS84 at the survey; None: not stated.

    The undulation that a user gives isn't part of it.
    """
    crs = _system(epsg, vertical)
    place = np.array([[georeference.latitude, georeference.longitude, georeference.ellipsoidal_height]])
    _require_inside(crs, place)
    accuracy = _operation(crs, _bounds(place)).accuracy
    return None if accuracy is None or accuracy < 0 else float(accuracy)


def undulation(vertical: Heights, latitude: Float64Array, longitude: Float64Array) -> Float64Array:
    """Return how far the level that the user describes lies above the ellipsoid at each place, m.

    Raises:
        InputError: the grid can't be read, or doesn't cover the places.
    """
    if vertical.geoid_grid is None:
        return np.full(np.shape(latitude), vertical.geoid_offset or 0.0)
    pyproj = _pyproj()
    grid = str(vertical.geoid_grid)
    try:
        shift = pyproj.Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
            f' +step +proj=vgridshift +grids="{grid}" +multiplier=1'
        )
        _, _, offset = shift.transform(longitude, latitude, np.zeros_like(latitude), errcheck=True)
    except pyproj.exceptions.ProjError as error:
        raise InputError(
            "the geoid grid can't be used: it's unreadable, or doesn't cover the site",
            where=grid,
            cure="give a grid of undulations that PROJ reads and that covers the site, or geoid_offset",
        ) from error
    return np.asarray(offset, np.float64)


def epsg_of(definition: str) -> int | None:
    """Return the EPSG code of a system given as WKT, PROJ string or code; None: it has none."""
    pyproj = _pyproj()
    try:
        code = pyproj.CRS.from_user_input(definition).to_epsg()
    except pyproj.exceptions.CRSError as error:
        raise InputError(
            f"'{definition[:60]}' isn't a coordinate system", cure="give its EPSG code in the config"
        ) from error
    return None if code is None else int(code)


class _Conversion:
    """From WGS84 to one system and back, by the operation that is best within some bounds."""

    def __init__(self, crs: "CRS", vertical: Heights, bounds: Bounds) -> None:
        self._operation = _operation(crs, bounds)
        self._vertical = vertical

    def forward(self, geodetic: Float64Array) -> Float64Array:
        """Return (point, 3) x, y, height."""
        latitude, longitude, height = geodetic.T
        x, y, z = self._operation.transform(longitude, latitude, height)
        if self._vertical.undulation_given:
            z = height - undulation(self._vertical, latitude, longitude)
        return self._finite(np.column_stack([x, y, z]))

    def backward(self, points: Float64Array) -> Float64Array:
        """Return (point, 3) latitude, longitude, height, inverted as PROJ does it: to some millimetres."""
        x, y, z = points.T
        longitude, latitude, height = self._operation.transform(x, y, z, direction="INVERSE")
        self._finite(np.column_stack([latitude, longitude, height]))
        if self._vertical.undulation_given:
            height = z + undulation(self._vertical, latitude, longitude)
        return np.column_stack([latitude, longitude, height])

    def inverse(self, points: Float64Array) -> Float64Array:
        """Return (point, 3) latitude, longitude, height, to rounding."""
        first = geodetic = self.backward(points)
        for _ in range(INVERSE_PASSES):
            geodetic = geodetic + first - self.backward(self.forward(geodetic))
        return geodetic

    def _finite(self, converted: Float64Array) -> Float64Array:
        bad = int((~np.isfinite(converted)).any(axis=1).sum())
        if bad:
            raise InputError(
                f"{bad} of {len(converted)} points lie outside what '{self._operation.description}' covers",
                cure="check the EPSG code and the order of the coordinates, or choose a system made for the site",
            )
        return converted


def _operation(crs: "CRS", bounds: Bounds) -> "Transformer":
    """Return PROJ's best transformation from WGS84 (EPSG:4979) whose grids are installed, never a ballpark one."""
    from pyproj.aoi import AreaOfInterest
    from pyproj.datadir import get_data_dir
    from pyproj.transformer import TransformerGroup

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that a better one lacks its grid: `stated_accuracy` tells
        group = TransformerGroup(
            4979,
            crs,
            always_xy=True,
            area_of_interest=AreaOfInterest(*bounds),  # type: ignore[arg-type]  # pyproj's own stub errs
            allow_ballpark=False,
        )
    if group.transformers:
        return group.transformers[0]
    grids = sorted({grid.short_name for operation in group.unavailable_operations for grid in operation.grids})
    if grids:
        raise MissingDependency(
            f"the transformation from WGS84 to {crs.name} needs a grid that isn't installed: {' or '.join(grids)}",
            where=get_data_dir(),
            cure="put the grid there (https://cdn.proj.org has them), or give geoid_offset or geoid_grid",
        )
    raise ConfigurationError(
        f"PROJ knows no transformation from WGS84 to {crs.name} here, only guesses, which would leave heights wrong",
        cure="give geoid_offset (how far the level of heights lies above the WGS84 ellipsoid, m) or geoid_grid",
    )


def _system(epsg: int, vertical: Heights) -> "CRS":
    """Return the system that PROJ converts to: with the vertical one where PROJ must know the level."""
    crs = _known(epsg)
    if not (crs.is_projected or crs.is_geographic):
        raise ConfigurationError(
            f"EPSG:{epsg} ({crs.name}) is neither a projected nor a geographic system",
            cure="give a system of eastings and northings, or 4326 for longitude and latitude",
        )
    if vertical.ellipsoidal:
        return crs
    if len(crs.axis_info) > 2:
        raise ConfigurationError(
            f"EPSG:{epsg} ({crs.name}) has heights of its own, and heights of another level are asked for",
            cure="give a system of two axes, or leave the other heights out",
        )
    if vertical.epsg is None:
        return crs
    level = _known(vertical.epsg)
    if not level.is_vertical or level.is_compound:
        raise ConfigurationError(
            f"EPSG:{vertical.epsg} ({level.name}) isn't a vertical system",
            cure="give the code of heights, such as 5773 (EGM96), 3855 (EGM2008) or 5738 (HKPD)",
        )
    if vertical.undulation_given:
        return crs
    compound: CRS = _pyproj().CRS.from_user_input(f"EPSG:{epsg}+{vertical.epsg}")
    return compound


def _known(epsg: int) -> "CRS":
    pyproj = _pyproj()
    try:
        crs: CRS = pyproj.CRS.from_epsg(epsg)
    except pyproj.exceptions.CRSError as error:
        raise ConfigurationError(
            f"PROJ doesn't know EPSG:{epsg}", cure="look the code up at https://epsg.org; 2326 is Hong Kong 1980 Grid"
        ) from error
    return crs


def _pyproj() -> ModuleType:
    try:
        import pyproj
    except ImportError as error:
        raise MissingDependency(
            "coordinate systems by EPSG code need pyproj",
            cure="pip install 'slideframe[georeferencing]'",
        ) from error
    return pyproj


def _bounds(geodetic: Float64Array) -> Bounds:
    """Return west, south, east, north in degrees."""
    (south, west), (north, east) = geodetic[:, :2].min(axis=0), geodetic[:, :2].max(axis=0)
    return float(west), float(south), float(east), float(north)


def _require_inside(crs: "CRS", geodetic: Float64Array) -> None:
    """Refuse points outside the system's area of use, where projections go wrong without a word."""
    if crs.area_of_use is None:
        return
    west, south, east, north = crs.area_of_use.bounds
    latitude, longitude = geodetic[:, 0], geodetic[:, 1]
    across = (east - west) % 360.0 or 360.0
    beyond = (longitude - west + AREA_MARGIN) % 360.0 > across + 2 * AREA_MARGIN
    outside = (
        beyond & (across + 2 * AREA_MARGIN < 360.0)
        | (latitude < south - AREA_MARGIN)
        | (latitude > north + AREA_MARGIN)
    )
    if outside.any():
        place, area = geodetic[int(outside.argmax())], crs.area_of_use.name.rstrip(".")
        raise InputError(
            f"{crs.name} is made for {area}, and a point lies at {place[0]:.4f} N, {place[1]:.4f} E",
            cure="check the EPSG code, and that x (easting or longitude) stands before y (northing or latitude)",
        )
