"""Positions of a survey's cameras as a table: CSV with a line per photograph, which `pose_rtk` reads as `positions`."""

import csv
from pathlib import Path

import numpy as np

from slideframe.formats.colmap import common_folder
from slideframe.geodesy import geodetic_from_enu
from slideframe.georeferencing import ELLIPSOIDAL, Heights, from_local, require_projected
from slideframe.products import Survey

DEGREE_DIGITS = 9  # 0.1 mm
METER_DIGITS = 4
SIGMAS = ("sigma_east", "sigma_north", "sigma_up")


def write_position_table(survey: Survey, path: Path, epsg: int | None = None, heights: Heights = ELLIPSOIDAL) -> None:
    """Write name, position and standard deviations (m) of every camera.

    Without `epsg`, latitude and longitude in degrees of WGS84 and ellipsoidal heights, for which nothing need be
    installed; with it, easting and northing, and heights above what `heights` says.

    Raises:
        ConfigurationError, MissingDependency, InputError: the coordinate system can't be used, see `georeferencing`.
    """
    centers = survey.world_from_camera[:, :, 3]
    if epsg is None:
        places = geodetic_from_enu(centers, survey.georeference)
        columns, digits, heights = ("latitude", "longitude"), DEGREE_DIGITS, ELLIPSOIDAL
    else:
        require_projected(epsg, heights)
        places = from_local(centers, epsg, survey.georeference, heights)
        columns, digits = ("easting", "northing"), METER_DIGITS
    height = "ellipsoidal_height" if heights.ellipsoidal else "orthometric_height"
    folder = common_folder(survey)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", *columns, height, *SIGMAS])
        for photograph, place, sigma in zip(survey.photographs, places, survey.position_sigma, strict=True):
            x, y, z = np.asarray(place).tolist()
            numbers = [f"{x:.{digits}f}", f"{y:.{digits}f}", f"{z:.{METER_DIGITS}f}"]
            numbers += [f"{value:.{METER_DIGITS}f}" for value in sigma.tolist()]
            writer.writerow([photograph.path.relative_to(folder).as_posix(), *numbers])
