"""What relocating, cloning and splitting do to single splats."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from slideframe_gs_torch.checkpoint import State
from slideframe_gs_torch.densification import random_numbers
from slideframe_gs_torch.densification.clone_and_split import CloneAndSplit
from slideframe_gs_torch.densification.mcmc import DEAD_OPACITY, MOST_COPIES, relocate_and_add, shared_opacity
from slideframe_gs_torch.exposure import Exposures
from slideframe_gs_torch.optimiser import Adam
from slideframe_gs_torch.parameters import Parameters


def parameters_of(count: int, opacity: float = 0.6, scale: float = 0.2) -> Parameters:
    random = np.random.default_rng(0)
    raw = {
        "centers": torch.tensor(random.uniform(-5, 5, (count, 3)), dtype=torch.float32),
        "rotations": torch.tensor(random.normal(size=(count, 4)), dtype=torch.float32),
        "log_scales": torch.full((count, 3), float(np.log(scale))),
        "logits": torch.full((count,), float(np.log(opacity / (1 - opacity)))),
        "harmonics": torch.zeros(count, 1, 3),
    }
    return Parameters(raw)


@given(opacity=st.floats(0.01, 0.99), copies=st.integers(1, MOST_COPIES))
def test_copies_let_through_at_their_centre_what_the_one_did(opacity, copies):
    shared, shrink = shared_opacity(torch.tensor([opacity], dtype=torch.float64), torch.tensor([copies]))
    assert 1 - (1 - float(shared)) ** copies == pytest.approx(opacity, abs=1e-9)
    assert 0 < float(shrink) <= 1 + 1e-9


@pytest.mark.parametrize("copies", [1, 2, 5])
def test_copies_have_the_integral_of_the_one(copies):
    """Along a line through the centre, the opacity of N stacked splats of the new size adds up to that of the one."""
    opacity = 0.7
    shared, shrink = (float(v) for v in shared_opacity(torch.tensor([opacity]).double(), torch.tensor([copies])))
    x = np.linspace(-12, 12, 100_001)
    one = opacity * np.exp(-(x**2) / 2)
    stacked = 1 - (1 - shared * np.exp(-((x / shrink) ** 2) / 2)) ** copies
    assert np.trapezoid(stacked, x) == pytest.approx(np.trapezoid(one, x), rel=1e-6)


def test_dead_splats_move_to_live_ones_and_new_ones_join_them():
    parameters = parameters_of(10)
    parameters.raw["logits"][3] = -9.0
    before = parameters.raw["centers"].clone()
    grown = relocate_and_add(parameters, Adam(), 12, random_numbers(0, 0))
    assert len(grown) == 12
    places = grown.raw["centers"]
    assert (places[3] != before[3]).any()
    live = torch.cat([before[:3], before[4:]])
    for moved in (places[3], places[10], places[11]):
        assert (live == moved).all(dim=1).any()
    assert (grown.raw["logits"].sigmoid() > DEAD_OPACITY).all()


@pytest.mark.parametrize(("scale", "split"), [(0.2, False), (3.0, True)])
def test_small_splats_are_cloned_and_large_ones_split(scale, split):
    way = CloneAndSplit(iterations=1000, budget=100, extent=50.0, seed=0)
    parameters = parameters_of(10, scale=scale)
    state = State(parameters, Adam(), torch.zeros(10, 2), 10, Exposures.of(1), iteration=100)
    gradients = torch.zeros(10, 2)
    gradients[4, 0] = 1.0
    way.observe(state, torch.arange(10), gradients, width=100)
    before = parameters.raw["centers"].clone()
    way.after_step(state, 1e-3)
    assert len(state.parameters) == 11
    centers, sizes = state.parameters.raw["centers"], state.parameters.raw["log_scales"].exp()
    if split:
        assert (centers[4] != before[4]).any()
        assert sizes[[4, 10]].numpy() == pytest.approx(scale / 1.6, rel=1e-5)
    else:
        assert (centers[[4, 10]] == before[4]).all()
        assert sizes[[4, 10]].numpy() == pytest.approx(scale, rel=1e-5)
    assert state.score.shape == (11, 2)


def test_the_budget_of_clones_is_kept_and_faint_and_huge_splats_go():
    way = CloneAndSplit(iterations=1000, budget=11, extent=10.0, seed=0)
    parameters = parameters_of(10)
    parameters.raw["logits"][0] = -9.0
    parameters.raw["log_scales"][1] = 3.0
    state = State(parameters, Adam(), torch.zeros(10, 2), 10, Exposures.of(1), iteration=100)
    way.observe(state, torch.arange(10), torch.ones(10, 2), width=100)
    way.after_step(state, 1e-3)
    assert len(state.parameters) <= 11
    assert (state.parameters.raw["logits"] > -9).all()
    assert (state.parameters.raw["log_scales"] < 3).all()
