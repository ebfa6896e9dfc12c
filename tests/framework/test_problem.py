import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from slideframe.errors import ConfigurationError
from slideframe.problem import (
    Boundary,
    BoxRegion,
    ColliderMesh,
    Domain,
    DruckerPrager,
    OrbitView,
    Sand,
    Simulation,
    SimulationProblem,
    Wall,
)
from slideframe.reference.solver import ReferenceSolver
from slideframe.stages import Solver
from slideframe.testing.ground_scenes import hillside_survey
from slideframe.testing.solver_scenes import filling_of

PAPER_SAND = {"friction_angle": 22, "density": 2000, "youngs_modulus": 5e7, "poisson_ratio": 0.3}
FILLING = filling_of(np.float32([[0, 0, 5], [1, 1, 2]]), 1.0).model_copy(
    update={"bounds": np.array([[-10.0, 0, -3], [10, 15, 5]])}
)
EARTH = PAPER_SAND | {"friction_angle": 30, "friction_match": "plane_strain"}


def problem(**simulation) -> SimulationProblem:
    return SimulationProblem(
        material=Sand(**PAPER_SAND),
        simulation=Simulation(**({"duration": 2.0, "grid_spacing": 0.5} | simulation)),
    )


def test_paper_card_gives_its_moduli_and_wave_speed():
    sand = Sand(**PAPER_SAND)
    # physics.md: lambda 2.8846e7, mu 1.9231e7 Pa, c_p 183.450 m/s
    assert sand.lame_lambda == pytest.approx(2.8846e7, rel=1e-4)
    assert sand.shear_modulus == pytest.approx(1.9231e7, rel=1e-4)
    assert sand.pressure_wave_speed == pytest.approx(183.450, abs=5e-4)


@pytest.mark.parametrize(
    ("match", "slope"),
    [("triaxial_compression", 0.230940), ("triaxial_extension", 0.164957), ("plane_strain", 0.166667)],
)
def test_friction_matches_follow_the_cone_of_their_test(match, slope):
    # sqrt(J2) + a I1 = k with a at 30 degrees; alpha relates ||s|| = sqrt(2 J2) to 3 p: alpha = sqrt(2) a
    sand = Sand(**PAPER_SAND | {"friction_angle": 30, "friction_match": match})
    assert sand.cone_friction == pytest.approx(slope, rel=1e-5)


def test_plane_strain_match_of_associated_flow_is_the_textbook_s():
    soil = DruckerPrager(**EARTH | {"dilatancy_angle": 30})
    # physics.md: a = tan(phi) / sqrt(9 + 12 tan^2(phi)) = 0.160128 at 30 degrees
    assert soil.cone_friction == pytest.approx(0.160128, rel=1e-5)


@pytest.mark.parametrize("match", ["triaxial_compression", "triaxial_extension", "plane_strain", "mohr_coulomb"])
def test_cohesion_moves_the_tip_to_the_same_tension_for_every_match(match):
    soil = DruckerPrager(**EARTH | {"cohesion": 1e4, "friction_match": match})
    assert soil.constants.apex * soil.bulk_modulus == pytest.approx(1e4 / math.tan(math.radians(30)))


def test_a_cut_off_beyond_the_tip_changes_nothing():
    soil = DruckerPrager(**EARTH | {"cohesion": 1e4, "tension_cutoff": 1e9})
    assert soil.constants.cutoff == soil.constants.apex


def test_the_domain_reaches_over_the_terrain_and_keeps_what_is_given():
    ground = FILLING.model_copy(update={"terrain_vertices": np.float32([[-30, -5, -9], [20, 40, 3], [0, 0, -20]])})
    region = Domain().bounds(ground)
    np.testing.assert_array_equal(region, FILLING.bounds)
    np.testing.assert_array_equal(Domain(extent="terrain").bounds(ground), [[-30, -5, -20], [20, 40, 5]])
    given = Domain(extent="terrain", margin=2, x_max=99, z_min=-50).bounds(ground)
    np.testing.assert_array_equal(given, [[-32, -7, -50], [99, 42, 5]])
    with pytest.raises(ValidationError, match="y_min must be less"):
        Domain(y_min=1, y_max=0)


def test_particles_leave_at_open_walls_only():
    closed, opened = problem(), problem().model_copy(update={"boundary": Boundary(sides=Wall(kind="open"))})
    grid = closed.grid(FILLING)
    ends = tuple(length - 2 for length in grid.shape)
    assert closed.limits(grid) == ((1, 1, 1), ends)
    assert opened.limits(grid) == ((grid.padding, grid.padding, 1), (*grid.high, ends[2]))
    bottomless = problem().model_copy(update={"boundary": Boundary(floor=Wall(kind="open"))})
    assert bottomless.limits(grid) == closed.limits(grid)


class Plain(ReferenceSolver):
    """A solver that says nothing of what it knows."""

    features = Solver.features


def test_what_a_solver_does_not_know_is_refused():
    everything = SimulationProblem(
        material=DruckerPrager(**PAPER_SAND),
        boundary=Boundary(
            sides=Wall(kind="open"), terrain=Wall(kind="stick"), meshes=(ColliderMesh(path=Path("wall.ply")),)
        ),
        simulation=Simulation(duration=1, grid_spacing=1, initial_stress="k0", stop="rest"),
    )
    ReferenceSolver().require_features(everything)
    with pytest.raises(ConfigurationError) as refused:
        Plain().require_features(everything)
    for lacking in ("meshes", "terrain", "open_walls", "initial_stress", "rest", "mohr_coulomb"):
        assert lacking in refused.value.what
    Plain().require_features(problem())


def test_dilatancy_beyond_friction_is_refused():
    with pytest.raises(ValidationError, match="create energy"):
        DruckerPrager(**EARTH | {"dilatancy_angle": 31})


@pytest.mark.parametrize(
    "bad",
    [{"friction_angle": 0}, {"friction_angle": 90}, {"poisson_ratio": 0.5}, {"density": 0}, {"frction_angle": 22}],
)
def test_impossible_sand_is_refused(bad):
    with pytest.raises(ValidationError):
        Sand(**PAPER_SAND | bad)


def test_region_sides_must_be_in_order():
    with pytest.raises(ValidationError, match="x_min must be less than x_max"):
        BoxRegion(x_min=1, x_max=0, y_min=0, y_max=1, z_min=0)


def test_friction_belongs_to_a_frictional_wall_only():
    assert Wall(kind="friction", friction_angle=45).friction == pytest.approx(1)
    with pytest.raises(ValidationError, match="friction_angle must be above 0"):
        Wall(kind="friction")
    with pytest.raises(ValidationError, match="absent for any other kind"):
        Wall(kind="slip", friction_angle=3)


def test_eight_particles_a_cell_stand_half_a_cell_apart():
    assert problem().simulation.particle_spacing == pytest.approx(0.25)


@given(duration=st.floats(0.1, 20), rate=st.floats(10, 60), spacing=st.floats(0.1, 2))
def test_substeps_meet_output_times_and_respect_the_wave(duration, rate, spacing):
    case = problem(duration=duration, frame_rate=rate, grid_spacing=spacing)
    step, substeps = case.time_step(case.grid(FILLING))
    assert step * substeps == pytest.approx(1 / rate, rel=1e-12)
    assert step * case.material.pressure_wave_speed <= 0.4 * spacing


def test_a_frame_of_many_substeps_loses_none():
    # int(4e-2 / 2e-5) is 1999
    case = problem(grid_spacing=0.5)
    grid = case.grid(FILLING)
    step, substeps = case.time_step(grid)
    assert substeps == round(1 / (25 * step))


def test_grid_puts_the_walls_on_nodes():
    grid = problem().grid(FILLING)
    lows = [origin + grid.spacing * grid.padding for origin in grid.origin]
    assert lows == pytest.approx(FILLING.bounds[0])
    highs = [grid.origin[axis] + grid.spacing * grid.high[axis] for axis in range(2)]
    assert highs == pytest.approx(FILLING.bounds[1, :2])
    assert grid.origin[2] + grid.spacing * (grid.shape[2] - 1) > 5 + 2 * grid.spacing


@given(
    azimuth=st.floats(-400, 400),
    elevation=st.floats(-80, 80),
    corner=st.tuples(*[st.floats(-100, 100)] * 3),
    size=st.tuples(*[st.floats(1, 50)] * 3),
)
def test_the_view_camera_looks_at_the_centre_and_sees_all_corners(azimuth, elevation, corner, size):
    view = OrbitView(azimuth=azimuth, elevation=elevation)
    bounds = np.float32([corner, np.add(corner, size)])
    camera, pose = view.shot(hillside_survey(), bounds)(0.3)
    rotation, place = pose[:, :3], pose[:, 3]
    assert np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)
    corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    x, y, z = ((corners - place) @ rotation).T
    assert (z > 0).all()
    assert (abs(camera.focal_x * x / z) <= camera.width / 2 + 1e-3).all()
    assert (abs(camera.focal_y * y / z) <= camera.height / 2 + 1e-3).all()


def test_azimuth_is_the_compass_direction_towards_the_camera():
    bounds = np.float32([[-1, -1, -1], [1, 1, 1]])
    _, pose = OrbitView(azimuth=90, elevation=0, distance=10).shot(hillside_survey(), bounds)(0)
    assert pose[:, 3] == pytest.approx([10, 0, 0], abs=1e-9)  # east
    assert pose[:, 1] == pytest.approx([0, 0, -1], abs=1e-9)  # image down is world down
