"""WGS84 coordinates of points in a local east-north-up frame, exact to rounding."""

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.products import Georeference

SEMI_MAJOR_AXIS = 6378137.0  # m, WGS84
FLATTENING = 1 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)


def geodetic_from_enu(points: Float64Array, origin: Georeference) -> Float64Array:
    """Convert (point, 3) in metres east, north, up of `origin` to latitude and longitude in degrees and height in m."""
    start = ecef_from_geodetic(np.array([[origin.latitude, origin.longitude, origin.ellipsoidal_height]]))
    return geodetic_from_ecef(start + points @ enu_axes(origin))


def enu_from_geodetic(geodetic: Float64Array, origin: Georeference) -> Float64Array:
    """Convert (point, 3) in degrees north, degrees east and metres to metres east, north, up of `origin`."""
    start = ecef_from_geodetic(np.array([[origin.latitude, origin.longitude, origin.ellipsoidal_height]]))
    return (ecef_from_geodetic(geodetic) - start) @ enu_axes(origin).T


def ecef_from_geodetic(geodetic: Float64Array) -> Float64Array:
    """Convert latitude, longitude (degrees) and ellipsoidal height (m) to earth-centred coordinates (point, 3), m."""
    latitude, longitude, height = np.radians(geodetic[:, 0]), np.radians(geodetic[:, 1]), geodetic[:, 2]
    normal = SEMI_MAJOR_AXIS / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    across = (normal + height) * np.cos(latitude)
    along_axis = (normal * (1 - ECCENTRICITY_SQUARED) + height) * np.sin(latitude)
    return np.column_stack([across * np.cos(longitude), across * np.sin(longitude), along_axis])


def geodetic_from_ecef(points: Float64Array) -> Float64Array:
    """Invert `ecef_from_geodetic` near the Earth's surface.

    Bowring 1976, "Transformation from spatial to geographical coordinates", repeated: one pass is right to
    a nanometre at these heights, the second to rounding.
    """
    x, y, z = points.T
    across = np.hypot(x, y)
    second_eccentricity_squared = ECCENTRICITY_SQUARED / (1 - ECCENTRICITY_SQUARED)
    semi_minor_axis = SEMI_MAJOR_AXIS * (1 - FLATTENING)
    parametric = np.arctan2(z, across * (1 - FLATTENING))
    for _ in range(3):
        latitude = np.arctan2(
            z + second_eccentricity_squared * semi_minor_axis * np.sin(parametric) ** 3,
            across - ECCENTRICITY_SQUARED * SEMI_MAJOR_AXIS * np.cos(parametric) ** 3,
        )
        parametric = np.arctan2((1 - FLATTENING) * np.sin(latitude), np.cos(latitude))
    normal = SEMI_MAJOR_AXIS / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    # this form has no division by cos(latitude), so it holds at the poles too
    height = across * np.cos(latitude) + z * np.sin(latitude) - SEMI_MAJOR_AXIS**2 / normal
    return np.column_stack([np.degrees(latitude), np.degrees(np.arctan2(y, x)), height])


def mean_origin(geodetic: Float64Array) -> Georeference:
    """Return the mean of (point, 3) latitudes, longitudes and heights, also astride the 180th meridian."""
    latitude, longitude, height = geodetic.T
    first = float(longitude[0])
    offset = float(np.mean((longitude - first + 180.0) % 360.0 - 180.0))
    return Georeference(
        latitude=float(np.mean(latitude)),
        longitude=(first + offset + 180.0) % 360.0 - 180.0,
        ellipsoidal_height=float(np.mean(height)),
    )


def enu_axes(origin: Georeference) -> Float64Array:
    """Return the unit vectors east, north and up in earth-centred coordinates (3, 3), one a row."""
    latitude, longitude = np.radians(origin.latitude), np.radians(origin.longitude)
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    return np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )
