"""What remains once the mass is taken out: a collider without gaps, and the splats of the scar."""

import numpy as np
import pytest

from slideframe_fill_poisson.filler import PoissonFiller
from slideframe_fill_poisson.rays import Body
from slideframe_fill_poisson.scar import FINENESS
from slideframe_fill_poisson.solids import rim_edges

SURFACE_TOLERANCE = 0.03


def slope(x, y):
    return 3 + 0.6 * y


@pytest.fixture(scope="module")
def filling(survey, make_splats, scatter, make_context, box):
    return PoissonFiller().fill(survey, make_splats(scatter(slope, reach=14)), box(half=4.0), make_context())


def normals_of(filling):
    corners = filling.terrain_vertices[filling.terrain_triangles].astype(np.float64)
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners.mean(axis=1)


def test_terrain_has_no_gap(filling):
    """Its only rim is the outer one: mass and terrain share the vertices of their seam."""
    vertices = filling.terrain_vertices
    rim = vertices[np.unique(rim_edges(filling.terrain_triangles))]
    assert len(rim)
    low, high = vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
    assert np.minimum(rim[:, :2] - low, high - rim[:, :2]).min(axis=1).max() == 0
    assert (high - low > 2 * (4 + 3)).all()  # it reaches well beyond the region


def test_terrain_is_ground_outside_and_slip_surface_inside(filling):
    normals, middle = normals_of(filling)
    area = np.linalg.norm(normals, axis=1) / 2
    units = normals / np.maximum(2 * area, 1e-12)[:, None]
    inside = (np.abs(middle[:, :2]) < 4 - 1e-4).all(axis=1)
    # the box goes from y = -4 to 4, and its base at z = 0 meets the ground at y = -5: all of the plan is pit
    assert area[inside].sum() == pytest.approx(64, rel=1e-3)
    assert (units[inside, 2] > 0.999).all()
    np.testing.assert_allclose(middle[inside, 2], 0, atol=1e-5)
    outside = (np.abs(middle[:, :2]) > 4 + 1e-4).any(axis=1)
    assert np.abs(middle[outside, 2] - slope(*middle[outside, :2].T)).max() < 3 * SURFACE_TOLERANCE
    assert (units[outside, 2] > 0).all()


def test_sides_of_the_pit_look_into_it(filling):
    normals, middle = normals_of(filling)
    area = np.linalg.norm(normals, axis=1) / 2
    at_side = np.abs(np.abs(middle[:, :2]) - 4) < 1e-4
    wall = at_side.any(axis=1) & (np.abs(normals[:, 2]) < 1e-3 * area) & (area > 1e-6)
    assert area[wall].sum() == pytest.approx(4 * 8 * 3, rel=0.01)
    towards = -(middle[wall, :2] * normals[wall, :2] * at_side[wall]).sum(axis=1)
    assert (towards > 0).all()


def test_scar_is_covered_and_hidden(filling):
    """Splats lie just under the pit's faces, cover them, and nowhere reach above the ground."""
    scar = filling.scar
    wide = FINENESS * 0.3  # m, as the surface's splats are 0.3 m apart
    floor = scar.centers[(np.abs(scar.centers[:, 2]) < 0.2) & (np.abs(scar.centers[:, :2]) < 3.95).all(axis=1)]
    near = np.array(
        [np.linalg.norm(floor[:, :2] - place, axis=1).min() for place in np.array(list(np.ndindex(7, 7))) - 3]
    )
    assert near.max() < wide
    assert (floor[:, 2] < 0).all()
    assert scar.scales[:, 0].max() < 0.12 * wide
    assert np.median(scar.scales[:, 1:]) > 0.5 * wide
    assert (scar.opacities > 0.95).all()
    solid = Body(filling.terrain_vertices, filling.terrain_triangles)
    assert solid.inside(scar.centers).mean() > 0.999  # a face that looks up stands over each
    tips = scar.centers[:, None] + 3 * np.concatenate([axes_of(scar), -axes_of(scar)], axis=1)
    within = (np.abs(tips[..., :2]) < 6).all(axis=-1)
    above = (tips[..., 2] - slope(tips[..., 0], tips[..., 1]))[within]
    assert above.max() < 2 * SURFACE_TOLERANCE  # the mesh, which holds them down, waves by one


def axes_of(splats):
    """Return the splats' axes times their scales (splat, axis, 3)."""
    w, x, y, z = splats.rotations.astype(np.float64).T
    columns = [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(columns), -1, 0) * splats.scales[:, :, None]
