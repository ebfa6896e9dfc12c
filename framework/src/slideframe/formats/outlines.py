"""Polygons from GeoJSON, and with pyogrio from GeoPackage, Shapefile and whatever else GDAL reads."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import InputError, MissingDependency

Polygon = tuple[Float64Array, ...]  # outline, then holes, (corner, 2) each
WGS84 = 4326
GEOJSON_SUFFIXES = (".geojson", ".json")


def read_outlines(path: Path, layer: str | None = None) -> tuple[list[Polygon], int | None]:
    """Read all polygons of a file, or of one layer of it.

    Returns:
        The polygons, x before y, and the EPSG code of their coordinates; None: the file doesn't say.

    Raises:
        InputError: the file can't be read or holds no polygon.
        MissingDependency: it isn't GeoJSON and pyogrio isn't installed.
    """
    try:
        geojson = path.suffix.lower() in GEOJSON_SUFFIXES
        polygons, epsg = _read_geojson(path) if geojson else _read_with_pyogrio(path, layer)
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(
            f"the outline can't be read: {error}",
            where=str(path),
            cure="give polygons as GeoJSON, GeoPackage or Shapefile",
        ) from error
    if not polygons:
        raise InputError("the file holds no polygon", where=str(path), cure="points and lines have no area")
    return polygons, epsg


def _read_geojson(path: Path) -> tuple[list[Polygon], int]:
    """Read GeoJSON: longitude and latitude (RFC 7946), or what the member `crs` of the older format says."""
    content = json.loads(path.read_text(encoding="utf-8"))
    name = str(((content.get("crs") or {}).get("properties") or {}).get("name", "CRS84"))
    code = re.search(r"EPSG:+(?:\d*:)?(\d+)$", name, re.IGNORECASE)
    if not code and not name.upper().endswith("CRS84"):
        raise ValueError(f"its coordinate system '{name}' has no EPSG code")
    return [_rings(polygon) for polygon in _polygons(content)], int(code.group(1)) if code else WGS84


def _polygons(value: dict[str, Any]) -> list[Any]:
    """Return the coordinates of all polygons in a GeoJSON object."""
    kind = value.get("type")
    if kind == "FeatureCollection":
        return [polygon for feature in value["features"] for polygon in _polygons(feature)]
    if kind == "Feature":
        return _polygons(value["geometry"]) if value.get("geometry") else []
    if kind == "GeometryCollection":
        return [polygon for geometry in value["geometries"] for polygon in _polygons(geometry)]
    if kind == "MultiPolygon":
        return list(value["coordinates"])
    return [value["coordinates"]] if kind == "Polygon" else []


def _read_with_pyogrio(path: Path, layer: str | None) -> tuple[list[Polygon], int | None]:
    try:
        import pyogrio
    except ImportError as error:
        raise MissingDependency(
            f"{path.suffix} files need pyogrio", where=str(path), cure="pip install 'slideframe[geo]', or give GeoJSON"
        ) from error
    import shapely

    try:
        meta, _, geometry, _ = pyogrio.raw.read(path, layer=layer, columns=[])
    except pyogrio.errors.DataSourceError as error:
        raise ValueError(str(error)) from error
    parts = shapely.get_parts(shapely.from_wkb(geometry)) if geometry is not None else []
    polygons = [
        _rings([shapely.get_coordinates(ring) for ring in (part.exterior, *part.interiors)])
        for part in parts
        if part.geom_type == "Polygon" and not part.is_empty
    ]
    if not meta["crs"]:
        return polygons, None
    from slideframe.georeferencing import epsg_of

    return polygons, epsg_of(str(meta["crs"]))


def _rings(rings: Any) -> Polygon:
    return tuple(np.asarray([corner[:2] for corner in ring], np.float64) for ring in rings)
