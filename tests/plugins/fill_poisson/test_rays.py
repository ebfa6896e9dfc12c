"""Lines through closed meshes with overhangs, hollows and edges."""

import numpy as np

from slideframe_fill_poisson.rays import Body
from slideframe_fill_poisson.solids import SKIRT, upright_prism

FLOAT32_ROUNDING = 1e-5


def body_of(solid):
    mesh = solid.mesh()
    return Body(mesh.vertices.astype(np.float32), mesh.triangles)


def block(low, high, side=2.0):
    return upright_prism([np.array([[-side, -side], [side, -side], [side, side], [-side, side]])], low, high, SKIRT)


def hollow():
    """A block from -2 to 3 with a hollow from 0 to 2 in it, open to the east."""
    cave = upright_prism([np.array([[-1.0, -1], [5, -1], [5, 1], [-1, 1]])], 0, 2, SKIRT)
    return block(-2, 3).without(cave)


def test_stretches_around_a_hollow():
    stretches = body_of(hollow()).stretches(np.array([0.1, 0.7, -1.5, 9.0]), np.array([0.2, 0.9, 0.3, 9.0]))
    np.testing.assert_array_equal(stretches.lines, [0, 0, 1, 1, 2])
    np.testing.assert_allclose(stretches.tops, [3, 0, 3, 0, 3], atol=FLOAT32_ROUNDING)
    np.testing.assert_allclose(stretches.bottoms, [2, -2, 2, -2, -2], atol=FLOAT32_ROUNDING)


def test_inside():
    points = np.array([[0, 0, -1], [0, 0, 1], [0, 0, 2.5], [0, 0, 4], [0, 0, -3], [9, 9, 0]], np.float32)
    np.testing.assert_array_equal(body_of(hollow()).inside(points), [True, False, True, False, False, False])


def test_no_line_meets_the_body():
    stretches = body_of(block(0, 1)).stretches(np.array([50.0]), np.array([50.0]))
    assert len(stretches.lines) == len(stretches.tops) == len(stretches.bottoms) == 0
    assert len(body_of(block(0, 1)).stretches(np.zeros(0), np.zeros(0)).lines) == 0


def test_an_edge_counts_once():
    """Lines through the diagonal that two triangles share."""
    along = np.linspace(-1.9, 1.9, 400)
    for sign in (1, -1):
        stretches = body_of(block(0, 1)).stretches(along, sign * along)
        np.testing.assert_array_equal(stretches.lines, np.arange(400))
        np.testing.assert_allclose(stretches.tops - stretches.bottoms, 1, atol=FLOAT32_ROUNDING)
