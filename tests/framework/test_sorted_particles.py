"""Arrays in the order of cells, here in NumPy's own memory."""

import numpy as np

from slideframe.sorted_particles import SHAPES, SortedParticles, reals_per_particle
from slideframe.testing.solver_scenes import block_filling, sand_problem

BLOCK = block_filling((0.5, 0.0, 0.0), (1.5, 0.5, 0.5))
PROBLEM = sand_problem()
RECORDING = PROBLEM.model_copy(update={"simulation": PROBLEM.simulation.model_copy(update={"record_stress": True})})


class InNumpy(SortedParticles):
    def _allocate(self, shape, kind):
        return np.zeros((self.count, *shape), kind)

    def _write(self, array, values):
        array[...] = values

    def _read(self, array):
        return array


def shuffled(particles):
    """Bring all arrays into another order, as sorting by cell does."""
    order = np.random.default_rng(1).permutation(particles.count)
    for name in particles.names():
        source, target = particles.swap(name)
        target[...] = source[order]


def test_what_is_read_and_written_has_the_fillings_order():
    grid = PROBLEM.grid(BLOCK)
    particles = InNumpy(BLOCK, PROBLEM, grid)
    shuffled(particles)
    (cells,) = particles.in_order("positions")
    np.testing.assert_allclose(cells * grid.spacing + np.array(grid.origin), BLOCK.particle_positions, atol=1e-5)
    volumes = np.arange(particles.count, dtype=np.float64)
    particles.assign("volumes", volumes)
    np.testing.assert_array_equal(particles.in_order("volumes")[0], volumes)


def test_a_state_comes_back_with_its_order():
    first, second = (InNumpy(BLOCK, RECORDING, RECORDING.grid(BLOCK)) for _ in range(2))
    shuffled(first)
    second.restore(first.state())
    for name in first.names():
        np.testing.assert_array_equal(second[name], first[name])


def test_memory_counts_every_array_and_the_spares():
    """Thirty-six reals, and one more vector, matrix, state and scalar while sorting."""
    assert reals_per_particle(PROBLEM.simulation) == sum(map(np.prod, SHAPES.values())) + 19 == 55
    assert reals_per_particle(RECORDING.simulation) == 56
