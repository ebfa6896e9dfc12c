"""Coordinates that users give, brought into the survey's frame, and recognised where they are of another kind."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import ConfigurationError, SlideframeError
from slideframe.georeferencing import Heights, from_local, to_local
from slideframe.problem import MapHeights
from slideframe.products import Georeference

# No survey from a drone reaches this far, so that larger local coordinates are a map's.
FARTHEST_LOCAL = 20_000.0


def local_points(points: Float64Array, given: MapHeights, georeference: Georeference, where: str) -> Float64Array:
    """Return points (point, 3) in the local frame, m.

    Raises:
        ConfigurationError, InputError, MissingDependency: they can't be where they are said to be.
    """
    if given.epsg is None:
        return require_local(points, where)
    with _named(where):
        return to_local(points, given.epsg, georeference, heights_of(given))


def local_outline(ring: Float64Array, epsg: int | None, georeference: Georeference, where: str) -> Float64Array:
    """Return corners (corner, 2) in the local frame, m. Raises as `local_points`."""
    if epsg is None:
        return require_local(ring, where)
    with _named(where):
        return to_local(ring, epsg, georeference)


def require_local(points: Float64Array, where: str) -> Float64Array:
    """Refuse coordinates that can't be metres from the survey's origin.

    Raises:
        ConfigurationError: they are a map's.
    """
    farthest = points[np.abs(points[:, :2]).max(axis=1).argmax(), :2] if len(points) else np.zeros(2)
    if np.abs(farthest).max() > FARTHEST_LOCAL:
        raise ConfigurationError(
            f"({farthest[0]:.10g}, {farthest[1]:.10g}) isn't in metres east and north of the survey's origin: "
            "it looks like a map's coordinates",
            where=where,
            cure="name their coordinate system with epsg, such as epsg = 2326 for Hong Kong 1980 Grid",
        )
    return points


def map_points(
    points: Float64Array, epsg: int | None, given: MapHeights, georeference: Georeference, where: str
) -> Float64Array:
    """Return local points (point, 3) in the system `epsg`; None: they stay local. Raises as `local_points`."""
    if epsg is None:
        return points
    with _named(where):
        return from_local(points, epsg, georeference, heights_of(given))


@contextmanager
def _named(where: str) -> Iterator[None]:
    """Let an error of coordinates say which file or key they stand in."""
    try:
        yield
    except SlideframeError as error:
        error.where = error.where or where
        raise


def heights_of(given: MapHeights) -> Heights:
    """Return the level that heights are measured from."""
    return Heights(epsg=given.vertical_epsg, geoid_offset=given.geoid_offset)
