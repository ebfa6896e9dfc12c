"""Bodies from files: what is accepted, what is refused and why, and that they act like the scanned ground."""

from types import SimpleNamespace

import numpy as np
import pytest

from slideframe.contact import ground_contact, require_at_site, require_sound_files
from slideframe.errors import ConfigurationError, InputError
from slideframe.geodesy import geodetic_from_enu
from slideframe.pipeline import _placed
from slideframe.problem import Boundary, ColliderMesh
from slideframe.products import Georeference
from slideframe.testing.solver_scenes import block_filling, sand_problem
from slideframe.verification.terrain import slab

ORIGIN = Georeference(latitude=22.35, longitude=114.18, ellipsoidal_height=120.0)
SQUARE = np.array([[0.2, -1.0, 0.3], [3.8, -1.0, 0.3], [3.8, 2.0, 0.3], [0.2, 2.0, 0.3]])
UP = np.array([0.0, 0.0, 1.0])


def edited(text, *, without=(), reverse=()):
    """An OBJ file's text with some of its faces, by number, left out or turned."""
    lines = text.splitlines()
    vertices, faces = [line for line in lines if line[0] == "v"], [line for line in lines if line[0] == "f"]
    kept = []
    for index, face in enumerate(faces):
        letter, a, b, c = face.split()
        kept += [] if index in without else [f"{letter} {a} {c} {b}" if index in reverse else face]
    return "\n".join([*vertices, *kept]) + "\n"


def moved(*way):
    return SQUARE + np.array(way)


@pytest.fixture
def body(tmp_path):
    def write(text, **more):
        path = tmp_path / "barrier.obj"
        path.write_text(text)
        return Boundary(meshes=(ColliderMesh(path=path, **more),))

    return write


def on_grid(boundary, low=(1.0, 0.0, 0.5), high=(2.0, 1.0, 1.0), **changes):
    problem = sand_problem().model_copy(update={"boundary": boundary} | changes)
    filling = block_filling(low, high)
    return ground_contact(filling, problem, problem.grid(filling))


def test_nodes_in_a_closed_body_know_the_way_out_and_the_friction(body):
    boundary = body(slab(SQUARE, UP), kind="friction", friction_angle=45.0)
    nodes, normals = on_grid(boundary).indices()
    heights = 0.25 * (nodes[:, 2] - 3)
    inner = (
        (np.abs(0.25 * (nodes[:, 0] - 3) - 2) < 1) & (np.abs(0.25 * (nodes[:, 1] - 3) - 0.5) < 0.9) & (heights > -0.3)
    )
    assert heights.max() == 0.25
    np.testing.assert_allclose(normals[inner], [[0, 0, 1, 1]] * inner.sum(), atol=1e-6)
    assert on_grid(boundary.settling()).indices()[1][:, 3].max() == -1.0


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (edited(slab(SQUARE, UP), without=(0,)), r"it's open: its border has 1 loops, the first around \(2\.00"),
        (edited(slab(SQUARE, UP), reverse=(2,)), r"3 edges lie between triangles that face opposite ways"),
        (edited(slab(SQUARE, UP), reverse=range(12)), r"the part around .* faces inwards"),
        (slab(SQUARE, UP) + "v 2 0 5\nf 1 2 9\n", r"1 edges have more than two triangles, the first at \(2\.00"),
    ],
    ids=["hole", "one triangle turned", "inside out", "a fin"],
)
def test_an_unsound_surface_is_refused_before_any_work(body, text, fault):
    with pytest.raises(InputError, match=fault) as refused:
        require_sound_files(body(text))
    assert refused.value.where == "boundary.meshes[0]"
    assert "barrier.obj" in str(refused.value)


def test_a_cavity_is_no_fault_and_a_closed_sheet_is(body):
    outer, inner = slab(SQUARE, UP), edited(slab(0.5 * SQUARE + [1, 0.2, -0.4], UP / 4), reverse=range(12))
    raised = [
        " ".join(["f", *(str(int(number) + 8) for number in line.split()[1:])]) if line[0] == "f" else line
        for line in inner.splitlines()
    ]
    require_sound_files(body(outer + "\n".join(raised)))
    with pytest.raises(InputError, match="it's closed"):
        require_sound_files(body(outer, surface="open"))


def test_an_open_sheet_is_solid_behind_its_front(body):
    sheet = edited(slab(SQUARE, UP), without=range(2, 12))
    nodes, normals = on_grid(body(sheet, surface="open")).indices()
    assert (0.25 * (nodes[:, 2] - 3)).max() == 0.25
    np.testing.assert_allclose(normals[:, :3], [[0, 0, 1]] * len(nodes), atol=1e-9)


def test_a_body_in_the_mass_is_refused(body):
    with pytest.raises(InputError, match=r"barrier\.obj passes through the mass: [5-7][0-9]%"):
        on_grid(body(slab(SQUARE, UP)), low=(1.0, 0.0, 0.0), high=(2.0, 1.0, 0.5))


def test_a_body_around_the_whole_mass_is_refused(body):
    far = SQUARE * 4 + [-6.0, 0.0, 3.0]
    with pytest.raises(InputError, match="passes through the mass: 100%"):
        on_grid(body(slab(far, 4 * UP)))


def test_a_body_that_is_no_barrier_is_refused(body):
    with pytest.raises(InputError, match=r"thinner than 1\.5 cells over 8[0-9]%"):
        on_grid(body(slab(SQUARE, UP / 5)))
    with pytest.raises(InputError, match="no node of the grid lies in the mesh"):
        on_grid(body(slab(moved(100, 0, 0), UP)))


def test_a_mesh_in_a_maps_coordinates_lies_where_the_local_one_does(body, tmp_path):
    pytest.importorskip("pyproj")
    local = on_grid(body(slab(SQUARE, UP)))
    corners = np.array([line.split()[1:] for line in slab(SQUARE, UP).splitlines() if line[0] == "v"], float)
    latitude, longitude, height = geodetic_from_enu(corners, ORIGIN).T
    rows = [f"v {x:.12f} {y:.12f} {z:.6f}" for x, y, z in zip(longitude, latitude, height, strict=True)]
    faces = [line for line in slab(SQUARE, UP).splitlines() if line[0] == "f"]
    boundary = body("\n".join([*rows, *faces]), epsg=4326)
    require_sound_files(boundary)
    with pytest.raises(ConfigurationError, match="the problem has no georeference"):
        on_grid(boundary)
    placed = on_grid(boundary, georeference=ORIGIN)
    np.testing.assert_array_equal(placed.columns, local.columns)
    # of two faces that are equally near either may act
    same = np.abs(placed.normals - local.normals).max(axis=1) < 1e-4
    assert same.mean() > 0.95
    assert (placed.normals[:, :3].any(axis=1) == local.normals[:, :3].any(axis=1)).all()


@pytest.mark.parametrize(("epsg", "whole", "expected"), [(4326, True, ORIGIN), (4326, False, None), (None, True, None)])
def test_the_pipeline_tells_the_solver_where_the_frame_is_if_a_mesh_needs_it(body, epsg, whole, expected):
    survey = SimpleNamespace(entry=SimpleNamespace(is_whole=whole), value=SimpleNamespace(georeference=ORIGIN))
    problem = sand_problem().model_copy(update={"boundary": body(slab(SQUARE, UP), epsg=epsg)})
    assert _placed(problem, survey).georeference == expected


def test_a_map_without_its_name_is_refused_at_once(body):
    with pytest.raises(ConfigurationError, match="looks like a map's coordinates"):
        require_sound_files(body(slab(moved(835000, 819000, 0), UP)))


def test_a_body_far_from_the_site_is_refused_with_both_extents(body):
    rng = np.random.default_rng(3)
    seen = rng.uniform([-30, -30, -5], [30, 30, 5], (500, 3)).astype(np.float32)
    require_at_site(body(slab(SQUARE, UP)), ORIGIN, seen)
    with pytest.raises(ConfigurationError, match="lies beside the site: from"):
        require_at_site(body(slab(moved(90, 0, 0), UP)), ORIGIN, seen)
    with pytest.raises(ConfigurationError, match="above or below the site") as refused:
        require_at_site(body(slab(moved(0, 0, -120), UP)), ORIGIN, seen)
    assert "vertical_epsg or geoid_offset" in refused.value.cure
