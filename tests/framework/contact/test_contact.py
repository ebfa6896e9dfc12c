"""Signed distance near surfaces whose distance is known, steep and overhanging ones among them."""

import numpy as np
import pytest

from slideframe.contact import Body, TriangleMesh, ground_contact, merge, solid_nodes
from slideframe.contact.distance import closest_points, near_nodes
from slideframe.errors import InputError
from slideframe.problem import Boundary, Grid, Wall
from slideframe.testing.solver_scenes import block_filling, sand_problem

GRID = Grid(origin=(-2.0, -2.0, -2.0), spacing=0.25, shape=(17, 17, 17), high=(13, 13))


def sphere(radius, rings=24):
    """A closed ball about the origin, counter-clockwise seen from outside."""
    polar, around = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1)
    p, a = np.meshgrid(polar, around, indexing="ij")
    vertices = radius * np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=-1).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(p.shape)
    one, two, three, four = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((one, two, three), (one, three, four))]
    return TriangleMesh.welded(vertices, np.concatenate(faces))


def sheet(heights, low=-1.9, high=1.9):
    """The graph z = heights(x, y) over a square, seen from above."""
    steps = np.linspace(low, high, 20)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    vertices = np.stack([x, y, heights(x, y)], axis=-1).reshape(-1, 3)
    index = np.arange(400).reshape(20, 20)
    one, two, three, four = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((one, two, three), (one, three, four))]
    return vertices, np.concatenate(faces)


@pytest.mark.parametrize("inside_out", [False, True])
def test_distance_to_a_ball_from_both_sides(inside_out):
    """The ball's upper half is a dome, its lower half overhangs; turned inside out it is a cave."""
    ball = sphere(1.3)
    mesh = TriangleMesh(ball.vertices, ball.triangles[:, ::-1]) if inside_out else ball
    near = near_nodes(mesh, GRID, 3.0)
    points = np.array(GRID.origin) + GRID.spacing * near.nodes
    radius = np.linalg.norm(points, axis=1)
    sign = -1 if inside_out else 1
    # the facets cut the ball by up to 1.3 (1 - cos(pi / 48)) = 3 mm in either direction
    assert np.abs(near.distances - sign * (radius - 1.3)).max() < 6e-3
    far = (np.abs(radius - 1.3) > 0.02) & (radius > 0.3)
    outward = sign * points[far] / radius[far, None]
    assert ((near.normals[far] * outward).sum(axis=1) > 0.995).all()
    assert not near.at_border.any()
    expected = (np.abs(np.linalg.norm(np.indices(GRID.shape).reshape(3, -1).T * 0.25 - 2, axis=1) - 1.3) < 0.74).sum()
    assert len(near.nodes) >= expected


def test_a_thin_wall_has_two_right_sides():
    """Nodes outside a plate thinner than a cell are outside, whichever of its faces is nearer."""
    plate = sphere(1.0)
    thin = TriangleMesh(plate.vertices * [1.5, 0.08, 1.5], plate.triangles)
    near = near_nodes(thin, GRID, 3.0)
    points = np.array(GRID.origin) + GRID.spacing * near.nodes
    inside = ((points / [1.5, 0.08, 1.5]) ** 2).sum(axis=1) < 1
    clear = np.abs(near.distances) > 0.02
    assert ((near.distances < 0) == inside)[clear].all()


def test_normals_of_a_vertical_face_are_level():
    x = np.array([[0.3, -1.9, -1.9], [0.3, 1.9, -1.9], [0.3, 1.9, 1.9], [0.3, -1.9, 1.9]])
    wall = Body("wall", "here", TriangleMesh.welded(x, np.array([[0, 1, 2], [0, 2, 3]])), Wall())
    nodes, normals = merge([solid_nodes(wall, GRID)], GRID).indices()
    assert len(nodes) > 100
    np.testing.assert_allclose(normals[:, :3], [[1, 0, 0]] * len(nodes), atol=1e-9)
    assert (nodes[:, 0] * 0.25 - 2 <= 0.3).all()


def test_two_triangles_too_large_for_one_box_are_searched_piece_by_piece():
    corners = np.array([[-1.9, -1.9, -1.5], [1.9, -1.9, -1.5], [1.9, 1.9, 1.6], [-1.9, 1.9, 1.6]])
    near = near_nodes(TriangleMesh.welded(corners, np.array([[0, 1, 2], [0, 2, 3]])), GRID, 3.0)
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    normal /= np.linalg.norm(normal)
    points = np.array(GRID.origin) + GRID.spacing * near.nodes
    inner = ~near.at_border
    np.testing.assert_allclose(near.distances[inner], ((points - corners[0]) @ normal)[inner], atol=1e-9)
    assert inner.sum() > 500


def test_the_nearest_of_all_triangles_is_found_whatever_their_sizes():
    """Against a search through all pairs: slivers, large and tiny triangles beside one another."""
    rng = np.random.default_rng(5)
    sizes = np.exp(rng.uniform(np.log(0.01), np.log(3), 120))
    corners = rng.uniform(-2, 2, (120, 1, 3)) + sizes[:, None, None] * rng.normal(size=(120, 3, 3))
    corners[::3, 2] = corners[::3, 0] + 0.02 * rng.normal(size=(40, 3))
    mesh = TriangleMesh.welded(corners.reshape(-1, 3), np.arange(360).reshape(-1, 3))
    near = near_nodes(mesh, GRID, 3.0)
    nodes = np.indices(GRID.shape).reshape(3, -1).T
    points = np.array(GRID.origin) + GRID.spacing * nodes
    best = np.full(len(points), np.inf)
    for triangle in mesh.corners:
        closest, _ = closest_points(points, np.tile(triangle, (len(points), 1, 1)))
        best = np.minimum(best, np.linalg.norm(points - closest, axis=1))
    within = best <= 3 * GRID.spacing
    assert 1000 < within.sum() < len(nodes)
    np.testing.assert_array_equal(near.nodes, nodes[within])
    np.testing.assert_allclose(np.abs(near.distances), best[within], atol=1e-12)


def test_closest_points_of_every_feature():
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    points = np.array([[-1.0, -1, 1], [2, -0.5, 0], [-0.5, 2, 0], [0.5, -1, 0], [1, 1, 2], [-1, 0.5, 0], [0.2, 0.2, 3]])
    closest, feature = closest_points(points, np.tile(triangle, (7, 1, 1)))
    assert feature.tolist() == [0, 1, 2, 3, 4, 5, 6]
    expected = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0], [0.2, 0.2, 0]]
    np.testing.assert_allclose(closest, expected, atol=1e-15)


def test_of_two_bodies_the_deeper_one_acts():
    low, high = (sheet(lambda x, y, z=z: np.full_like(x, z)) for z in (-0.4, 0.1))
    walls = {"low": (low, Wall()), "high": (high, Wall(kind="stick"))}
    bodies = [Body(name, "here", TriangleMesh.welded(*mesh), wall) for name, (mesh, wall) in walls.items()]
    nodes, normals = merge([solid_nodes(body, GRID) for body in bodies], GRID).indices()
    shared = normals[nodes[:, 2] * 0.25 - 2 == -0.5]
    assert len(shared)
    assert (shared[:, 3] == Wall(kind="stick").coefficient).all()


def problem_on(vertices, triangles, filling, **changes):
    boundary = Boundary(terrain=Wall(kind="friction", friction_angle=20))
    filling = filling.model_copy(
        update={"terrain_vertices": vertices.astype(np.float32), "terrain_triangles": triangles.astype(np.int32)}
    )
    return filling, sand_problem().model_copy(update={"boundary": boundary} | changes)


def test_a_hole_in_the_ground_is_refused_and_located():
    vertices, triangles = sheet(lambda x, y: 0 * x, low=0, high=4)
    middle = vertices[triangles].mean(axis=1)
    holed = triangles[np.linalg.norm(middle[:, :2] - [2, 3], axis=1) > 0.5]
    filling, problem = problem_on(vertices, holed, block_filling((1, 0, 0.1), (2, 0.5, 0.6)))
    with pytest.raises(InputError, match=r"1 holes wider than a cell, the first around \(2\.\d+, 3\.\d+"):
        ground_contact(filling, problem, problem.grid(filling))


def tube(angles=8):
    """Return an open tube of unit radius along x from 0 to 2, its axis at height 3, and two rings of triangles."""
    turn = 2 * np.pi * (np.arange(angles) + 0.5) / angles
    ring = np.column_stack([0 * turn, np.cos(turn), 3 + np.sin(turn)])
    vertices = np.concatenate([ring + np.array([x, 0, 0]) for x in (0, 1, 2)])
    one = np.arange(angles)
    other = (one + 1) % angles
    band = np.concatenate(
        [np.column_stack([one, other, one + angles]), np.column_stack([other, other + angles, one + angles])]
    )
    return vertices, np.concatenate([band, band + angles])


def test_where_a_survey_was_cut_is_no_hole_but_a_gap_in_a_wall_at_the_side_is():
    vertices, triangles = tube()
    assert TriangleMesh.welded(vertices, triangles).holes() == []
    assert len(TriangleMesh.welded(vertices, triangles).gaps()) == 2
    ground, faces = sheet(lambda x, y: 0 * x, low=0, high=4)
    upright = ground[:, [2, 0, 1]]
    middle = upright[faces].mean(axis=1)
    holed = faces[np.linalg.norm(middle[:, 1:] - [2, 3], axis=1) > 0.5]
    assert len(TriangleMesh.welded(upright, holed).holes()) == 1


def test_ground_through_the_mass_is_refused():
    filling, problem = problem_on(
        *sheet(lambda x, y: 0 * x + 1.0, low=-1, high=5), block_filling((1, 0, 0.1), (2, 0.5, 0.9))
    )
    with pytest.raises(InputError, match="passes through the mass"):
        ground_contact(filling, problem, problem.grid(filling))


def test_wanted_ground_that_is_missing_is_refused():
    filling, problem = problem_on(np.zeros((0, 3)), np.zeros((0, 3)), block_filling((1, 0, 0.1), (2, 0.5, 0.9)))
    with pytest.raises(InputError, match="no terrain"):
        ground_contact(filling, problem, problem.grid(filling))


def test_open_ground_costs_nothing():
    filling = block_filling((1, 0, 0.1), (2, 0.5, 0.9))
    problem = sand_problem()
    assert len(ground_contact(filling, problem, problem.grid(filling)).indices()[0]) == 0
