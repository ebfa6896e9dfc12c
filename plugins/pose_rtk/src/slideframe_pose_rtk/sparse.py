"""The sparse points of a survey, with the colours of the photographs that see them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from slideframe.arrays import Float64Array, UInt8Array
from slideframe_pose_rtk.flight import Flight

if TYPE_CHECKING:
    import pycolmap

Sightings = dict[int, tuple[list[int], list[tuple[float, float]]]]


@dataclass(frozen=True, eq=False)
class SparsePoints:
    """Points in the order of their numbers.

    Attributes:
        places: (point, 3), m.
        errors: (point,) mean reprojection error, px; 0 where unknown.
        colors: (point, 3) sRGB.
    """

    places: Float64Array
    errors: Float64Array
    colors: UInt8Array


def sparse_points(flight: Flight, reconstruction: "pycolmap.Reconstruction", accepted: float) -> SparsePoints:
    """Return the points within the accepted error, px, in the order of their numbers."""
    chosen = [
        point
        for _, point in sorted(reconstruction.points3D.items())
        if point.error <= accepted and np.isfinite(point.xyz).all()
    ]
    places = np.array([point.xyz for point in chosen], np.float64).reshape(-1, 3)
    errors = np.array([point.error for point in chosen], np.float64)
    return SparsePoints(places, errors, _colors(flight, reconstruction, chosen))


def _colors(
    flight: Flight, reconstruction: "pycolmap.Reconstruction", points: "Sequence[pycolmap.Point3D]"
) -> UInt8Array:
    """Return the mean colour of each point over the photographs that see it."""
    sightings: Sightings = {}
    for row, point in enumerate(points):
        for element in point.track.elements:
            rows, pixels = sightings.setdefault(element.image_id - 1, ([], []))
            rows.append(row)
            x, y = reconstruction.image(element.image_id).point2D(element.point2D_idx).xy
            pixels.append((x, y))
    total, count = np.zeros((len(points), 3)), np.zeros((len(points), 1))
    for index, (rows, pixels) in sorted(sightings.items()):
        with Image.open(flight.records[index].path) as picture:
            colors = np.asarray(picture.convert("RGB"))
        columns, lines = np.floor(np.array(pixels)).astype(int).T
        inside = np.clip(lines, 0, colors.shape[0] - 1), np.clip(columns, 0, colors.shape[1] - 1)
        np.add.at(total, rows, colors[inside])
        np.add.at(count, rows, 1)
    return np.round(total / np.maximum(count, 1)).astype(np.uint8)
