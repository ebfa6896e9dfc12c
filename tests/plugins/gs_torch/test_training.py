"""Training on a tiny scene with known splats, drawn by the rasteriser itself."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from slideframe.device import Device
from slideframe.errors import InputError, StageFailed
from slideframe.products import Camera, Georeference, Photograph, SplatCloud, Survey
from slideframe.rotations import rotation_matrices
from slideframe.stages import Context
from slideframe_gs_torch import training
from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.densification import densifier
from slideframe_gs_torch.densification.budgeted_splits import FEWEST_SHOWN, Schedule, densify
from slideframe_gs_torch.evaluation import draw_view
from slideframe_gs_torch.exposure import Exposures
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.parameters import Parameters
from slideframe_gs_torch.reconstructor import TorchSplats
from slideframe_gs_torch.training import mean_colour
from slideframe_gs_torch.views import TrainingView

CAMERA = Camera(width=96, height=72, focal_x=90.0, focal_y=90.0, principal_x=48.0, principal_y=36.0)
SKY = (0.62, 0.74, 0.86)
# the photographs below show this sky round a small piece of ground
OPTIONS = TorchSplats(
    iterations=250, splat_budget=1500, image_width=96, hold_out_every=5, background=SKY, settle_gain=0
)
# The scene's own splats reach 50 dB; a scene of one mean colour 15 dB; 250 iterations some 37 dB.
REACHED_PSNR_DB = 32.0


def ground(seed: int = 0, count: int = 900) -> SplatCloud:
    random = np.random.default_rng(seed)
    centers = np.column_stack([random.uniform(-6, 6, (count, 2)), 0.3 * random.normal(size=count)])
    stripes = np.where(np.sin(centers[:, :1] * 2) * np.cos(centers[:, 1:2] * 2) > 0, 0.9, -0.9)
    harmonics = stripes + 0.2 * random.normal(size=(count, 3))
    return SplatCloud(
        centers=centers.astype(np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.full((count, 3), 0.25, np.float32),
        opacities=np.full(count, 0.9, np.float32),
        harmonics=harmonics[:, None].astype(np.float32),
    )


def looking_down(x: float, y: float, tilt: float) -> np.ndarray:
    right, forward = np.array([1.0, 0, 0]), np.array([0, np.sin(tilt), -np.cos(tilt)])
    return np.column_stack([right, np.cross(forward, right), forward, [x, y, 10.0]])


def survey(folder: Path, splats: SplatCloud, points: np.ndarray) -> Survey:
    poses = [looking_down(x, y, tilt) for x in (-2, 0, 2) for y, tilt in ((-2, 0.2), (0, 0.0), (2, -0.2))]
    photographs = []
    for index, pose in enumerate(poses):
        view = TrainingView("", torch.zeros(3, 72, 96, dtype=torch.uint8), None, CAMERA, pose)
        picture = draw_view(splats, view, SKY).permute(1, 2, 0).mul(255).round().byte().numpy()
        Image.fromarray(picture).save(folder / f"{index}.png")
        photographs.append(Photograph(path=folder / f"{index}.png", camera=0, sha256=""))
    return Survey(
        georeference=Georeference(latitude=0, longitude=0, ellipsoidal_height=0),
        cameras=(CAMERA,),
        photographs=tuple(photographs),
        world_from_camera=np.array(poses),
        position_sigma=np.full((len(poses), 3), 0.02),
        sparse_points=points,
        sparse_colors=np.full((len(points), 3), 128, np.uint8),
        sparse_errors=np.ones(len(points), np.float32),
    )


@pytest.fixture(scope="module")
def flight(tmp_path_factory) -> Survey:
    splats = ground()
    points = splats.centers[::3] + 0.05 * np.random.default_rng(1).normal(size=(300, 3)).astype(np.float32)
    return survey(tmp_path_factory.mktemp("flight"), splats, points)


def context(folder: Path, **further) -> Context:
    folder.mkdir(parents=True, exist_ok=True)
    return Context(device=Device(), scratch=folder, **further)


@pytest.fixture(scope="module")
def unbroken(flight, tmp_path_factory) -> tuple[SplatCloud, Context]:
    surroundings = context(tmp_path_factory.mktemp("unbroken"))
    return OPTIONS.reconstruct(flight, surroundings), surroundings


def test_splats_look_like_photographs_held_out(unbroken):
    splats, surroundings = unbroken
    assert surroundings.figures["held_out_psnr_db"] > REACHED_PSNR_DB
    assert set(surroundings.figures["held_out_psnr_db_by_photograph"]) == {"0.png", "5.png"}
    assert surroundings.figures["splats"] == len(splats) <= OPTIONS.splat_budget
    assert len(splats) > 300


def test_no_exported_splat_is_above_the_limit(unbroken):
    splats, _ = unbroken
    assert (splats.scales.max(axis=1) <= OPTIONS.anisotropy_limit * splats.scales.min(axis=1)).all()


def test_a_run_cut_off_resumes_to_the_same_bits_with_its_photographs_on_disk(flight, unbroken, tmp_path):
    options = OPTIONS.model_copy(update={"photographs_megabytes": 0})

    def interrupt(done: float, total: float, figures: dict[str, float]) -> None:
        if done > training.CHECKPOINT_EVERY:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        options.reconstruct(flight, context(tmp_path, on_progress=interrupt))
    reports: list[float] = []
    resumed = options.reconstruct(
        flight, context(tmp_path, on_progress=lambda done, total, figures: reports.append(done))
    )
    assert min(reports) > training.CHECKPOINT_EVERY
    assert len(list((tmp_path / "photographs").iterdir())) == 3 * len(flight.photographs)
    assert resumed == unbroken[0]


@pytest.mark.parametrize("way", ["mcmc", "clone_and_split"])
def test_other_ways_of_densifying_learn_the_scene_within_the_budget_and_resume_to_the_same_bits(way, flight, tmp_path):
    options = OPTIONS.model_copy(update={"densification": way})

    def interrupt(done: float, total: float, figures: dict[str, float]) -> None:
        if done > training.CHECKPOINT_EVERY:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        options.reconstruct(flight, context(tmp_path / "broken", on_progress=interrupt))
    resumed = options.reconstruct(flight, context(tmp_path / "broken"))
    surroundings = context(tmp_path / "unbroken")
    splats = options.reconstruct(flight, surroundings)
    assert splats == resumed
    assert 300 < len(splats) <= options.splat_budget
    # fewer splats (clone_and_split) and more exploration (mcmc) need more than 250 iterations for the same likeness
    assert surroundings.figures["held_out_psnr_db"] > REACHED_PSNR_DB - 4


def test_training_that_no_longer_gains_ends_early(flight, tmp_path):
    patient = OPTIONS.model_copy(update={"settle_gain": 100.0})
    surroundings = context(tmp_path)
    patient.reconstruct(flight, surroundings)
    assert 0.85 * OPTIONS.iterations <= surroundings.figures["iterations"] < 0.95 * OPTIONS.iterations
    curve = surroundings.figures["held_out_psnr_db_by_second"]
    assert max(curve.values()) > next(iter(curve.values()))


def test_few_points_start_at_random_with_a_warning(flight, tmp_path):
    few = flight.model_copy(
        update={name: getattr(flight, name)[:5] for name in ("sparse_points", "sparse_colors", "sparse_errors")}
    )
    surroundings = context(tmp_path)
    splats = OPTIONS.model_copy(update={"iterations": 20}).reconstruct(few, surroundings)
    assert len(splats) > 100
    assert "5 sparse points" in surroundings.warnings[0]


def test_one_photograph_trains_and_says_that_nothing_is_measured(flight, tmp_path):
    one = flight.model_copy(
        update={
            "photographs": flight.photographs[:1],
            "world_from_camera": flight.world_from_camera[:1],
            "position_sigma": flight.position_sigma[:1],
        }
    )
    surroundings = context(tmp_path)
    OPTIONS.model_copy(update={"iterations": 5, "harmonics_degree": 0}).reconstruct(one, surroundings)
    assert "not measured" in surroundings.warnings[0]
    assert "held_out_psnr_db" not in surroundings.figures


def test_a_survey_without_photographs_is_refused(flight, tmp_path):
    none = flight.model_copy(
        update={
            "photographs": (),
            "world_from_camera": np.empty((0, 3, 4)),
            "position_sigma": np.empty((0, 3)),
        }
    )
    with pytest.raises(InputError, match="no photographs"):
        OPTIONS.reconstruct(none, context(tmp_path))


def test_numbers_that_are_none_are_named(flight, tmp_path, monkeypatch):
    def broken(*arguments):
        return torch.zeros((), requires_grad=True) * float("nan")

    monkeypatch.setattr(training, "image_loss", broken)
    with pytest.raises(StageFailed, match=r"loss.*(?s:.)*iteration 0, photograph \d\.png"):
        OPTIONS.reconstruct(flight, context(tmp_path))


def test_photographs_of_which_masks_leave_nothing_are_left_out(flight, tmp_path):
    Image.new("L", (96, 72), 0).save(tmp_path / "nothing.png")
    hidden = [photo.model_copy(update={"mask": tmp_path / "nothing.png"}) for photo in flight.photographs]
    short = OPTIONS.model_copy(update={"iterations": 5})
    some = flight.model_copy(update={"photographs": (*hidden[:2], *flight.photographs[2:])})
    surroundings = context(tmp_path / "some")
    short.reconstruct(some, surroundings)
    assert [warning[:18] for warning in surroundings.warnings] == ["1.png is left out:", "0.png is left out:"]
    assert set(surroundings.figures["held_out_psnr_db_by_photograph"]) == {"5.png"}
    with pytest.raises(InputError, match=r"(?s)nothing of any photograph.*1\.png.*masks"):
        short.reconstruct(flight.model_copy(update={"photographs": tuple(hidden)}), context(tmp_path / "none"))


def test_a_false_pose_among_good_ones_is_named(flight, tmp_path):
    poses = flight.world_from_camera.copy()
    poses[3, :, 3] += [1.5, 1.0, 0]
    surroundings = context(tmp_path)
    OPTIONS.reconstruct(flight.model_copy(update={"world_from_camera": poses}), surroundings)
    # those that share ground with it alone may suffer, less
    assert surroundings.warnings[0].startswith("3.png")
    assert "its pose may be false" in surroundings.warnings[0]
    assert len(surroundings.warnings) <= 2


@pytest.mark.parametrize("kind", ["black", "identical", "one pixel", "no points"])
def test_photographs_that_say_little_train_to_splats_or_a_clear_error(kind, flight, tmp_path):
    update = {"photographs": flight.photographs, "world_from_camera": flight.world_from_camera}
    if kind == "black":
        Image.new("RGB", (96, 72)).save(tmp_path / "black.png")
        path = {"path": tmp_path / "black.png"}
        update["photographs"] = tuple(photo.model_copy(update=path) for photo in flight.photographs)
    elif kind == "identical":
        update["photographs"] = flight.photographs[:1] * len(flight.photographs)
        update["world_from_camera"] = np.repeat(flight.world_from_camera[:1], len(flight.photographs), axis=0)
    elif kind == "one pixel":
        Image.new("RGB", (1, 1), "green").save(tmp_path / "green.png")
        path = {"path": tmp_path / "green.png"}
        update["photographs"] = tuple(photo.model_copy(update=path) for photo in flight.photographs)
        update["cameras"] = (Camera(width=1, height=1, focal_x=1, focal_y=1, principal_x=0.5, principal_y=0.5),)
    else:
        update |= {name: getattr(flight, name)[:0] for name in ("sparse_points", "sparse_colors", "sparse_errors")}
    splats = OPTIONS.model_copy(update={"iterations": 20, "background": None}).reconstruct(
        flight.model_copy(update=update), context(tmp_path / "out")
    )
    assert len(splats) > 0
    assert np.isfinite(splats.centers).all()
    assert np.isfinite(splats.harmonics).all()


def test_a_disk_without_room_for_checkpoints_costs_these_alone(flight, tmp_path, monkeypatch):
    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(torch, "save", full)
    monkeypatch.setattr(training, "CHECKPOINT_EVERY", 2)
    surroundings = context(tmp_path)
    splats = OPTIONS.model_copy(update={"iterations": 6}).reconstruct(flight, surroundings)
    assert len(splats) > 0
    assert len(surroundings.warnings) == 1
    assert "No space left" in surroundings.warnings[0]
    assert str(tmp_path) in surroundings.warnings[0]


def test_half_a_checkpoint_does_not_stay_in_the_way_of_the_result(flight, tmp_path, monkeypatch):
    def half(content, path):
        path.write_bytes(b"half")
        raise RuntimeError("unexpected pos 64 vs 0")

    monkeypatch.setattr(torch, "save", half)
    monkeypatch.setattr(training, "CHECKPOINT_EVERY", 2)
    OPTIONS.model_copy(update={"iterations": 3}).reconstruct(flight, context(tmp_path))
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"no checkpoint at all"])
def test_a_damaged_checkpoint_costs_only_what_it_held(flight, tmp_path, content):
    (tmp_path / "checkpoint.pt").write_bytes(content)
    surroundings = context(tmp_path)
    assert len(OPTIONS.model_copy(update={"iterations": 3}).reconstruct(flight, surroundings)) > 0
    assert any("starts anew" in warning for warning in surroundings.warnings)


def test_no_iterations_are_refused():
    with pytest.raises(ValueError, match="iterations"):
        TorchSplats(iterations=0)


def test_a_run_cut_off_in_its_second_block_keeps_the_first(flight, tmp_path):
    options = OPTIONS.model_copy(update={"blocks": 2, "iterations": 100})

    def interrupt(done: float, total: float, figures: dict[str, float]) -> None:
        assert total == 2 * options.iterations
        if done > options.iterations:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        options.reconstruct(flight, context(tmp_path, on_progress=interrupt))
    reports: list[float] = []
    surroundings = context(tmp_path, on_progress=lambda done, total, figures: reports.append(done))
    splats = options.reconstruct(flight, surroundings)
    assert min(reports) > options.iterations
    assert surroundings.figures["blocks"] == 2
    assert surroundings.figures["splats"] == len(splats)
    assert surroundings.figures["held_out_psnr_db"] > REACHED_PSNR_DB - 3


def test_holding_every_photograph_out_is_refused():
    with pytest.raises(ValueError, match="every photograph"):
        TorchSplats(hold_out_every=1)


def parameters_of(count: int) -> Parameters:
    random = np.random.default_rng(0)
    shapes = {"centers": (3,), "rotations": (4,), "log_scales": (3,), "logits": (), "harmonics": (4, 3)}
    raw = {
        name: torch.tensor(random.normal(size=(count, *shape)), dtype=torch.float32) for name, shape in shapes.items()
    }
    return Parameters(raw)


def test_a_split_keeps_the_mass_where_it_was():
    """Mean and covariance of the two children together are those of the parent."""
    parent = parameters_of(1)
    before = parent.export(1e9)
    children = densify(parameters_of(1), Adam(), torch.ones(1), 2).export(1e9)
    axes = stretched_axes(children)
    centre = children.centers.mean(axis=0)
    offsets = children.centers - centre
    spread = (axes @ axes.transpose(0, 2, 1)).mean(axis=0) + offsets.T @ offsets / 2
    expected = stretched_axes(before)[0] @ stretched_axes(before)[0].T
    np.testing.assert_allclose(centre, before.centers[0], atol=1e-5)
    np.testing.assert_allclose(spread, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


def stretched_axes(splats: SplatCloud) -> np.ndarray:
    return rotation_matrices(splats.rotations.astype(np.float64)) * splats.scales[:, None, :]


def test_densification_takes_the_highest_scores_and_the_dead_make_room():
    parameters, adam = parameters_of(6), Adam()
    parameters.raw["logits"][:] = 2.0
    parameters.raw["logits"][4] = -9.0
    before = {name: tensor.clone() for name, tensor in parameters.raw.items()}
    grown = densify(parameters, adam, torch.tensor([1.0, 5.0, 0.0, 3.0, 9.0, 2.0]), 7)
    assert len(grown) == 7
    changed = (grown.raw["centers"][:6] != before["centers"]).any(dim=1)
    assert changed.tolist() == [False, True, False, True, True, False]


@pytest.mark.parametrize("way", ["budgeted_splits", "mcmc", "clone_and_split"])
def test_a_photograph_that_shows_no_splat_moves_none(way):
    beyond = np.column_stack([np.eye(3), [0.0, 0.0, 500.0]])
    away = TrainingView("", torch.zeros(3, 72, 96, dtype=torch.uint8), None, CAMERA, beyond)
    parameters = parameters_of(50)
    state = State(parameters, Adam(), torch.zeros(50), 50, Exposures.of(1))
    growth = densifier(way, 1000, 50, 100, 10.0, 0)
    growth.start(state)
    before = {name: tensor.clone() for name, tensor in parameters.raw.items()}
    assert not len(parameters.in_view(away))
    assert training.descend(OPTIONS, away, SKY, state, growth, 10.0) > 0
    assert all(torch.equal(parameters.raw[name], tensor) for name, tensor in before.items())


def test_splats_whose_colour_matters_least_make_room_once_enough_photographs_have_shown_them():
    count = 100
    parameters, adam = parameters_of(count), Adam()
    parameters.raw["logits"][:] = 2.0
    adam.steps = torch.full((count,), FEWEST_SHOWN, dtype=torch.int32)
    adam.steps[50] = FEWEST_SHOWN - 1
    adam.square = {name: torch.ones_like(tensor) for name, tensor in parameters.raw.items()}
    adam.mean = {name: torch.zeros_like(tensor) for name, tensor in parameters.raw.items()}
    weights = torch.arange(count).float()
    weights[50] = 0
    adam.square["harmonics"] *= weights[:, None, None]
    before = parameters.raw["centers"].clone()
    grown = densify(parameters, adam, weights, count)
    assert len(grown) == count
    moved = torch.nonzero((grown.raw["centers"] != before).any(dim=1))[:, 0].tolist()
    # five of a hundred, of which one isn't known well enough, and the five of the highest scores
    assert moved == [0, 1, 2, 3, 4, 95, 96, 97, 98, 99]


def test_the_budget_is_reached_and_kept():
    schedule = Schedule(1000, 100, 5000)
    targets = [schedule.target(i) for i in range(1000) if schedule.is_due(i)]
    assert targets[0] >= 100
    assert targets == sorted(targets)
    assert max(targets) == 5000


def test_behind_the_splats_training_shows_the_mean_colour_of_the_photographs():
    pixels = torch.zeros(3, 2, 2, dtype=torch.uint8)
    pixels[0], pixels[2, 0] = 255, 51
    views = [TrainingView("", shown, None, CAMERA, np.eye(3, 4)) for shown in (pixels, torch.zeros_like(pixels))]
    assert mean_colour(views) == pytest.approx((0.5, 0, 0.05))


@pytest.fixture(scope="module")
def furrows(tmp_path_factory) -> Survey:
    """Photographs of long furrows, which needles show with the least effort."""
    random = np.random.default_rng(0)
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-6, 6, 0.8), np.arange(-6, 6, 0.3)))
    count = len(x)
    levels = np.where(np.round(y / 0.3) % 2 == 0, 0.9, -0.9)[:, None] + 0.1 * random.normal(size=(count, 3))
    needles = SplatCloud(
        centers=np.column_stack([x, y, np.zeros(count)]).astype(np.float32),
        rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.tile(np.array([0.8, 0.1, 0.1], np.float32), (count, 1)),
        opacities=np.full(count, 0.95, np.float32),
        harmonics=levels[:, None].astype(np.float32),
    )
    return survey(tmp_path_factory.mktemp("furrows"), needles, needles.centers[::2])


def test_the_anisotropy_term_removes_the_streaks_of_a_mass_that_turns(furrows, tmp_path):
    """Grains turn at random as the mass moves: needles then smear their colours over their neighbours."""
    changes, likeness, ratios = {}, {}, {}
    # After 200 iterations round splats still lag behind needles; by 600 needles have come to fit single photographs,
    # and round ones are better by 1.2 to 3.7 dB held out (of five seeds).
    settled = OPTIONS.model_copy(update={"iterations": 600, "splat_budget": 2400})
    for name, update in {
        "with": {"anisotropy_weight": 0.5},
        "without": {"anisotropy_weight": 0.0, "anisotropy_limit": 100.0},
    }.items():
        surroundings = context(tmp_path / name)
        splats = settled.model_copy(update=update).reconstruct(furrows, surroundings)
        random = np.random.default_rng(0).normal(size=splats.rotations.shape)
        turned = splats.model_copy(
            update={"rotations": (random / np.linalg.norm(random, axis=1, keepdims=True)).astype(np.float32)}
        )
        view = TrainingView("", torch.zeros(3, 72, 96, dtype=torch.uint8), None, CAMERA, looking_down(0, 0, 0.0))
        ratios[name] = float(np.quantile(splats.scales.max(axis=1) / splats.scales.min(axis=1), 0.9))
        changes[name] = float((draw_view(turned, view, SKY) - draw_view(splats, view, SKY)).square().mean().sqrt())
        likeness[name] = surroundings.figures["held_out_psnr_db"]
    assert changes["with"] < 0.8 * changes["without"], (changes, ratios, likeness)
    assert likeness["with"] > likeness["without"] - 0.3, likeness
