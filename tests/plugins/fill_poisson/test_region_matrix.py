"""Every plan on every slip surface, from every kind of file: the volume that is cut out of ground known by formula."""

import json

import numpy as np
import pytest

from slideframe.georeferencing import from_local
from slideframe.problem import (
    BoxRegion,
    DepthBase,
    EarlierGroundBase,
    EllipsoidBase,
    FlatBase,
    MeshBase,
    MeshRegion,
    PlaneBase,
    PolygonRegion,
    RasterBase,
    SlblBase,
)
from slideframe.products import Georeference
from slideframe.release.plan import plan_of
from slideframe.release.slip_surface import release_grid
from slideframe_fill_poisson.excavation import closed_room, excavate, room_above, room_of, soil_body
from slideframe_fill_poisson.lattice import Lattice, place_particles
from slideframe_fill_poisson.rays import Body
from slideframe_fill_poisson.solids import PLAN, height_field_sheet, rim_edges, upright_prism

VOLUME_TOLERANCE = 0.005
SPACING = 0.4  # of particles and of the slip surface's grid, m
EPSG = 2326  # Hong Kong 1980 Grid, near the survey's place
OUTLINE = np.array([[-5.0, -4], [4, -5], [5, 4], [-3, 5]])
HOLE = np.array([[-1.0, -1], [1, -1], [1, 1.5], [-1, 1.5]])


def ground(x, y):
    return 6 + 0.3 * x - 0.2 * y


def plane(x, y):
    return 2 + 0.1 * x + 0.05 * y


@pytest.fixture
def georeference():
    return Georeference(latitude=22.2809, longitude=114.2196, ellipsoidal_height=148.4)


def on_map(corners, georeference, epsg=EPSG):
    points = np.column_stack([corners, np.zeros((len(corners), 3 - np.shape(corners)[1]))])
    return from_local(points, epsg, georeference)


@pytest.fixture
def plans(georeference, tmp_path):
    """Make each kind of plan, for a base."""

    def closed(ring, epsg):
        return [list(corner) for corner in on_map(np.vstack([ring, ring[:1]]), georeference, epsg)[:, :2]]

    def geojson(base):
        path = tmp_path / "plan.geojson"
        rings = [closed(OUTLINE, 4326), closed(HOLE[::-1], 4326)]
        path.write_text(json.dumps({"type": "Polygon", "coordinates": rings}))
        return PolygonRegion(path=path, base=base)

    def vector(name, epsg):
        def write(base):
            pyogrio, shapely = pytest.importorskip("pyogrio"), pytest.importorskip("shapely")
            path = tmp_path / name
            polygon = shapely.Polygon(closed(OUTLINE, epsg), [closed(HOLE, epsg)])
            pyogrio.raw.write(
                path, np.array([shapely.to_wkb(polygon)]), [], [], crs=f"EPSG:{epsg}", geometry_type="Polygon"
            )
            return PolygonRegion(path=path, base=base)

        return write

    return {
        "box": lambda base: BoxRegion(x_min=-5, x_max=4, y_min=-4, y_max=5, base=base),
        "polygon": lambda base: PolygonRegion(corners=OUTLINE.tolist(), holes=[HOLE.tolist()], base=base),
        "geojson": geojson,
        "geopackage": vector("plan.gpkg", EPSG),
        "shapefile": vector("plan.shp", 32650),
    }


@pytest.fixture
def bases(georeference, tmp_path):
    """Make each kind of slip surface, and its height by formula at (x, y)."""

    def raster():
        axis = np.arange(-12, 12, 0.5) + 0.25
        lines = [" ".join(f"{value:.6f}" for value in row) for row in plane(*np.meshgrid(axis, axis[::-1]))]
        path = tmp_path / "base.asc"
        path.write_text("ncols 48\nnrows 48\nxllcorner -12\nyllcorner -12\ncellsize 0.5\n" + "\n".join(lines))
        return RasterBase(path=path)

    def mesh():
        corners = [(x, y, plane(x, y)) for x, y in ((-15, -15), (15, -15), (15, 15), (-15, 15))]
        path = tmp_path / "base.obj"
        path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 3\nf 1 3 4\n")
        return MeshBase(path=path)

    def earlier():
        """A GeoTIFF on the map's grid, which is turned against the survey's axes; its heights' level is 3 m up."""
        rasterio = pytest.importorskip("rasterio")
        west, north = on_map(np.zeros((1, 2)), georeference)[0, :2] + [-15, 15]
        east, up = np.meshgrid(west + 0.25 * (np.arange(120) + 0.5), north - 0.25 * (np.arange(120) + 0.5))
        from slideframe.georeferencing import to_local

        x, y, _ = to_local(np.column_stack([east.ravel(), up.ravel(), np.zeros(east.size)]), EPSG, georeference).T
        level = on_map(np.column_stack([x, y, plane(x, y)]), georeference)[:, 2].reshape(east.shape) - 3
        path = tmp_path / "earlier.tif"
        with rasterio.open(
            path, "w", driver="GTiff", width=120, height=120, count=1, dtype="float64", crs=f"EPSG:{EPSG}",
            transform=rasterio.transform.from_origin(west, north, 0.25, 0.25),
        ) as target:  # fmt: skip
            target.write(level, 1)
        return EarlierGroundBase(path=path, align=False, geoid_offset=3.0)

    points = [(x, y, plane(x, y)) for x, y in ((-9, -9), (9, -8), (0, 9))]
    bowl = EllipsoidBase(points=[(0, 0, 1), (12, 0, 13), (0, 12, 13), (-12, 0, 13)], axis_ratio=(1, 1, 1))
    return {
        "flat": (lambda: FlatBase(z_min=1.0), lambda x, y: np.full(x.shape, 1.0)),
        "constant_depth": (lambda: DepthBase(depth=2.0), lambda x, y: ground(x, y) - 2),
        "plane": (lambda: PlaneBase(points=points), plane),
        "ellipsoid": (lambda: bowl, lambda x, y: 13 - np.sqrt(144 - x**2 - y**2)),
        "raster": (raster, plane),
        "mesh": (mesh, plane),
        "earlier_ground": (earlier, plane),
    }


@pytest.fixture(scope="module")
def soil():
    axis = np.linspace(-10, 10, 41)
    vertices, triangles = height_field_sheet(axis, axis, ground(*np.meshgrid(axis, axis, indexing="ij")))
    return soil_body((vertices, triangles[:, ::-1]), np.array([[-10.0, -10], [10, 10]]), -2.0)


def cut(soil, region, georeference):
    plan = plan_of(region, georeference)
    grid = release_grid(region, plan, ground, SPACING, georeference)
    return plan, excavate(soil, room_above(grid, plan, 12.0))


def expected_volume(plan, base):
    """Integrate ground minus base over the plan."""
    axis = np.arange(-6, 6, 0.03) + 0.015
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    inside = plan.contains(x, y)
    x, y = x[inside], y[inside]
    return float(np.maximum(ground(x, y) - base(x, y), 0).sum() * 0.03**2)


@pytest.mark.parametrize(
    "base_kind", ["flat", "constant_depth", "plane", "ellipsoid", "raster", "mesh", "earlier_ground"]
)
@pytest.mark.parametrize("plan_kind", ["box", "polygon", "geojson", "geopackage", "shapefile"])
def test_volume_of_every_plan_on_every_base(plans, bases, soil, georeference, plan_kind, base_kind):
    make, height = bases[base_kind]
    region = plans[plan_kind](make())
    plan, pit = cut(soil, region, georeference)
    assert plan.area == pytest.approx(81 if plan_kind == "box" else 78 - 5, rel=1e-4)
    wanted = expected_volume(plan, height)
    assert pit.mass.volume == pytest.approx(wanted, rel=VOLUME_TOLERANCE)
    assert pit.mass.volume + soil.without(pit.mass).volume == pytest.approx(soil.volume, rel=1e-9)
    rim = pit.terrain.vertices[np.unique(rim_edges(pit.terrain.triangles))]
    assert (np.abs(rim[:, :2]).max(axis=1) > 10 - 1e-6).all()
    mesh = pit.mass.mesh()
    body = Body(mesh.vertices.astype(np.float32), mesh.triangles)
    bounds = np.array([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
    lattice = Lattice(bounds, SPACING)
    positions, volumes = place_particles(body.stretches(*lattice.columns()), lattice)
    assert volumes.sum(dtype=np.float64) == pytest.approx(wanted, rel=0.02)  # before they are scaled to it
    x, y, z = positions.T.astype(np.float64)
    assert (plan.contains(x, y) | (plan.distance_to_outline(x, y) < 1e-5)).all()
    assert (z < ground(x, y)).all()
    assert (z > height(x, y) - 0.03).all()  # the slip surface is a grid of SPACING


@pytest.mark.parametrize("plan_kind", ["polygon", "geopackage"])
def test_base_level_hangs_from_outline_and_hole(plans, soil, georeference, plan_kind):
    _, pit = cut(soil, plans[plan_kind](SlblBase(maximum_depth=1.5)), georeference)
    mesh = pit.mass.mesh()
    depth = ground(*mesh.vertices[:, :2].T) - mesh.vertices[:, 2]
    assert depth.max() == pytest.approx(1.5, rel=0.02)
    # between a cone's third and a paraboloid's half of the enclosing cylinder, and a bit for the ring's width
    assert 0.3 < pit.mass.volume / (73 * 1.5) < 0.65


def test_a_doubled_or_overlapping_mesh_counts_once():
    """Exported twice, or made of bodies that reach into one another."""
    block = upright_prism([np.array([[-3.0, -3], [3, -3], [3, 3], [-3, 3]])], 1.0, 20.0, PLAN).mesh()
    twice = np.concatenate([block.triangles, block.triangles])
    assert closed_room(block.vertices, twice, "block.obj").volume == pytest.approx(36 * 19)
    vertices = np.concatenate([block.vertices, block.vertices + np.array([2.0, 0, 0])])
    both = np.concatenate([block.triangles, block.triangles + len(block.vertices)]).astype(np.int32)
    assert closed_room(vertices, both, "blocks.obj").volume == pytest.approx(8 * 6 * 19)


def test_closed_mesh_on_the_map(soil, georeference, tmp_path):
    """A tilted block, half in the ground."""
    low = [(-3, -3, 1), (3, -3, 1), (3, 3, 1), (-3, 3, 1)]
    corners = on_map(np.array(low + [(x, y, 20) for x, y, _ in low], float), georeference)
    faces = [
        (1, 3, 2),
        (1, 4, 3),
        (5, 6, 7),
        (5, 7, 8),
        (1, 2, 6),
        (1, 6, 5),
        (2, 3, 7),
        (2, 7, 6),
        (3, 4, 8),
        (3, 8, 7),
    ]
    faces += [(4, 1, 5), (4, 5, 8)]
    path = tmp_path / "block.obj"
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    path.write_text("\n".join(lines))
    pit = excavate(soil, room_of(MeshRegion(path=path, epsg=EPSG), georeference))
    assert pit.mass.volume == pytest.approx(36 * (6 - 1), rel=1e-4)
