"""Triangles from PLY, OBJ, STL and OFF files, read by trimesh."""

from pathlib import Path
from typing import Any

import numpy as np

from slideframe.arrays import Float64Array, Int32Array
from slideframe.errors import InputError, MissingDependency

SUFFIXES = (".ply", ".obj", ".stl", ".off")


def read_mesh(path: Path) -> tuple[Float64Array, Int32Array]:
    """Return vertices (vertex, 3), with equal ones joined, and triangles (triangle, 3).

    Raises:
        InputError: the file can't be read or holds no triangle.
        MissingDependency: trimesh isn't installed.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"'{path.suffix}' isn't a mesh format that is read here", where=str(path), cure=f"use {', '.join(SUFFIXES)}"
        )
    try:
        import trimesh
    except ImportError as error:
        raise MissingDependency("meshes need trimesh", where=str(path), cure="pip install 'slideframe[geo]'") from error
    try:
        mesh: Any = trimesh.load(path, force="mesh", process=True)
        vertices, triangles = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32)
    except Exception as error:  # trimesh raises whatever its parsers do
        raise InputError(f"the mesh can't be read: {error}", where=str(path), cure="export it again") from error
    if not len(triangles):
        raise InputError("the file holds no triangle", where=str(path), cure="export a triangle mesh, not points")
    if not np.isfinite(vertices).all():
        raise InputError("a vertex of the mesh isn't finite", where=str(path), cure="export it again")
    return vertices, triangles
