"""What products refuse."""

import numpy as np
import pytest

from slideframe.testing.solver_scenes import block_filling


def with_velocities(filling, velocities):
    return type(filling).model_validate(dict(filling) | {"particle_velocities": velocities})


def test_a_filling_without_velocities_starts_at_rest():
    filling = block_filling((0, 0, 0), (1, 1, 1))
    assert filling.start_velocities().shape == filling.particle_positions.shape
    assert not filling.start_velocities().any()


def test_a_filling_hands_out_its_velocities():
    filling = block_filling((0, 0, 0), (1, 1, 1))
    velocities = np.full_like(filling.particle_positions, 2)
    assert (with_velocities(filling, velocities).start_velocities() == 2).all()


def test_velocities_of_some_particles_are_refused():
    filling = block_filling((0, 0, 0), (1, 1, 1))
    with pytest.raises(ValueError, match="one for each, or none"):
        with_velocities(filling, np.zeros((3, 3), np.float32))
