"""What the recording shows of a filled volume, on a pit known by formula."""

import numpy as np
import pytest

from slideframe.problem import Boundary, ColliderMesh
from slideframe.products import Filling, Georeference, SplatCloud
from slideframe.quality.surface import SurfaceComparison
from slideframe.record import Recording, log_bodies, log_filling
from slideframe.record.section import Profile, draw_section
from slideframe.record.volume import SUPPORT_COLORS, on_fences, slip_faces
from slideframe.release.plan import Plan
from slideframe.verification.terrain import slab

PLAN = Plan((np.array([[-2.0, -2], [2, -2], [2, 2], [-2, 2]]),))


def sheet(height):
    axis = np.arange(-6.0, 7.0)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    corner = np.arange(169).reshape(13, 13)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return vertices.astype(np.float32), triangles.astype(np.int32)


@pytest.fixture
def filling():
    """A slope of 1 in 2 with a bowl 1.5 m deep at most below the square of the plan."""
    vertices, triangles = sheet(lambda x, y: 0.5 * y)
    depth = 1.5 * np.maximum(1 - (vertices[:, 0] / 2) ** 2, 0) * np.maximum(1 - (vertices[:, 1] / 2) ** 2, 0)
    dug = vertices - np.column_stack([np.zeros((169, 2)), depth]).astype(np.float32)
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-1.75, 2, 0.5), np.arange(-1.75, 2, 0.5)))
    particles = np.column_stack([x, y, 0.5 * y - 0.25]).astype(np.float32)
    return Filling(
        bounds=np.array([[-2, -2, -2.5], [2, 2, 1.0]]),
        particle_positions=particles,
        particle_volumes=np.full(64, 0.125, np.float32),
        interior=SplatCloud.empty(),
        interior_particles=np.zeros(0, np.int32),
        surface_particles=np.array([-1, 3, 3, 7], np.int32),
        surface_vertices=vertices,
        surface_triangles=triangles,
        surface_support=(np.abs(vertices[:, 0]) > 5).astype(np.uint8) * np.uint8(2),
        terrain_vertices=dug,
        terrain_triangles=triangles,
    )


def test_bodies_from_files_are_shown_where_they_stand(tmp_path):
    path = tmp_path / "slab.obj"
    path.write_text(slab(np.array([[0.0, 0, 1], [2, 0, 1], [2, 3, 1], [0, 3, 1]]), np.array([0.0, 0, 1])))
    logged = {}

    class Stream:
        def log(self, entity, mesh, static):
            logged[entity] = mesh

    origin = Georeference(latitude=22.0, longitude=114.0, ellipsoidal_height=0.0)
    log_bodies(Stream(), Boundary(meshes=(ColliderMesh(path=path),)), origin)
    corners = np.array(logged["boundary/0"].vertex_positions.as_arrow_array().to_pylist())
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[0, 0, -0.5], [2, 3, 1]])
    assert len(corners) == 36


def test_slip_faces_are_those_that_are_not_scanned_ground(filling):
    faces = slip_faces(filling, PLAN)
    middles = filling.terrain_vertices[faces].mean(axis=1)
    # every triangle with one of the nine vertices within the square
    assert len(faces) == 2 * 16 - 2
    assert (np.abs(middles[:, :2]) < 2).all()
    assert not len(slip_faces(filling.model_copy(update={"terrain_vertices": filling.surface_vertices}), PLAN))


def test_recording_holds_every_part(filling, tmp_path):
    reader = pytest.importorskip("rerun.chunk").RrdReader
    recording = Recording(tmp_path / "volume.rrd", "volume")
    log_filling(recording.stream, filling, PLAN)
    recording.close()
    store = reader(str(tmp_path / "volume.rrd")).store()
    entities = {path for path in store.schema().entity_paths() if path.startswith("/volume")}
    names = ("surface", "outline", "slip_surface", "by_depth", "by_origin", "section", "numbers")
    assert entities == {f"/volume/{name}" for name in names}


def test_numbers_are_the_filling_s(filling, tmp_path, monkeypatch):
    logged = {}

    class Stream:
        def log(self, entity, archetype, *, static):
            assert static
            logged[entity] = archetype

    log_filling(Stream(), filling, PLAN)
    text = logged["volume/numbers"].text.as_arrow_array()[0].as_py()
    assert "| volume | 8.0 m³ |" in text
    assert "| mean depth of the soil below ground | 0.25 m |" in text
    assert "| observed splats that move | 3 |" in text
    assert "| surface around the mass: observed | 100.0% |" in text
    outline = np.array(logged["volume/outline"].strips.as_arrow_array()[0].as_py())
    np.testing.assert_allclose(outline[:, 2] - 0.5 * outline[:, 1], 0.15, atol=1e-4)
    assert np.abs(outline[:, :2]).max() == 2


def test_numbers_and_map_tell_of_the_reference_ground(filling, tmp_path):
    pytest.importorskip("rerun.chunk")
    axis = np.arange(-1.75, 2, 0.5)
    comparison = SurfaceComparison(axis, axis, np.full((8, 8), 0.12), 1.0)
    figures = comparison.figures(0.3) | {"plan_area_m2": 16.0, "observed_share": 0.75}
    logged = {}

    class Stream:
        def log(self, entity, archetype, *, static):
            logged[entity] = archetype

    log_filling(Stream(), filling, PLAN, figures, comparison)
    text = logged["volume/numbers"].text.as_arrow_array()[0].as_py()
    for row in (
        "| plan area | 16.0 m² |",
        "| ground of the region: observed | 75.0% |",
        "| surface off the reference ground: RMSE | 0.120 m |",
        "| … in splat spacings | 0.40 |",
        "| … mean (positive: too high) | +0.120 m |",
    ):
        assert row in text
    assert "surface around the mass" not in text  # the filler's own shares stand for it
    assert "volume/difference" in logged


def test_fences_open_the_view_into_the_mass(filling):
    """Upright planes down and across the slope: from the air one sees between them."""
    axis = np.arange(-4.75, 5, 0.5)
    x, y, z = (grid.ravel() for grid in np.meshgrid(axis, axis, np.arange(-3.75, 0, 0.5)))
    block = filling.model_copy(
        update={
            "particle_positions": np.column_stack([x, y, z + 0.5 * y]).astype(np.float32),
            "particle_volumes": np.full(x.size, 0.125, np.float32),
            "surface_particles": np.zeros(0, np.int32),
        }
    )
    fence = on_fences(block)
    assert 0.3 < fence.mean() < 0.8
    columns = {tuple(place) for place in block.particle_positions[fence][:, :2].tolist()}
    assert fence.sum() == len(columns) * 8  # whole columns, from the top to the bottom
    assert not any(abs(east) < 1 and abs(north) < 1 for east, north in columns)


def test_a_filling_without_surface_or_terrain_is_recorded_too(filling, tmp_path):
    bare = filling.model_copy(
        update={
            "surface_triangles": np.zeros((0, 3), np.int32),
            "terrain_vertices": np.zeros((0, 3), np.float32),
            "terrain_triangles": np.zeros((0, 3), np.int32),
        }
    )
    recording = Recording(tmp_path / "bare.rrd", "bare")
    log_filling(recording.stream, bare, PLAN)
    recording.close()
    assert (tmp_path / "bare.rrd").stat().st_size > 0


def test_section_shows_mass_between_ground_and_terrain():
    distance = np.linspace(0, 40, 401)
    ground = 20 - 0.5 * distance
    terrain = ground - np.where(np.abs(distance - 20) < 8, 3.0, 0.0)
    support = np.where(distance < 10, 0, 1).astype(np.uint8)
    profile = Profile(distance, ground, terrain, support, np.zeros((0, 2)), 0.5, 180.0)
    pixels = np.asarray(draw_section(profile, SUPPORT_COLORS)).reshape(-1, 3)
    counts = {
        name: (pixels == color).all(axis=1).sum()
        for name, color in (("mass", (176, 122, 78)), ("terrain", (84, 78, 74)), ("seen", SUPPORT_COLORS[0]))
    }
    # 16 m by 3 m of mass at the scale of 868 px for 40 m, or what the height of the picture allows
    scale = min((960 - 92) / 40, (480 - 138) / 20.0)
    assert counts["mass"] == pytest.approx(16 * 3 * scale**2, rel=0.1)
    assert counts["terrain"] > 3 * counts["mass"]
    assert counts["seen"] > 100
