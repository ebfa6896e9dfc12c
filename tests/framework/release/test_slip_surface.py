"""Every kind of base over ground known by formula, from every kind of file."""

import numpy as np
import pytest

from slideframe.errors import ConfigurationError, InputError
from slideframe.formats.rasters import read_raster
from slideframe.georeferencing import Heights, from_local
from slideframe.problem import (
    BoxRegion,
    DepthBase,
    EarlierGroundBase,
    EllipsoidBase,
    FlatBase,
    MeshBase,
    PlaneBase,
    RasterBase,
    SlblBase,
)
from slideframe.release.plan import plan_of
from slideframe.release.slip_surface import release_grid

SIDES = {"x_min": -20.0, "x_max": 20.0, "y_min": -15.0, "y_max": 15.0}


def ground(x, y):
    return 5 + 0.3 * x - 0.1 * y


@pytest.fixture
def grid_of(georeference):
    def grid_of(base, spacing=0.5, height=ground):
        region = BoxRegion(**SIDES, base=base)
        return release_grid(region, plan_of(region, georeference), height, spacing, georeference)

    return grid_of


def nodes(grid):
    return np.meshgrid(grid.x, grid.y, indexing="ij")


def test_flat_and_constant_depth(grid_of):
    flat, below = grid_of(FlatBase(z_min=-3)), grid_of(DepthBase(depth=2.5))
    assert (flat.base == -3).all()
    np.testing.assert_allclose(below.ground - below.base, 2.5)
    assert flat.x[0] < -20 < flat.x[1] + 1e-9
    assert flat.x[-1] > 20
    assert flat.base_at(np.array([0.1, 999]), np.array([0.2, 0])).tolist()[0] == -3
    assert np.isnan(flat.base_at(np.array([999.0]), np.array([0.0]))).all()


def test_no_ground_no_base(grid_of):
    grid = grid_of(DepthBase(depth=1), height=lambda x, y: np.where(x > 0, ground(x, y), -np.inf))
    assert np.isnan(grid.base[nodes(grid)[0] <= 0]).all()
    assert np.isfinite(grid.base[nodes(grid)[0] > 0]).all()


def test_plane_in_local_and_map_coordinates(grid_of, georeference):
    points = np.array([[-20.0, -15, -4], [20, -15, 2], [0, 15, 1]])
    grid = grid_of(PlaneBase(points=points.tolist()))
    x, y = nodes(grid)
    expected = -1 + 6 / 40 * x + (y + 15) / 30 * 2
    np.testing.assert_allclose(grid.base, expected, atol=1e-9)
    placed = from_local(points, 2326, georeference, Heights(geoid_offset=-2.5))
    on_map = grid_of(PlaneBase(points=placed.tolist(), epsg=2326, geoid_offset=-2.5))
    np.testing.assert_allclose(on_map.base, expected, atol=1e-3)


def test_sphere(grid_of):
    points = [(0, 0, -10), (20, 0, 10), (0, 20, 10), (-20, 0, 10)]
    grid = grid_of(EllipsoidBase(points=points, axis_ratio=(1, 1, 1)))
    x, y = nodes(grid)
    inside = np.hypot(x, y) < 19.9
    np.testing.assert_allclose(grid.base[inside], 10 - np.sqrt(400 - x**2 - y**2)[inside], atol=1e-6)
    assert np.isnan(grid.base[np.hypot(x, y) > 20.1]).all()


def test_base_level_hangs_from_the_outline(grid_of):
    grid = grid_of(SlblBase(maximum_depth=3))
    depth = grid.ground - grid.base
    assert depth.max() == pytest.approx(3, rel=0.01)
    assert (depth >= 0).all()
    x, y = nodes(grid)
    rim = (np.abs(np.abs(x) - 20) < 1e-9) & (np.abs(y) <= 15) | (np.abs(np.abs(y) - 15) < 1e-9) & (np.abs(x) <= 20)
    assert depth[rim].max() < 0.05


def test_base_level_needs_ground_all_over(grid_of):
    with pytest.raises(ConfigurationError, match="needs ground"):
        grid_of(SlblBase(maximum_depth=3), height=lambda x, y: np.where(x > 0, ground(x, y), -np.inf))


def test_ascii_heights_and_depths(grid_of, write_ascii):
    path = write_ascii(lambda x, y: 0.2 * x - 4, -30, -30, 2.0, 30, 30)
    grid = grid_of(RasterBase(path=path))
    np.testing.assert_allclose(grid.base, 0.2 * nodes(grid)[0] - 4, atol=1e-5)
    path = write_ascii(lambda x, y: np.where(x > 5, np.nan, -np.where(x > 0, 0.0, 1.5)), -30, -30, 1.0, 60, 60)
    grid = grid_of(RasterBase(path=path, quantity="depth"))
    x, _ = nodes(grid)
    np.testing.assert_allclose((grid.ground - grid.base)[x < -0.6], 1.5, atol=1e-5)
    assert np.isnan(grid.base[x > 0.6]).all()


def test_geotiff_on_a_map_with_geoid_heights(grid_of, georeference, tmp_path):
    rasterio = pytest.importorskip("rasterio")
    centre = from_local(np.zeros((1, 3)), 2326, georeference)[0]
    cell, count = 0.5, 200
    west, north = centre[0] - cell * count / 2, centre[1] + cell * count / 2
    path = tmp_path / "base.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=count, height=count, count=1, dtype="float64", crs="EPSG:2326", nodata=-1.0,
        transform=rasterio.transform.from_origin(west, north, cell, cell),
    ) as target:  # fmt: skip
        heights = np.broadcast_to(140 + 0.1 * cell * (np.arange(count) - count / 2 + 0.5), (count, count)).copy()
        heights[:, :60] = -1.0  # nodata in the west, up to 20 m from the centre
        target.write(heights, 1)
    grid = grid_of(RasterBase(path=path, geoid_offset=3.0))
    x, _ = nodes(grid)
    there = x > -18
    # 140 m above a level 3 m over the ellipsoid, and the origin at 148.4 m; the grid is turned by half a degree
    np.testing.assert_allclose(grid.base[there], 140 + 3 - 148.4 + 0.1 * x[there], atol=0.05)
    assert np.isnan(grid.base[x < -20.5]).all()


def test_earlier_ground_is_aligned_and_only_the_risen_part_moves(grid_of, write_ascii):
    def risen(x, y):
        return ground(x, y) + 3 * np.exp(-(x**2 + y**2) / 50)

    path = write_ascii(lambda x, y: ground(x, y) - 1.7, -80, -80, 1.0, 160, 160)
    grid = grid_of(EarlierGroundBase(path=path), height=risen)
    assert grid.figures["earlier_ground_shift_m"] == pytest.approx(1.7, abs=0.01)
    x, y = nodes(grid)
    thick = 3 * np.exp(-(x**2 + y**2) / 50)
    np.testing.assert_allclose((grid.ground - grid.base)[thick > 0.25], thick[thick > 0.25], atol=0.02)
    assert np.isnan(grid.base[thick < 0.15]).all()
    unaligned = grid_of(EarlierGroundBase(path=path, align=False), height=risen)
    assert np.nanmin(unaligned.ground - unaligned.base) == pytest.approx(1.7, abs=0.01)


def test_earlier_ground_without_surroundings_can_t_be_aligned(grid_of, write_ascii):
    path = write_ascii(lambda x, y: ground(x, y), -20, -15, 1.0, 40, 30)
    with pytest.raises(ConfigurationError, match="too little ground around"):
        grid_of(EarlierGroundBase(path=path))


def test_mesh_surface(grid_of, tmp_path):
    path = tmp_path / "base.obj"
    path.write_text("v -30 -30 -9\nv 30 -30 3\nv 30 30 3\nv -30 30 -9\nf 1 2 3\nf 1 3 4\n")
    grid = grid_of(MeshBase(path=path))
    np.testing.assert_allclose(grid.base, -3 + 0.2 * nodes(grid)[0], atol=1e-9)


def test_raster_elsewhere_and_swapped(grid_of, write_ascii):
    path = write_ascii(lambda x, y: x, 500, 600, 1.0, 20, 20)
    with pytest.raises(ConfigurationError, match="no value over the region") as caught:
        grid_of(RasterBase(path=path))
    assert "x 500 to 520, y 600 to 620" in caught.value.what
    assert caught.value.where == str(path)


@pytest.mark.parametrize("content", ["", "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n", "nonsense"])
def test_unreadable_raster(grid_of, tmp_path, content):
    path = tmp_path / "broken.asc"
    path.write_text(content)
    with pytest.raises(InputError, match="can't be read"):
        grid_of(RasterBase(path=path))


def test_a_real_release(shared, georeference):
    """S-1000 landslide (Keck et al. 2024): 30 cells, 22 481 m3 released."""
    folder = shared / "data/dem/landlab_mwr_s1000"
    before = read_raster(folder / "pre_runout_DEM.asc")
    depth = read_raster(folder / "landslide_depth.asc")
    chosen = np.argwhere(np.nan_to_num(depth.values) != 0)
    rows, columns = chosen.T
    x = depth.west + depth.cell[0] * (columns + 0.5)
    y = depth.north - depth.cell[1] * (rows + 0.5)
    region = BoxRegion(
        x_min=x.min() - 15, x_max=x.max() + 15, y_min=y.min() - 15, y_max=y.max() + 15,
        base=RasterBase(path=folder / "landslide_depth.asc", quantity="depth"),
    )  # fmt: skip
    # the files carry no coordinate system: taken as they are, the grid's own coordinates are the frame
    grid = release_grid(region, plan_of(region, georeference), before.sample, 1.0, georeference)
    thickness = np.nan_to_num(grid.ground - grid.base)
    volume = thickness.sum() * (grid.x[1] - grid.x[0]) * (grid.y[1] - grid.y[0])
    assert -np.nansum(depth.values) * 100 == pytest.approx(22_481, rel=0.001)
    # interpolation between cells shifts soil from cell to cell, the nodes cut cells anywhere
    assert volume == pytest.approx(22_481, rel=0.03)
