"""A run's products as other programs' files, read back."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slideframe.cli import main
from slideframe.coupling import Coupling
from slideframe.errors import InputError, StoreError
from slideframe.exporting import Exporter, turned_cloud
from slideframe.formats.colmap import read_colmap_views
from slideframe.formats.particle_ply import write_particle_ply
from slideframe.formats.splat_ply import read_splat_ply
from slideframe.formats.transforms_json import read_transforms_json
from slideframe.geodesy import ecef_from_geodetic
from slideframe.harmonics import basis
from slideframe.problem import OrbitView
from slideframe.products import ParticleFrame, Picture
from slideframe.rotations import rotation_matrices
from slideframe.run_folder import RESULT
from slideframe.store import Store
from slideframe.stored_run import StoredRun
from slideframe.testing.ground_scenes import hillside_filling, hillside_splats, hillside_survey, moving_frames

COUNT = 3
# float32 through logarithms and logits of the file
FILE_ROUNDING = 1e-5


@pytest.fixture
def run(tmp_path: Path) -> StoredRun:
    """A finished run of a hillside that slides, with depth maps."""
    store, filling = Store(tmp_path / "store"), hillside_filling()
    frames = moving_frames(filling, frame_count=COUNT, step=0.5)
    grey = np.full((32, 64, 3), 90, np.uint8)
    depth = np.full((32, 64), 12.5, np.float32)
    pictures = [Picture(time=frame.time, pixels=grey + 10 * i, depth=depth + i) for i, frame in enumerate(frames)]
    for kind, product in (
        ("pose_source", hillside_survey()), ("reconstructor", hillside_splats()), ("volume_filler", filling)
    ):  # fmt: skip
        store.entry(kind, "k").write(product, dict)
    store.entry("solver", "k").write_stream(frames, dict)
    store.entry("renderer", "k").write_stream(pictures, dict)
    config = {
        "site": {"photographs": "nowhere"},
        "region": {"x_min": -6, "x_max": 6, "y_min": -5, "y_max": 5, "z_min": 0},
        "material": {"friction_angle": 22, "density": 2000, "youngs_modulus": 5e7, "poisson_ratio": 0.3},
        "simulation": {"duration": 0.2, "frame_rate": 10, "grid_spacing": 1},
        "view": {"width": 64, "height": 32, "turn": 90, "maps": ["depth"]},
    }
    kinds = ("pose_source", "reconstructor", "volume_filler", "solver", "renderer")
    folder = tmp_path / "run"
    folder.mkdir()
    result = {"keys": dict.fromkeys(kinds, "k"), "outputs": {"store": str(store.folder), "config": config}}
    (folder / RESULT).write_text(json.dumps(result))
    return StoredRun(folder)


def export(run: StoredRun, *arguments: str) -> Path:
    assert main(["export", str(run.folder), *arguments]) == 0
    return run.folder / "export"


def test_splats_of_a_frame_are_where_the_ground_took_them(run):
    folder = export(run, "--frame", "1")
    read = read_splat_ply(folder / "splats-000001.ply")
    moved = Coupling(run.splats, run.filling).at(run.motion[1])
    np.testing.assert_allclose(read.centers, moved.centers, atol=FILE_ROUNDING)
    np.testing.assert_allclose(read.scales, moved.scales, rtol=FILE_ROUNDING)
    assert json.loads((folder / "sequence.json").read_text())["seconds"] == {"splats-000001.ply": 0.1}


def test_a_sequence_is_numbered_and_keeps_one_order(run):
    folder = export(run, "--what", "sequence", "--every", "2")
    assert sorted(path.name for path in folder.glob("*.ply")) == ["splats-000000.ply", "splats-000002.ply"]
    export(run, "--frame", "1")  # one more: the times of those that are there stay
    times = json.loads((folder / "sequence.json").read_text())["seconds"]
    assert times == {f"splats-{index:06d}.ply": pytest.approx(0.1 * index) for index in range(3)}
    first, last = (read_splat_ply(folder / f"splats-{index:06d}.ply") for index in (0, 2))
    assert len(first) == len(last)
    np.testing.assert_allclose(first.centers[: len(run.splats)], run.splats.centers, atol=FILE_ROUNDING)


def test_particles_are_points_with_what_they_carry(run, tmp_path):
    folder = export(run, "--what", "particles", "--every", "2")
    assert {path.name for path in folder.glob("p*.ply")} == {"particles-000000.ply", "particles-000002.ply"}
    frame, count = run.motion[2], len(run.filling.particle_positions)
    names, table = read_points(folder / "particles-000002.ply", count)
    assert names == ["x", "y", "z", "velocity_x", "velocity_y", "velocity_z"]
    np.testing.assert_array_equal(table, np.hstack([frame.positions, frame.velocities]))
    values = {
        name: np.full(count, value, np.float32)
        for value, name in enumerate(("mean_stresses", "deviatoric_stresses", "plastic_strains"))
    }
    write_particle_ply(frame.model_copy(update=values), tmp_path / "stressed.ply")
    names, table = read_points(tmp_path / "stressed.ply", count)
    assert names[6:] == ["mean_stress", "deviatoric_stress", "plastic_strain"]
    assert table[:, 6:].mean(axis=0).tolist() == [0, 1, 2]


def read_points(path: Path, count: int) -> tuple[list[str], np.ndarray]:
    header, _, data = path.read_bytes().partition(b"end_header\n")
    names = [line.split()[-1] for line in header.decode().splitlines() if line.startswith("property float")]
    assert f"element vertex {count}" in header.decode()
    return names, np.frombuffer(data, "<f4").reshape(count, len(names))


def test_harmonics_turn_with_the_ground():
    """Seen along R d, a turned splat has the colour that it had along d."""
    splats = hillside_splats()
    random = np.random.default_rng(0)
    harmonics = (0.2 * random.normal(size=(len(splats), 16, 3))).astype(np.float32)
    splats = splats.model_copy(update={"harmonics": harmonics})
    filling = hillside_filling()
    R = rotation_matrices(np.array([[0.8, 0.3, -0.4, 0.2]]))[0]
    start = filling.particle_positions
    turned = ParticleFrame(
        time=1.0,
        positions=(start @ R.T).astype(np.float32),
        velocities=0 * start,
        deformation_gradients=np.tile(R.astype(np.float32), (len(start), 1, 1)),
    )
    cloud = turned_cloud(Coupling(splats, filling).at(turned))
    moving = np.flatnonzero(filling.surface_particles >= 0)
    direction = np.array([0.6, -0.48, 0.64])
    before = np.einsum("k,pkc->pc", basis(direction), harmonics[moving])
    after = np.einsum("k,pkc->pc", basis(R @ direction), cloud.harmonics[moving])
    np.testing.assert_allclose(after, before, atol=1e-5)
    still = np.flatnonzero(filling.surface_particles < 0)
    np.testing.assert_allclose(cloud.harmonics[still], harmonics[still], atol=1e-6)


def test_the_sidecar_says_where_the_file_is(run):
    content = json.loads((export(run) / "georeference.json").read_text())
    origin = run.survey.georeference
    assert content["geodetic"]["epsg"] == 4979
    assert content["geodetic"]["origin"] == [origin.latitude, origin.longitude, origin.ellipsoidal_height]
    matrix = np.array(content["geocentric"]["from_local"])
    # 100 m up is 100 m more of height above the ellipsoid
    above = ecef_from_geodetic(np.array([[origin.latitude, origin.longitude, origin.ellipsoidal_height + 100]]))[0]
    np.testing.assert_allclose(matrix @ [0, 0, 100, 1], [*above, 1], atol=1e-6)


def test_the_sidecar_knows_a_projected_system(run):
    pytest.importorskip("pyproj")
    content = json.loads((export(run, "--epsg", "32650") / "georeference.json").read_text())
    east, north, height = content["projected"]["origin"]
    assert (round(east / 1e5), round(north / 1e5), height) == (2, 25, pytest.approx(100))


def test_cameras_of_survey_and_film_go_to_both_formats(run):
    folder = export(run, "--what", "cameras")
    for name, count in (("survey_cameras", 4), ("film_cameras", COUNT)):
        views = read_colmap_views(folder / name)
        assert len(views) == count
        for one, other in zip(views, read_transforms_json(folder / name / "transforms.json"), strict=True):
            np.testing.assert_allclose(one.world_from_camera, other.world_from_camera, atol=1e-9)
    shot = OrbitView(width=64, height=32, turn=90).shot(run.survey, run.showing.bounds)
    np.testing.assert_allclose(views[1].world_from_camera, shot(0.5)[1], atol=1e-9)


def test_frames_and_maps_are_the_film_s(run):
    folder = export(run, "--what", "frames")
    np.testing.assert_array_equal(np.asarray(Image.open(folder / "frames" / "000002.png")), run.film[2].pixels)
    export(run, "--what", "frames", "--overlay")
    marked = np.asarray(Image.open(folder / "frames" / "000002.png"))
    assert (marked != run.film[2].pixels).any()
    export(run, "--what", "maps")
    np.testing.assert_array_equal(np.asarray(Image.open(folder / "depth" / "000001.tif")), run.film[1].depth)


@pytest.mark.parametrize("codec", ["h264", "av1"])
def test_the_film_can_be_written_anew(run, codec):
    pytest.importorskip("av")
    from slideframe.formats.video import read_frames

    folder = export(run, "--what", "film", "--codec", codec)
    frames = list(read_frames(folder / f"film-{codec}.mp4"))
    assert len(frames) == COUNT
    # flat grey survives the coding to a level or two
    np.testing.assert_allclose([frame.mean() for frame in frames], [90, 100, 110], atol=2)


def test_what_isn_t_there_is_said(run, tmp_path, capsys):
    assert main(["export", str(run.folder), "--frame", "7"]) == 2
    assert "the motion has 3" in capsys.readouterr().err
    assert main(["export", str(tmp_path)]) == 2
    assert "no finished run" in capsys.readouterr().err
    (Path(run.folder).parent / "store" / "solver-k" / "manifest.json").unlink()
    assert main(["export", str(run.folder)]) == 2
    assert "no longer holds" in capsys.readouterr().err


def test_a_file_in_the_way_leaves_no_half_file(run, tmp_path):
    folder = tmp_path / "taken"
    folder.write_text("a file")
    with pytest.raises(StoreError, match="file stands in the way"):
        Exporter(run, folder).splats([0], ".ply", lambda done, total: None)


def test_a_film_without_maps_has_none_to_write(run):
    bare = StoredRun(run.folder)
    bare.__dict__["config"] = run.config.model_copy(update={"view": OrbitView()})
    with pytest.raises(InputError, match="keeps no maps"):
        Exporter(bare, run.folder / "export").maps([0], lambda done, total: None)
