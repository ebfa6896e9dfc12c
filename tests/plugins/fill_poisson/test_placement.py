"""Particles in bodies of known shape: inside, evenly spread, their volumes the body's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from slideframe_fill_poisson.lattice import Lattice
from slideframe_fill_poisson.placement import LEAST_DISTANCE, TILE, blue_noise_tile, fill_body
from slideframe_fill_poisson.rays import Body
from slideframe_fill_poisson.solids import PLAN, SLIP_SURFACE, close_sheet, height_field_sheet, upright_prism

PLACEMENTS = ("lattice", "jittered", "poisson_disk")
# Before they are scaled: columns are exact but for the plan's staircase; random points miss by their surface's share.
VOLUME_TOLERANCE = {"lattice": 0.005, "jittered": 0.005, "poisson_disk": 0.02}


def square(half):
    return np.array([[-half, -half], [half, -half], [half, half], [-half, half]])


def box(half, height):
    return upright_prism([square(half)], 0, height, PLAN), 4 * half**2 * height


def wedge(half, height):
    """A ramp that rises from nothing in the west to `height` in the east."""
    axis = np.linspace(-2 * half, 2 * half, 3)
    top = (np.meshgrid(axis, axis, indexing="ij")[0] + half) / (2 * half) * height
    vertices, triangles = height_field_sheet(axis, axis, top)
    under = close_sheet(vertices, triangles[:, ::-1], -3 * height, SLIP_SURFACE)
    return under.common(upright_prism([square(half)], 0, 2 * height, PLAN)), 2 * half**2 * height


def thin_edge(shape, half, height, spacing):
    """Return the volume of a wedge's edge that may stay empty before scaling: less than half a spacing thick in the
    middle of its columns, m3.
    """
    slope = height / (2 * half)
    return 0.0 if shape is box else slope * (0.5 * spacing / slope + 0.5 * spacing) ** 2 / 2 * 2 * half


def cap(radius, height, ratio):
    """The lower cap of an ellipsoid, `height` deep and `ratio` times as long as wide, under a level top."""
    sphere = (radius**2 + height**2) / (2 * height)
    x = np.linspace(-1.05 * radius * ratio, 1.05 * radius * ratio, 241)
    y = np.linspace(-1.05 * radius, 1.05 * radius, 241)
    across, along = np.meshgrid(x / ratio, y, indexing="ij")
    away = np.minimum(across**2 + along**2, (0.999 * sphere) ** 2)
    over = close_sheet(*height_field_sheet(x, y, sphere - np.sqrt(sphere**2 - away)), 3 * sphere, SLIP_SURFACE)
    under = upright_prism([1.04 * radius * square(1) * [ratio, 1]], -1, height, PLAN)
    return over.common(under), ratio * np.pi * height**2 * (sphere - height / 3)


def filled(solid, spacing, placement):
    mesh = solid.mesh()
    body = Body(mesh.vertices.astype(np.float32), mesh.triangles)
    lattice = Lattice(np.array([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)]), spacing)
    return body, *fill_body(body, body.stretches(*lattice.columns()), lattice, placement, seed=3)


@pytest.mark.parametrize("placement", PLACEMENTS)
@given(
    shape=st.sampled_from([box, wedge]),
    half=st.floats(3, 8),
    height=st.floats(3, 8),
    spacing=st.floats(0.25, 0.4),
)
@settings(max_examples=8)
def test_boxes_and_wedges(placement, shape, half, height, spacing):
    solid, volume = shape(half, height)
    assert solid.volume == pytest.approx(volume, rel=1e-6)
    body, positions, volumes = filled(solid, spacing, placement)
    slack = VOLUME_TOLERANCE[placement] * volume + thin_edge(shape, half, height, spacing)
    assert volumes.sum(dtype=np.float64) == pytest.approx(volume, abs=slack)
    assert body.inside(positions).all()
    inside = (np.abs(positions[:, :2]) <= half).all(axis=1) & (positions[:, 2] >= 0)
    assert inside.all()
    if shape is wedge:
        assert (positions[:, 2] <= (positions[:, 0] + half) / (2 * half) * height + 1e-5).all()


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("ratio", [1.0, 1.8])
def test_ellipsoid_caps(placement, ratio):
    solid, volume = cap(radius=6, height=3, ratio=ratio)
    assert solid.volume == pytest.approx(volume, rel=0.001)
    _, positions, volumes = filled(solid, 0.25, placement)
    assert volumes.sum(dtype=np.float64) == pytest.approx(volume, rel=VOLUME_TOLERANCE[placement])
    sphere = (6**2 + 3**2) / 6
    x, y, z = positions.T
    assert ((x / ratio) ** 2 + y**2 + (z - sphere) ** 2 <= (1.002 * sphere) ** 2).all()
    # the centroid of a cap lies (2 r - h)^2 (3 / 4) / (3 r - h) from the sphere's middle
    centroid = sphere - 0.75 * (2 * sphere - 3) ** 2 / (3 * sphere - 3)
    assert np.average(z, weights=volumes) == pytest.approx(centroid, abs=0.02)


def test_blue_noise_keeps_its_distance():
    tile = blue_noise_tile(3)
    assert tile.shape == (TILE**3, 3)
    distance = cKDTree(tile, boxsize=TILE).query(tile, k=2)[0][:, 1]
    assert distance.min() >= LEAST_DISTANCE
    _, positions, _ = filled(box(5, 5)[0], 0.3, "poisson_disk")
    assert cKDTree(positions).query(positions, k=2)[0][:, 1].min() >= LEAST_DISTANCE * 0.3 - 1e-5


def test_jittered_particles_are_not_on_a_lattice_and_stay_in_their_cells():
    _, regular, volumes = filled(box(4, 4)[0], 0.5, "lattice")
    _, moved, _ = filled(box(4, 4)[0], 0.5, "jittered")
    shift = np.abs(moved - regular)
    assert shift.max() <= 0.25 + 1e-5
    assert shift.mean() == pytest.approx(0.125, rel=0.05)
    assert (volumes > 0).all()


@pytest.mark.parametrize("placement", PLACEMENTS)
def test_the_seed_decides(placement):
    _, first, _ = filled(box(3, 3)[0], 0.4, placement)
    _, second, _ = filled(box(3, 3)[0], 0.4, placement)
    np.testing.assert_array_equal(first, second)
