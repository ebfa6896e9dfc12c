"""The sidecar that says where on Earth a file's local coordinates are; JSON numbers of full float64 length."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from slideframe.geodesy import ecef_from_geodetic, enu_axes
from slideframe.products import Georeference


def write_georeference(georeference: Georeference, path: Path, epsg: int | None = None) -> None:
    """Write the origin of the local frame in WGS84, earth-centred, and in the projected system `epsg` where given.

    Raises:
        MissingDependency: `epsg` is given without pyproj.
        InputError: the origin is outside that system's area.
    """
    origin = np.array([georeference.latitude, georeference.longitude, georeference.ellipsoidal_height])
    centre = ecef_from_geodetic(origin[None])[0]
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = enu_axes(georeference).T, centre
    content: dict[str, Any] = {
        "frame": "local east-north-up, metres, z up, tangent to the WGS84 ellipsoid at the origin",
        "geodetic": {"epsg": 4979, "axes": "latitude, longitude, ellipsoidal height", "origin": origin.tolist()},
        "geocentric": {"epsg": 4978, "origin": centre.tolist(), "from_local": matrix.tolist()},
    }
    if epsg is not None:
        from slideframe.georeferencing import from_local

        content["projected"] = {"epsg": epsg, "origin": from_local(np.zeros((1, 3)), epsg, georeference)[0].tolist()}
    path.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")
