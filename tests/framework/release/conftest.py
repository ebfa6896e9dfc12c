"""A survey's place, rasters and outlines on disk."""

import json

import numpy as np
import pytest

from slideframe.georeferencing import from_local
from slideframe.products import Georeference

EPSG = 2326  # Hong Kong 1980 Grid


@pytest.fixture
def georeference():
    return Georeference(latitude=22.2809, longitude=114.2196, ellipsoidal_height=148.4)


@pytest.fixture
def to_map(georeference):
    """Bring local corners into a map's coordinates."""

    def to_map(corners, epsg=EPSG):
        return from_local(np.column_stack([corners, np.zeros(len(corners))]), epsg, georeference)[:, :2]

    return to_map


@pytest.fixture
def write_ascii(tmp_path):
    """Write an ESRI ASCII grid whose value at the middle of each cell is given by a function."""

    def write(height, west, south, cell, columns, rows, name="raster.asc"):
        x = west + cell * (np.arange(columns) + 0.5)
        y = south + cell * (np.arange(rows) + 0.5)[::-1]
        values = height(*np.meshgrid(x, y))
        values = np.where(np.isnan(values), -9999, values)
        path = tmp_path / name
        header = (
            f"ncols {columns}\nnrows {rows}\nxllcorner {west}\nyllcorner {south}\ncellsize {cell}\nNODATA_value -9999\n"
        )
        path.write_text(header + "\n".join(" ".join(f"{value:.6f}" for value in row) for row in values))
        return path

    return write


@pytest.fixture
def write_geojson(tmp_path):
    def write(rings, crs=None, name="outline.geojson"):
        closed = [[list(map(float, corner)) for corner in (*ring, ring[0])] for ring in rings]
        content = {
            "type": "FeatureCollection",
            "features": [
                {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": closed}},
                {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [0, 0]}},
            ],
        }
        if crs:
            content["crs"] = {"type": "name", "properties": {"name": crs}}
        path = tmp_path / name
        path.write_text(json.dumps(content))
        return path

    return write
