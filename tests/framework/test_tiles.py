"""The sparse grid: tiles of one colour share no node, and nodes follow the particles."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slideframe import tiles
from slideframe.errors import StageFailed
from slideframe.testing.solver_scenes import block_filling, filling_of, sand_problem


def test_tiles_of_one_colour_share_no_node_within_the_drift_allowed():
    """A stencil starts at the node below x - 0.5 and has three nodes; particles drift by MOST_DRIFT cells at most."""
    last_of_one = int(np.floor(tiles.TILE - 1e-9 + tiles.MOST_DRIFT)) + 2
    first_of_next = int(np.floor(2 * tiles.TILE - tiles.MOST_DRIFT))
    assert last_of_one < first_of_next


def test_the_window_holds_a_tile_around_all_columns_and_an_even_number_each_way():
    corner, count = tiles.window(np.array([9, 0]), np.array([9, 21]))
    assert corner == (4, -4)
    assert count == (4, 8)


@settings(max_examples=100)
@given(sizes=st.lists(st.integers(0, 50), min_size=1, max_size=40), parts=st.integers(1, 5), first=st.integers(0, 9))
def test_runs_cover_all_once_and_are_cut_at_starts_only(sizes, parts, first):
    starts = first + np.concatenate([[0], np.cumsum(sizes)])
    cut = tiles.runs(starts, parts)
    assert len(cut) <= parts
    assert sum(count for _, count in cut) == sum(sizes)
    assert all(low in starts and count > 0 for low, count in cut)
    assert all(low + count == following for (low, count), (following, _) in pairwise(cut))
    assert all(count <= sum(sizes) / parts + max(sizes) for _, count in cut)


def test_the_estimate_counts_particles_not_the_box():
    filling = block_filling((0.0, 0.0, 0.0), (2.0, 1.0, 1.0))
    problem = sand_problem(spacing=0.25)
    wide = filling.model_copy(update={"bounds": np.array([[0.0, 0.0, 0.0], [4000.0, 1000.0, 100.0]])})
    assert problem.grid(wide).node_count > 1e10
    assert tiles.estimate_nodes(wide, problem.grid(wide)) == tiles.estimate_nodes(filling, problem.grid(filling))
    # 8 x 4 cells in plan: 2 to 3 by 1 to 2 tiles and one on each side, four layers high
    assert tiles.estimate_nodes(filling, problem.grid(filling)) <= tiles.SPREAD * 5 * 4 * 16 * (4 + tiles.LAYERS_AROUND)


def test_one_particle_needs_nine_tiles():
    filling = filling_of(np.float32([[1.0, 0.5, 0.5]]), 1e-3)
    assert tiles.estimate_nodes(filling, sand_problem().grid(filling)) == tiles.SPREAD * 9 * 16 * tiles.LAYERS_AROUND


def test_a_grid_that_outgrows_memory_or_indices_stops_with_a_cure():
    tiles.require_room(1_000, 10)
    for size, count in ((10**15, 10), (10, 2**31)):
        with pytest.raises(StageFailed, match="grid nodes"):
            tiles.require_room(size, count)
