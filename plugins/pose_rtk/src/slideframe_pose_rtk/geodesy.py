"""From WGS84 coordinates to the local east-north-up frame and back, in float64."""

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.products import Georeference


class LocalFrame:
    """The topocentric frame of EPSG:9837: axes true east, true north and the ellipsoid's normal at the origin."""

    def __init__(self, origin: Georeference) -> None:
        """Prepare PROJ's exact conversion; it needs no grid, so no ballpark result is possible."""
        from pyproj import Transformer

        place = f"+lon_0={origin.longitude!r} +lat_0={origin.latitude!r} +h_0={origin.ellipsoidal_height!r}"
        self.origin = origin
        self._transformer = Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad"
            f" +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 {place}"
        )

    def to_local(
        self, latitude: Float64Array, longitude: Float64Array, ellipsoidal_height: Float64Array
    ) -> Float64Array:
        """Return (point, 3) metres east, north and up of the origin, from degrees and metres."""
        return np.column_stack(self._transformer.transform(longitude, latitude, ellipsoidal_height))

    def to_geographic(self, local: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return latitudes, longitudes (degrees) and ellipsoidal heights (m) of (point, 3) local positions."""
        east, north, up = np.asarray(local, np.float64).T
        longitude, latitude, height = self._transformer.transform(east, north, up, direction="INVERSE")
        return latitude, longitude, height


def mean_origin(latitude: Float64Array, longitude: Float64Array, ellipsoidal_height: Float64Array) -> Georeference:
    """Return the mean of the positions, also for a survey astride the 180th meridian."""
    first = float(longitude[0])
    offset = float(np.mean((longitude - first + 180.0) % 360.0 - 180.0))
    return Georeference(
        latitude=float(np.mean(latitude)),
        longitude=(first + offset + 180.0) % 360.0 - 180.0,
        ellipsoidal_height=float(np.mean(ellipsoidal_height)),
    )
