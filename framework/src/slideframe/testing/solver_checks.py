"""What every solver must hold. The numbers behind the tolerances are in docs/physics.md."""

from pathlib import Path

import numpy as np

from slideframe.arrays import Float64Array
from slideframe.errors import SlideframeError
from slideframe.problem import FEATURES, BlendTransfer, Boundary, SeparableTransfer, SimulationProblem, Wall
from slideframe.products import Filling, ParticleFrame
from slideframe.reference.solver import ReferenceSolver
from slideframe.stages import Solver
from slideframe.testing.evidence import assert_same, assert_valid, digest, fresh_context
from slideframe.testing.solver_scenes import block_filling, filling_of, on_level_ground, sand_problem

# float32 keeps 24 bits of a coordinate of a few metres, and a few hundred substeps round it each.
ROUNDING = 1e-5
# Relative, for a motion that every explicit scheme integrates exactly but for rounding.
PARABOLA_TOLERANCE = 1e-4
# A wall acts on nodes, so half a cell of soil may press into it.
PENETRATION_IN_CELLS = 0.5
# Settlement: the column has few cells, and a transfer may damp its oscillation.
SETTLEMENT_TOLERANCE = 0.08
# Other transfers than the reference's dissipate differently, by a twentieth on four cells;
# PIC or a wrong cone is off by far more.
COLLAPSE_TOLERANCE = 0.1
# On average over time: other transfers vibrate differently.
STRESS_TOLERANCE = 0.15
FIGURES = {"particles", "mass_kg", "time_step_s", "substeps", "substeps_per_second", "escaped_particles"}


def check_first_frame_is_the_start(stage: Solver, scratch: Path) -> None:
    """The first frame is at t = 0 and has the filling's positions, no velocity and no deformation."""
    filling = _block()
    first = next(iter(stage.solve(filling, sand_problem(), fresh_context(scratch))))
    assert first.time == 0, f"the first frame is at {first.time} s"
    assert np.array_equal(first.positions, filling.particle_positions), (
        "the first frame's positions differ from the input"
    )
    assert not first.velocities.any(), "the first frame already moves"
    assert (first.deformation_gradients == np.eye(3)).all(), "the first frame is already deformed"


def check_start_velocities_are_kept(stage: Solver, scratch: Path) -> None:
    """A block that the filling sends off flies on as it was sent, without gravity."""
    block = block_filling((1.5, 0.75, 1.0), (2.5, 1.25, 1.5), size=(4.0, 2.0))
    velocity = np.array([1.0, -0.25, 0.5], np.float32)
    filling = block.model_copy(update={"particle_velocities": np.tile(velocity, (len(block.particle_positions), 1))})
    frames = _solve(stage, filling, sand_problem(gravity=(0.0, 0.0, 0.0)), scratch)
    assert np.array_equal(frames[0].velocities, filling.particle_velocities), "the first frame has other velocities"
    flown = _displacement(frames)
    expected = velocity * frames[-1].time
    assert np.abs(flown - expected).max() <= 10 * ROUNDING, f"the block flew {flown} m, not {expected} m"


def check_frames_are_on_time(stage: Solver, scratch: Path) -> None:
    """There is a frame at every output time, exactly, and none else."""
    # 30 frames a second and 0.3 s: neither is a sum of whole substeps in binary
    problem = sand_problem(duration=0.3, frame_rate=30.0)
    times = [frame.time for frame in _solve(stage, _block(), problem, scratch)]
    assert times == [index / 30.0 for index in range(10)], f"frames at {times} s"


def check_frames_are_valid(stage: Solver, scratch: Path) -> None:
    """Every frame has the declared arrays and every particle."""
    filling = _block()
    for frame in _solve(stage, filling, sand_problem(), scratch):
        assert_valid(frame)
        count = len(frame.positions)
        assert count == len(filling.particle_positions), f"{count} of {len(filling.particle_positions)} particles"


def check_frames_own_their_arrays(stage: Solver, scratch: Path) -> None:
    """A frame doesn't change when the next one is asked for."""
    frames, digests = [], []
    for frame in stage.solve(_block(), sand_problem(duration=0.3), fresh_context(scratch)):
        frames.append(frame)
        digests.append(digest(frame))
    for frame, before in zip(frames, digests, strict=True):
        assert digest(frame) == before, f"the frame at {frame.time} s changed after a later one was made"


def check_input_is_untouched(stage: Solver, scratch: Path) -> None:
    """The filling has the same bits after the run."""
    filling = _block()
    before = digest(filling)
    _solve(stage, filling, sand_problem(), scratch)
    assert digest(filling) == before, "the solver wrote into the filling's arrays"


def check_two_runs_are_equal(stage: Solver, scratch: Path) -> None:
    """Two runs in one process give the same bits, even with another one unfinished between them."""
    filling, problem = _block(), sand_problem(duration=0.3)
    first = _solve(stage, filling, problem, scratch, "first")
    unfinished = stage.solve(filling, problem, fresh_context(scratch, "unfinished"))
    next(unfinished)
    next(unfinished)
    second = _solve(stage, filling, problem, scratch, "second")
    for one, other in zip(first, second, strict=True):
        assert_same(one, other, f"frame at {one.time} s")


def check_a_broken_run_goes_on_to_the_same_frames(stage: Solver, scratch: Path) -> None:
    """Where the stage resumes after a run that broke off, its frames are those of an unbroken run, bit for bit."""
    _check_resume(stage, sand_problem(duration=1.5), scratch)


def check_a_broken_run_goes_on_with_every_transfer(stage: Solver, scratch: Path) -> None:
    """The same where particles keep some of their own velocity, and with the plastic strain that they accumulate."""
    for transfer in (BlendTransfer(), SeparableTransfer()):
        if transfer.kind in stage.features:
            problem = sand_problem(duration=0.13, frame_rate=100.0)
            more = {"transfer": transfer, "record_stress": True}
            asked = problem.model_copy(update={"simulation": problem.simulation.model_copy(update=more)})
            _check_resume(stage, asked, scratch / transfer.kind)


def _check_resume(stage: Solver, problem: SimulationProblem, scratch: Path) -> None:
    filling = _block()
    whole = _solve(stage, filling, problem, scratch, "unbroken")
    broken = fresh_context(scratch, "broken")
    kept = 0
    for kept, _ in enumerate(stage.solve(filling, problem, broken), start=1):
        if kept == len(whole) - 2:
            break
    again = type(broken)(broken.device, broken.scratch, stored=kept)
    rest = list(stage.solve(filling, problem, again))
    assert again.first_item + len(rest) == len(whole), (
        f"{len(rest)} frames after the first {again.first_item}, {len(whole)} expected"
    )
    for one, other in zip(whole[again.first_item :], rest, strict=True):
        assert_same(one, other, f"frame at {one.time} s")


def check_figures_are_reported(stage: Solver, scratch: Path) -> None:
    """The figures that every solver reports are there, and mass is density times volume."""
    context, filling = fresh_context(scratch), _block()
    done: list[float] = []
    watched = type(context)(
        context.device, context.scratch, on_progress=lambda part, total, _: done.append(part / total)
    )
    for _ in stage.solve(filling, sand_problem(), watched):
        pass
    missing = FIGURES - watched.figures.keys()
    assert not missing, f"figures not reported: {', '.join(sorted(missing))}"
    expected, got = 2000 * float(filling.particle_volumes.sum(dtype=np.float64)), watched.figures["mass_kg"]
    assert isinstance(got, float), f"mass_kg is {got!r}"
    assert abs(got - expected) <= ROUNDING * expected, f"mass_kg is {got}, not {expected}"
    assert done, "no progress was reported"
    assert done == sorted(done), "progress goes backwards"
    assert done[-1] == 1, f"progress ends at {done[-1]:.0%}"


def check_rest_stays_at_rest(stage: Solver, scratch: Path) -> None:
    """Without gravity nothing moves."""
    frames = _solve(stage, _block(), sand_problem(gravity=(0.0, 0.0, 0.0)), scratch)
    moved = np.abs(frames[-1].positions - frames[0].positions).max()
    assert moved <= ROUNDING, f"a particle moved by {moved:.3g} m without any force"


def check_free_fall_is_a_parabola(stage: Solver, scratch: Path) -> None:
    """A block high above the floor falls with g and keeps its shape."""
    filling = block_filling((1.5, 0.25, 3.0), (2.5, 0.75, 3.5))
    frames = _solve(stage, filling, sand_problem(duration=0.5), scratch)
    heights = np.array([frame.positions[:, 2].astype(np.float64) for frame in frames])
    # second differences: g dt^2 for any scheme that is exact for constant acceleration but for its first substep
    acceleration = np.diff(heights, n=2, axis=0) / 0.1**2
    worst = np.abs(acceleration / -9.81 - 1).max()
    assert worst <= 10 * PARABOLA_TOLERANCE, f"the fall's acceleration is off by {worst:.2e}"
    for frame in frames[1:]:
        speed = np.abs(frame.velocities[:, 2] / (-9.81 * frame.time) - 1).max()
        assert speed <= PARABOLA_TOLERANCE, f"the speed of fall at {frame.time} s is off by {speed:.2e}"
    sideways = np.abs(frames[-1].positions[:, :2] - frames[0].positions[:, :2]).max()
    assert sideways <= ROUNDING, f"the falling block moved sideways by {sideways:.3g} m"


def check_walls_hold(stage: Solver, scratch: Path) -> None:
    """Sand that falls and spreads stays above the floor and between the walls."""
    problem = sand_problem(duration=0.8, frame_rate=5.0)
    frames = _solve(stage, block_filling((0.0, 0.0, 0.5), (1.0, 0.5, 1.5), size=(2.0, 0.5)), problem, scratch)
    slack = PENETRATION_IN_CELLS * problem.simulation.grid_spacing
    for frame in frames:
        low, high = frame.positions.min(axis=0), frame.positions.max(axis=0)
        assert (low >= -slack).all(), f"at {frame.time} s a particle is beyond a low wall: {low} m"
        assert (high[:2] <= np.array([2.0, 0.5]) + slack).all(), (
            f"at {frame.time} s a particle is beyond a high wall: {high} m"
        )


def check_walls_differ(stage: Solver, scratch: Path) -> None:
    """On a tilted floor sand slides freely with slip, slower with friction, slowest when it sticks."""
    tilt = np.radians(20.0)
    gravity = (9.81 * float(np.sin(tilt)), 0.0, -9.81 * float(np.cos(tilt)))
    walls = (Wall(), Wall(kind="friction", friction_angle=15.0), Wall(kind="stick"))
    filling = block_filling((0.5, 0.0, 0.0), (1.5, 1.0, 0.5))
    slipped = [
        _displacement(_solve(stage, filling, sand_problem(gravity=gravity, floor=wall), scratch, f"{wall.kind}"))[0]
        for wall in walls
    ]
    free = 0.5 * gravity[0] * 0.2**2
    assert abs(slipped[0] / free - 1) < 0.1, f"on a slip floor it slid {slipped[0]:.4f} m, not about {free:.4f} m"
    assert slipped[0] > 1.5 * slipped[1], f"slip {slipped[0]:.4f} m, friction {slipped[1]:.4f} m: friction doesn't act"
    assert slipped[1] > slipped[2], f"friction {slipped[1]:.4f} m, stick {slipped[2]:.4f} m: stick doesn't hold"


def check_column_settles_as_theory(stage: Solver, scratch: Path) -> None:
    """The top of a confined column under its own weight settles by rho g H^2 / 2M on average over a period."""
    height, modulus = 2.0, 1e6
    # nu = 0.4 has K0 = 0.667, inside the cone of 30 degrees: the column stays elastic
    problem = sand_problem(duration=1.0, frame_rate=100.0, poisson_ratio=0.4, youngs_modulus=modulus)
    constrained = problem.material.lame_lambda + 2 * problem.material.shear_modulus
    period = 4 * height / problem.material.pressure_wave_speed
    problem = sand_problem(duration=period, frame_rate=20 / period, poisson_ratio=0.4, youngs_modulus=modulus)
    filling = block_filling((0.0, 0.0, 0.0), (0.5, 0.5, height), size=(0.5, 0.5))
    top = filling.particle_positions[:, 2] > height - 0.125
    heights = [
        float(frame.positions[top, 2].mean(dtype=np.float64)) for frame in _solve(stage, filling, problem, scratch)
    ]
    # the topmost particles stand half a spacing below the free surface, where u = u_top (1 - (d / H)^2)
    settled = heights[0] - np.trapezoid(heights, dx=1 / 20)
    expected = 2000 * 9.81 * height**2 / (2 * constrained)
    error = settled / expected - 1
    assert abs(error) <= SETTLEMENT_TOLERANCE, f"settlement {settled:.5f} m, theory {expected:.5f} m ({error:+.1%})"


def check_sand_collapses_as_the_reference(stage: Solver, scratch: Path) -> None:
    """A block on a rough floor collapses as far as the float64 reference says, for a weak and a strong sand."""
    filling = block_filling((0.0, 0.0, 0.0), (1.0, 0.5, 1.0), size=(4.0, 0.5))
    mine, theirs = {}, {}
    for angle in (22.0, 40.0):
        rough = Wall(kind="friction", friction_angle=22.0)
        problem = sand_problem(duration=0.6, frame_rate=5.0, friction_angle=angle, floor=rough)
        mine[angle] = _displacement(_solve(stage, filling, problem, scratch, f"{angle}"))
        theirs[angle] = _displacement(_solve(ReferenceSolver(), filling, problem, scratch, f"{angle}-reference"))
        # the strong sand hardly moves: both are measured by the weak one's collapse
        error = np.linalg.norm(mine[angle] - theirs[angle]) / np.linalg.norm(theirs[22.0])
        assert error <= COLLAPSE_TOLERANCE, (
            f"friction angle {angle}: the centre of mass moved by {mine[angle]} m, "
            f"in the reference by {theirs[angle]} m ({error:.1%} of the collapse)"
        )


def check_stress_is_recorded_on_request(stage: Solver, scratch: Path) -> None:
    """Frames carry stress invariants where they are asked for: near the floor, on average, the reference's."""
    problem = sand_problem(frame_rate=50.0)
    asked = problem.model_copy(update={"simulation": problem.simulation.model_copy(update={"record_stress": True})})
    plain = _solve(stage, _block(), problem, scratch, "plain")[-1]
    assert not len(plain.mean_stresses), "frames carry stress that nobody asked for"
    mine = _solve(stage, _block(), asked, scratch, "asked")
    theirs = _solve(ReferenceSolver(), _block(), asked, scratch, "reference")
    lower = _block().particle_positions[:, 2] < 0.25
    for name in ("mean_stresses", "deviatoric_stresses"):
        given, expected = (np.array([getattr(frame, name) for frame in frames]) for frames in (mine, theirs))
        assert given.shape == expected.shape, f"{given.shape[1]} {name} for {expected.shape[1]} particles"
        error = float(abs(given[:, lower].mean() / expected[:, lower].mean() - 1))
        assert error <= STRESS_TOLERANCE, f"{name} differ from the reference's by {error:.1%} on average"
        assert abs(given[:, lower].mean()) > abs(given[:, ~lower].mean()), f"{name} don't grow with depth"


def check_particles_at_the_edge_are_held(stage: Solver, scratch: Path) -> None:
    """Sand thrown out of the grid is held at its edge and counted; nothing crashes."""
    frames = _solve(stage, _block(), sand_problem(duration=1.0, frame_rate=2.0, gravity=(0.0, 0.0, 9.81)), scratch)
    assert frames[-1].escaped > 0, "sand fell upwards out of the grid, and no escaped particle was counted"
    assert np.isfinite(frames[-1].positions).all(), "positions at the grid's edge aren't finite"


def check_declared_features_act(stage: Solver, scratch: Path) -> None:
    """What the solver says that it can do has its effect, and it says nothing unknown."""
    unknown = stage.features - FEATURES
    assert not unknown, f"features not known to slideframe: {', '.join(sorted(unknown))}"
    laws = {"drucker_prager", "mohr_coulomb", "elastic"}
    assert stage.features & laws, "no law of the soil is among the features"
    if "terrain" in stage.features:
        ground = Boundary(terrain=Wall(kind="stick"))
        problem = sand_problem(duration=0.4).model_copy(update={"boundary": ground})
        block = on_level_ground(block_filling((1.0, 0.25, 1.0), (2.0, 0.75, 1.5)), 1.0)
        frames = _solve(stage, block, problem, scratch, "terrain")
        lowest = float(frames[-1].positions[:, 2].min())
        slack = PENETRATION_IN_CELLS * problem.simulation.grid_spacing
        assert lowest > 1 - slack, f"the mass fell through the terrain at 1 m, to {lowest:.3f} m"
    if "open_walls" in stage.features:
        opened = Boundary(sides=Wall(kind="open"))
        problem = sand_problem(duration=0.8, gravity=(9.81, 0.0, -9.81)).model_copy(update={"boundary": opened})
        frames = _solve(stage, block_filling((2.5, 0.25, 0.0), (3.5, 0.75, 0.5)), problem, scratch, "open")
        count = len(frames[0].positions)
        assert len(frames[-1].positions) == count, "particles that left are missing from the frames"
        assert frames[-1].escaped > 0.5 * count, f"{frames[-1].escaped} of {count} particles left by an open wall"
    if "mohr_coulomb" in stage.features:
        rough = Wall(kind="friction", friction_angle=22.0)
        problem = sand_problem(duration=0.6, frame_rate=5.0, friction_angle=22.0, floor=rough)
        pyramid = problem.material.model_copy(update={"friction_match": "mohr_coulomb"})
        problem, filling = problem.model_copy(update={"material": pyramid}), block_filling((0, 0, 0), (1.0, 0.5, 1.0))
        mine = _displacement(_solve(stage, filling, problem, scratch, "pyramid"))
        theirs = _displacement(_solve(ReferenceSolver(), filling, problem, scratch, "pyramid-reference"))
        error = np.linalg.norm(mine - theirs) / np.linalg.norm(theirs)
        assert error <= COLLAPSE_TOLERANCE, (
            f"with mohr_coulomb the centre moved by {mine} m, the reference's by {theirs} m"
        )


def check_bad_starts_are_refused(stage: Solver, scratch: Path) -> None:
    """No particles, or particles outside the walls, raise a SlideframeError before anything is computed."""
    starts = {
        "no particles": filling_of(np.zeros((0, 3), np.float32), 1.0),
        "particles below the floor": block_filling((0.0, 0.0, -1.0), (1.0, 1.0, 0.0)),
    }
    for what, filling in starts.items():
        try:
            _solve(stage, filling, sand_problem(), scratch, what)
        except SlideframeError:
            continue
        raise AssertionError(f"{what}: no SlideframeError")


def _block() -> Filling:
    return block_filling((0.5, 0.0, 0.0), (1.5, 0.5, 0.5))


def _solve(
    stage: Solver, filling: Filling, problem: SimulationProblem, scratch: Path, name: str = "run"
) -> list[ParticleFrame]:
    return list(stage.solve(filling, problem, fresh_context(scratch, name)))


def _displacement(frames: list[ParticleFrame]) -> Float64Array:
    """Return how far the centre of mass moved, (3,), m."""
    moved: Float64Array = (frames[-1].positions.astype(np.float64) - frames[0].positions).mean(axis=0)
    return moved
