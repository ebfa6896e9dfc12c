"""What other material point codes were seen to do wrong (docs/physics.md); each must not happen here, in any solver."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from slideframe.errors import StageFailed
from slideframe.problem import Elastic, Sand, Simulation, SimulationProblem, Wall
from slideframe.problem.grid import place_grid
from slideframe.verification import collapse, elastic
from slideframe.verification.scenes import filling, lattice

STIFFNESS = {"density": 2000, "youngs_modulus": 1e6, "poisson_ratio": 0.3}


def problem(material, **simulation):
    defaults = {"duration": 0.1, "frame_rate": 10, "grid_spacing": 0.125}
    return SimulationProblem(material=material, simulation=Simulation(**defaults | simulation))


def test_a_particle_that_crosses_cells_in_one_step_stops_the_run(rig):
    """Not checked, c dt / dx >= 3 ends in a segmentation fault."""
    positions, volume = lattice((0.75,) * 3, (1.25,) * 3, (8,) * 3)
    velocities = np.zeros_like(positions)
    velocities[7] = 1e6, 0, 0
    start = filling(positions, volume, ((0, 0, 0), (2, 2, 2)), particle_velocities=velocities.astype(np.float32))
    with pytest.raises(StageFailed, match=r"particle \d+ at .* m") as failure:
        rig.run(start, problem(Sand(friction_angle=30, **STIFFNESS)))
    assert "t = " in failure.value.where


def test_the_floor_is_where_it_is_said_to_be(rig):
    """A bounding box of peers holds material two cells inside."""
    motion = elastic.swinging_column(rig)
    start = motion.positions[0, :, 2]
    lowest = np.isclose(start, start.min())
    moved = np.abs(motion.positions[:, lowest, 2] - start.min()).max()
    assert moved <= 0.02 * motion.problem.simulation.grid_spacing


def test_slow_strain_is_not_lost_to_rounding(rig):
    """A deformation gradient near 1 in float32 can't grow by less than 6e-8 a step; here it is 2e-8."""
    material, spacing, cells, steps = Elastic(**STIFFNESS | {"poisson_ratio": 0.0}), 0.125, 32, 200
    # a bar without lateral strain; its middle strains undisturbed until the ends' waves arrive, smeared by every step
    length = cells * spacing
    positions, volume = lattice((length / 2, 0, 0), (3 * length / 2, 2 * spacing, 2 * spacing), (2 * cells, 2, 2))
    box = ((0, 0, 0), (2 * length, 2 * spacing, 2 * spacing))
    quiet = {"gravity": (0, 0, 0), "cfl": 0.01, "record_stress": True}
    step, _ = problem(material, **quiet, frame_rate=1e-3, duration=1e3).time_step(place_grid(np.array(box), spacing))
    rate = 2e-8 / step
    velocities = np.zeros_like(positions)
    velocities[:, 0] = -rate * (positions[:, 0] - length)
    start = filling(positions, volume, box, particle_velocities=velocities.astype(np.float32))
    motion = rig.run(start, problem(material, **quiet, duration=steps * step, frame_rate=1 / (steps * step)))
    inner = np.abs(positions[:, 0] - length) < spacing
    expected = -material.bulk_modulus * rate * steps * step
    assert motion.frames[-1].mean_stresses[inner].mean() == pytest.approx(expected, rel=0.02)


def landed_height(rig, volume_correction):
    """A cube in a box of its own plan bursts upwards and lands; return its height to that of a cube that didn't."""
    positions, volume = lattice((0, 0, 0), (0.5, 0.5, 0.5), (4, 4, 8))
    velocities = np.zeros_like(positions)
    velocities[:, 2] = 4 * positions[:, 2] / 0.5  # the top leaves at 4 m/s, the base stays
    start = filling(positions, volume, ((0, 0, 0), (0.5, 0.5, 2.0)), particle_velocities=velocities.astype(np.float32))
    sand = Sand(friction_angle=30, volume_correction=volume_correction, **STIFFNESS)
    motion = rig.run(start, problem(sand, duration=1.4, frame_rate=5))
    assert motion.positions[2, :, 2].max() > 0.9  # it did burst
    return 2 * motion.positions[-1, :, 2].mean() / 0.5


def test_a_burst_that_landed_takes_its_own_volume(rig):
    """Without a memory of the expansion, landed sand is compressed from its loosest state and stays puffed up."""
    assert landed_height(rig, volume_correction=True) < 1.3
    assert landed_height(rig, volume_correction=False) > 1.5


def test_the_pictures_deformation_follows_the_flow_within_bounds(rig):
    """The elastic deformation would stretch splats by 3 % (gaps), the raw total one by thousands (needles)."""
    motion = collapse.column(rig, 1.0, collapse.FRICTION_ANGLE)
    stretches = np.linalg.svd(motion.frames[-1].deformation_gradients.astype(np.float64), compute_uv=False)
    assert stretches.max() > 1.5
    assert stretches.max() <= 2.001
    assert stretches.min() >= 0.499


@given(rate=st.floats(0.1, 500), spacing=st.floats(0.01, 10), stiffness=st.floats(1e4, 1e10))
def test_substeps_fill_a_frame_exactly(rate, spacing, stiffness):
    """int(frame / substep) loses one where the quotient is rounded down: 4e-2 / 2e-5 becomes 1999."""
    material = Sand(friction_angle=30, density=2000, youngs_modulus=stiffness, poisson_ratio=0.3)
    made = problem(material, duration=2 / rate, frame_rate=rate, grid_spacing=spacing)
    grid = place_grid(np.array([[0.0, 0.0, 0.0], [10.0, 10.0, 10.0]]), spacing)
    step, substeps = made.time_step(grid)
    assert step * substeps * rate == pytest.approx(1, rel=1e-12)
    assert step <= 0.4 * spacing / material.pressure_wave_speed


@pytest.mark.parametrize(
    "wrong",
    [{"frction_angle": 30}, {"poisson_ratio": 0.5}, {"friction_angle": 0}, {"friction_angle": 90}, {"density": 0}],
    ids=str,
)
def test_impossible_materials_are_refused(wrong):
    with pytest.raises(ValidationError):
        Sand.model_validate({"friction_angle": 30} | STIFFNESS | wrong)


def test_friction_without_an_angle_is_refused():
    with pytest.raises(ValidationError):
        Wall(kind="friction")
