"""Splats from another frame come to lie where the survey has them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slideframe.errors import InputError
from slideframe.formats.colmap import write_colmap_views
from slideframe.formats.posed_camera import PosedCamera, posed_cameras
from slideframe.formats.splat_file import write_splats
from slideframe.formats.transforms_json import write_transforms_json
from slideframe.products import SplatCloud, Survey
from slideframe.testing.evidence import fresh_context
from slideframe.testing.ground_scenes import hillside_splats, hillside_survey
from slideframe_gs_import.reconstructor import ImportedSplats, moved
from slideframe_gs_import.similarity import Similarity, between_cameras

# The frame of another program: a tenth of the size, turned and shifted. Its inverse brings the splats back.
ELSEWHERE = Similarity(
    0.1, Rotation.from_euler("xyz", [100, -20, 45], degrees=True).as_matrix(), np.array([3.0, 1, -2])
)
ROUNDING = 2e-5


def survey(places: np.ndarray) -> Survey:
    """Return photographs of different names at places (n, 3), each looking its own way."""
    base = hillside_survey()
    turns = Rotation.random(len(places), random_state=1).as_matrix()
    photographs = tuple(
        base.photographs[0].model_copy(update={"path": base.photographs[0].path.with_name(f"DJI_{index}.JPG")})
        for index in range(len(places))
    )
    poses = np.concatenate([turns, places[:, :, None]], axis=2)
    return base.model_copy(
        update={
            "photographs": photographs,
            "world_from_camera": poses,
            "position_sigma": np.full((len(places), 3), 0.02),
        }
    )


PLACES = np.random.default_rng(0).uniform([-20, -20, 20], [20, 20, 60], (6, 3))


def coloured(splats: SplatCloud) -> SplatCloud:
    harmonics = np.random.default_rng(1).normal(size=(len(splats), 16, 3)).astype(np.float32)
    return splats.model_copy(update={"harmonics": harmonics})


def views_elsewhere(of: Survey) -> list[PosedCamera]:
    """Return the survey's cameras as the other program has them, in a folder of its own and as PNG."""
    return [
        PosedCamera(
            f"images/{view.name.replace('.JPG', '.png')}",
            view.camera,
            np.column_stack(
                [ELSEWHERE.rotation @ view.world_from_camera[:, :3], ELSEWHERE.apply(view.world_from_camera[:, 3])]
            ),
        )
        for view in posed_cameras(of)
    ]


@pytest.mark.parametrize("form", ["transforms.json", "colmap"])
def test_splats_come_back_from_another_frame(form, tmp_path):
    here, scene = survey(PLACES), coloured(hillside_splats())
    write_splats(moved(scene, ELSEWHERE), tmp_path / "splats.ply")
    write = write_transforms_json if form == "transforms.json" else write_colmap_views
    write(views_elsewhere(here), tmp_path / form)
    context = fresh_context(tmp_path)
    found = ImportedSplats(splats=tmp_path / "splats.ply", cameras=tmp_path / form).reconstruct(here, context)
    np.testing.assert_allclose(found.centers, scene.centers, atol=1e-4)
    np.testing.assert_allclose(found.scales, scene.scales, rtol=1e-5)
    np.testing.assert_allclose(found.harmonics, scene.harmonics, atol=ROUNDING)
    assert np.abs((found.rotations * scene.rotations).sum(axis=1)).min() > 1 - 1e-6
    assert context.figures["scale_m_per_unit"] == pytest.approx(10, rel=1e-6)
    assert context.figures["camera_residual_m"] < 1e-6
    assert context.figures["matched_cameras"] == len(PLACES)


def test_cameras_on_one_line_leave_no_turn_open():
    line = survey(np.linspace([0, 0, 30], [40, 10, 30], 5))
    old = np.stack([view.world_from_camera for view in views_elsewhere(line)])
    found = between_cameras(old, line.world_from_camera)
    assert found.scale == pytest.approx(10)
    np.testing.assert_allclose(found.rotation @ ELSEWHERE.rotation, np.eye(3), atol=1e-9)


def test_splats_without_cameras_keep_their_bits(tmp_path):
    scene = hillside_splats()
    write_splats(scene, tmp_path / "splats.ply")
    found = ImportedSplats(splats=tmp_path / "splats.ply").reconstruct(hillside_survey(), fresh_context(tmp_path))
    assert np.array_equal(found.centers, scene.centers)


def test_a_frame_that_is_not_the_surveys_is_told(tmp_path):
    scene = moved(hillside_splats(), Similarity(1.0, np.eye(3), np.array([500.0, 0, 0])))
    write_splats(scene, tmp_path / "splats.ply")
    with pytest.raises(InputError, match=r"(?s)apart from the survey's points.*give 'cameras'"):
        ImportedSplats(splats=tmp_path / "splats.ply").reconstruct(hillside_survey(), fresh_context(tmp_path))


def test_cameras_of_other_photographs_are_refused(tmp_path):
    here = survey(PLACES)
    write_splats(hillside_splats(), tmp_path / "splats.ply")
    write_transforms_json(posed_cameras(survey(PLACES[::-1])), tmp_path / "transforms.json")
    stage = ImportedSplats(splats=tmp_path / "splats.ply", cameras=tmp_path / "transforms.json")
    with pytest.raises(InputError, match=r"don't fit those of the survey"):
        stage.reconstruct(here, fresh_context(tmp_path, "other"))
    write_transforms_json(posed_cameras(here)[:2], tmp_path / "transforms.json")
    with pytest.raises(InputError, match=r"2 of its 2 cameras bear the name"):
        stage.reconstruct(here, fresh_context(tmp_path))


def test_missing_files_are_told_at_preflight(tmp_path):
    with pytest.raises(InputError, match=r"splats = .*nowhere.ply"):
        ImportedSplats(splats=tmp_path / "nowhere.ply").preflight(None, None)
