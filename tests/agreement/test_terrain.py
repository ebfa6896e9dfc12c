"""Blocks on scanned ground: Coulomb's law at any angle of slope and grid, in the reference and both backends."""

import math

import numpy as np
import pytest

from slideframe.problem import Boundary, ColliderMesh, Simulation, SimulationProblem, Wall
from slideframe.problem.material import Elastic
from slideframe.verification.terrain import SPACING, axes, slab
from slideframe.verification.terrain import incline as block_on_plane

# The block starts free of stress and settles into the cells that the surface cuts while it slides.
ACCELERATION_TOLERANCE = 0.03
CREEP_TOLERANCE_M = 5e-4
MU_22 = math.tan(math.radians(22.0))


def incline(slope, heading, wall, *, duration=0.6, frame_rate=10.0, gravity=9.81):
    """A block of 2 x 1 x 0.5 m on a plane of 8.5 m."""
    filling, corners = block_on_plane(slope, heading)
    ground = {"terrain_vertices": corners.astype(np.float32), "terrain_triangles": np.int32([[0, 1, 2], [0, 2, 3]])}
    problem = SimulationProblem(
        material=Elastic(density=2000, youngs_modulus=1e6, poisson_ratio=0.3),
        boundary=Boundary(sides=Wall(kind="open"), floor=Wall(kind="open"), terrain=wall),
        simulation=Simulation(
            duration=duration,
            frame_rate=frame_rate,
            grid_spacing=SPACING,
            gravity=(0.0, 0.0, -gravity),
            time_step="fixed",
        ),
    )
    return axes(slope, heading), filling.model_copy(update=ground), problem


def coulomb(friction):
    return Wall(kind="friction", friction_angle=math.degrees(math.atan(friction)))


@pytest.mark.parametrize(
    ("slope", "heading", "friction", "expected"),
    # physics.md, "Block on an incline", g = 9.81 m/s2
    [(30, 0, 0.2, 3.205858), (35, 27, MU_22, 2.380078), (40, 45, MU_22, 3.269531), (30, 200, 0.2, 3.205858)],
)
def test_block_slides_as_coulomb_says_at_any_angle_of_the_grid(motion, solver, slope, heading, friction, expected):
    way, filling, problem = incline(slope, heading, coulomb(friction))
    frames = motion(solver, filling, problem)
    downhill = [float((frame.velocities.astype(np.float64) @ way[0]).mean()) for frame in frames]
    assert (downhill[6] - downhill[2]) / 0.4 == pytest.approx(expected, rel=ACCELERATION_TOLERANCE)
    across = np.abs((frames[-1].positions - frames[0].positions) @ way[1]).mean()
    assert across < 0.02 * 0.5 * expected * 0.6**2
    assert frames[-1].escaped == 0


@pytest.mark.parametrize("wall", [coulomb(0.2), Wall(), Wall(kind="stick")], ids=lambda wall: wall.kind)
def test_a_body_from_a_file_acts_as_the_ground_does(motion, solver, tmp_path, wall):
    """The same plane, as scanned ground and as the top of a slab in an OBJ file."""
    way, filling, problem = incline(30, 27, wall, duration=0.1)
    path = tmp_path / "slab.obj"
    path.write_text(slab(filling.terrain_vertices.astype(np.float64), way[2]))
    body = ColliderMesh(path=path, kind=wall.kind, friction_angle=wall.friction_angle)
    boundary = problem.boundary.model_copy(update={"terrain": Wall(kind="open"), "meshes": (body,)})
    on_ground = motion(solver, filling, problem)[-1]
    on_body = motion(solver, filling, problem.model_copy(update={"boundary": boundary}))[-1]
    np.testing.assert_allclose(on_body.positions, on_ground.positions, atol=1e-4)
    np.testing.assert_allclose(on_body.velocities, on_ground.velocities, atol=1e-3)


def test_slip_ground_takes_no_speed_along_it(motion, solver):
    """A collider that ends by zeroing the velocity, as PhysGaussian's does, moves the block by a sixth of this."""
    way, filling, problem = incline(30, 27, Wall(), duration=0.3)
    frames = motion(solver, filling, problem)
    travelled = float(((frames[-1].positions.astype(np.float64) - frames[0].positions) @ way[0]).mean())
    assert travelled == pytest.approx(0.5 * 9.81 * 0.5 * 0.3**2, rel=0.02)


def test_block_sticks_below_the_friction_angle(motion, solver):
    way, filling, problem = incline(20, 0, coulomb(math.tan(math.radians(24))), duration=1.2)
    frames = motion(solver, filling, problem)
    # it sinks, leans and slides a little until the ground carries it; then it stands
    moved = [float(((frame.positions.astype(np.float64) - frames[0].positions) @ way[0]).mean()) for frame in frames]
    assert moved[12] < 0.04
    assert abs(moved[12] - moved[9]) <= CREEP_TOLERANCE_M


def test_what_slides_off_the_ground_is_counted_and_kept(motion, solver):
    """Past the open side, or down beyond the ground's end: no particle is lost, each is held where it left."""
    _, filling, problem = incline(40, 0, Wall(), duration=2.0, frame_rate=5.0)
    frames = motion(solver, filling, problem)
    last = frames[-1]
    assert [len(frame.positions) for frame in frames] == [len(filling.particle_positions)] * len(frames)
    escaped = [frame.escaped for frame in frames]
    assert escaped == sorted(escaped)
    assert escaped[0] == 0
    assert escaped[-1] > 0.9 * len(filling.particle_positions)
    grid = problem.grid(filling)
    low, high = (np.array(grid.origin) + SPACING * np.array(limit) for limit in problem.limits(grid))
    assert (last.positions >= low - 1e-3).all()
    assert (last.positions <= high + 1e-3).all()


def test_backends_agree_on_ground(motion, backend):
    _, filling, problem = incline(35, 27, coulomb(MU_22))
    mine, theirs = (motion(name, filling, problem)[-1] for name in (backend, "reference"))
    # contact is an either-or at each node, so that rounding decides for a few of them
    assert np.abs(mine.positions - theirs.positions).max() <= 2e-3
    assert np.abs(mine.velocities.mean(axis=0) - theirs.velocities.mean(axis=0)).max() <= 2e-3
