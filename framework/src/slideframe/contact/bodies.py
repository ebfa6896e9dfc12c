"""Solid bodies: what a problem's files hold, checked before anything is computed, and brought into the local frame."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from slideframe.arrays import Float32Array, Float64Array
from slideframe.contact.mesh import TriangleMesh
from slideframe.errors import ConfigurationError, InputError
from slideframe.formats.meshes import read_mesh
from slideframe.geodesy import enu_from_geodetic
from slideframe.georeferencing import to_geodetic
from slideframe.problem import Boundary, ColliderMesh, Wall
from slideframe.products import Georeference
from slideframe.release.coordinates import heights_of, local_points, require_local

# A body whose heights miss those of the survey by more than this and the survey's own relief has another level, m.
LEVEL_SLACK = 20.0


@dataclass(frozen=True)
class Body:
    """Something solid.

    Attributes:
        name: as errors call it.
        where: the key that it comes from.
        mesh: its surface in the local frame.
        wall: how that acts.
        closed: whether the mesh encloses it; else it's solid behind the mesh, as the ground is.
    """

    name: str
    where: str
    mesh: TriangleMesh
    wall: Wall
    closed: bool = False

    def require_no_holes(self, spacing: float) -> None:
        """Refuse holes wider than a cell.

        Raises:
            InputError: with their number and the first one's place.
        """
        wide = [hole for hole in self.mesh.holes() if np.linalg.norm(hole[1] - hole[0]) > spacing]
        if wide:
            raise InputError(
                f"the {self.name} has {len(wide)} holes wider than a cell, the first around "
                f"{_place(wide[0].mean(axis=0))}: the mass would fall through",
                where=self.where,
                cure="close the mesh's holes; only its outer border may be open",
            )


def bodies_of(boundary: Boundary, georeference: Georeference | None) -> Iterator[Body]:
    """Give the bodies that files hold.

    Raises:
        ConfigurationError, InputError, MissingDependency: a file can't be read, isn't sound or isn't where it seems.
    """
    for index, given in enumerate(boundary.meshes):
        where = f"boundary.meshes[{index}]"
        vertices, triangles = read_mesh(given.path)
        if given.epsg is not None and georeference is None:
            raise ConfigurationError(
                f"{given.path} has coordinates of EPSG:{given.epsg}, and the problem has no georeference",
                where=where,
                cure="give the solver SimulationProblem.placed(survey.georeference)",
            )
        if georeference is None:
            points = require_local(vertices, f"{where}, {given.path}")
        else:
            points = local_points(vertices, given, georeference, f"{where}, {given.path}")
        mesh = TriangleMesh.welded(points, triangles)
        _require_sound(mesh, given, where)
        yield Body(f"mesh {given.path.name}", where, mesh, given, given.surface == "closed")


def require_sound_files(boundary: Boundary) -> None:
    """Read and check every file as far as that can be done without the survey's origin.

    Raises:
        ConfigurationError, InputError, MissingDependency: as `bodies_of`.
    """
    for index, given in enumerate(boundary.meshes):
        vertices, triangles = read_mesh(given.path)
        if given.epsg is None:
            points = require_local(vertices, f"boundary.meshes[{index}], {given.path}")
        else:
            geodetic = to_geodetic(vertices, given.epsg, heights_of(given))
            latitude, longitude, height = geodetic[0]
            origin = Georeference(latitude=latitude, longitude=longitude, ellipsoidal_height=height)
            points = enu_from_geodetic(geodetic, origin)
        _require_sound(TriangleMesh.welded(points, triangles), given, f"boundary.meshes[{index}]")


def require_at_site(boundary: Boundary, georeference: Georeference, points: Float32Array) -> None:
    """Refuse bodies that are nowhere near the points (point, 3) that the survey saw.

    Raises:
        ConfigurationError: with both extents. Others as `bodies_of`.
    """
    if not len(points):
        return
    low, high = np.percentile(points.astype(np.float64), [1, 99], axis=0)
    room = np.maximum(high - low, [0.0, 0.0, LEVEL_SLACK])
    for body in bodies_of(boundary, georeference):
        bottom, top = body.mesh.vertices.min(axis=0), body.mesh.vertices.max(axis=0)
        apart = (bottom > high + room) | (top < low - room)
        if apart.any():
            level = not apart[:2].any()
            raise ConfigurationError(
                f"the {body.name} lies {'above or below' if level else 'beside'} the site: from {_place(bottom)} to "
                f"{_place(top)}, and the survey saw {_place(low)} to {_place(high)}",
                where=body.where,
                cure="name the level of its heights by vertical_epsg or geoid_offset"
                if level
                else "give its coordinates in the survey's local frame, or name their system by epsg",
            )


def _require_sound(mesh: TriangleMesh, given: ColliderMesh, where: str) -> None:
    """Refuse a surface of which it can't be said what is inside."""
    if not len(mesh.triangles):
        raise _unsound(given, where, "no triangle has an area", "export it again")
    crowded, turned, gaps = mesh.crowded_edges(), mesh.turned_edges(), mesh.gaps()
    if len(crowded):
        fault = f"{len(crowded)} edges have more than two triangles, the first at {_place(crowded[0])}"
        raise _unsound(given, where, fault, "remove inner faces and doubled triangles")
    if len(turned):
        fault = f"{len(turned)} edges lie between triangles that face opposite ways, the first at {_place(turned[0])}"
        raise _unsound(given, where, fault, "let all triangles turn counter-clockwise seen from outside")
    if given.surface == "open":
        if not gaps:
            raise _unsound(given, where, "it's closed", "set surface = 'closed'")
        return
    if gaps:
        fault = f"it's open: its border has {len(gaps)} loops, the first around {_place(gaps[0].mean(axis=0))}"
        raise _unsound(given, where, fault, "close it; or set surface = 'open' for a sheet with ground behind it")
    outer = [box for volume, box in mesh.volumes().values() if volume > 0]
    for volume, box in mesh.volumes().values():
        if volume < 0 and not any((around[0] <= box[0]).all() and (box[1] <= around[1]).all() for around in outer):
            fault = f"the part around {_place(box.mean(axis=0))} faces inwards"
            raise _unsound(given, where, fault, "turn its triangles: all else would be solid")


def _unsound(given: ColliderMesh, where: str, fault: str, cure: str) -> InputError:
    return InputError(f"{given.path} isn't a sound surface: {fault}", where=where, cure=cure)


def _place(point: Float64Array) -> str:
    return "({:.2f}, {:.2f}, {:.2f}) m".format(*point)
