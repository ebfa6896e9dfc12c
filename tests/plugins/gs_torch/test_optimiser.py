"""A step of the splats against torch's own Adam and the losses as torch differentiates them."""

import numpy as np
import pytest
import torch

from slideframe_gs_torch import threads
from slideframe_gs_torch.anisotropy import anisotropy_loss
from slideframe_gs_torch.optimiser import Adam, Pressure
from slideframe_gs_torch.parameters import NAMES, Parameters

COUNT, TERMS = 600, 4
RATES = {"centers": 1e-2, "rotations": 2e-2, "log_scales": 3e-2, "logits": 4e-2, "constant": 5e-2, "others": 6e-3}
PRESSURE = Pressure(0.3, 3.0, 0.2, 0.1, 1e-3, 20.0)
# float32 sums in another order
TOLERANCE = 2e-5


def splats() -> Parameters:
    random = np.random.default_rng(0)
    shapes = {"centers": (3,), "rotations": (4,), "log_scales": (3,), "logits": (), "harmonics": (TERMS, 3)}
    raw = {name: torch.tensor(random.normal(size=(COUNT, *shape)).astype(np.float32)) for name, shape in shapes.items()}
    raw["log_scales"][:5, 0] += 9  # beyond the bend of the anisotropy loss, and the largest scale
    return Parameters(raw)


def photograph_loss(drawn: dict[str, torch.Tensor], weights: dict[str, torch.Tensor]) -> torch.Tensor:
    return sum((weights[name] * drawn[name]).sum() for name in NAMES)


def random_weights(step: int, terms: int) -> dict[str, torch.Tensor]:
    random = torch.Generator().manual_seed(step)
    shapes = {"centers": (3,), "rotations": (4,), "log_scales": (3,), "logits": (), "harmonics": (terms, 3)}
    return {name: torch.randn(COUNT, *shape, generator=random) for name, shape in shapes.items()}


EVERY = torch.arange(COUNT)


def stepped(steps: int, rows: torch.Tensor = EVERY, pulled: torch.Tensor | None = None) -> tuple[Parameters, Adam]:
    """Take steps of the rows that are drawn, of which all are pulled at, or some."""
    parameters, adam = splats(), Adam()
    pulls = torch.ones(len(rows), 2) if pulled is None else pulled[:, None].float().repeat(1, 2)
    for step in range(steps):
        leaves = parameters.leaves(rows, 1)
        weights = {name: weight[rows] for name, weight in random_weights(step, TERMS).items()}
        photograph_loss(leaves, weights).backward()
        adam.step(parameters.raw, rows, leaves, pulls, RATES, PRESSURE)
    return parameters, adam


def test_steps_are_those_of_adam_on_the_whole_loss():
    parameters, _ = stepped(4)
    raw = {name: tensor.requires_grad_() for name, tensor in splats().raw.items()}
    rates = dict(zip(NAMES, RATES.values(), strict=False))
    optimiser = torch.optim.Adam([{"params": [raw[name]], "lr": rates[name]} for name in NAMES], eps=1e-15)
    for step in range(4):
        drawn = raw | {"log_scales": raw["log_scales"].exp(), "logits": raw["logits"].sigmoid()}
        loss = photograph_loss(drawn, random_weights(step, TERMS))
        loss = loss + 0.3 * anisotropy_loss(raw["log_scales"], 3.0)
        loss = loss + 0.2 * drawn["logits"].mean() + 0.1 * drawn["log_scales"].mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        with torch.no_grad():
            raw["log_scales"].clamp_(np.log(1e-3), np.log(20.0))
    for name in ("centers", "rotations", "log_scales", "logits"):
        torch.testing.assert_close(parameters.raw[name], raw[name].detach(), rtol=TOLERANCE, atol=TOLERANCE)
    found, expected = parameters.raw["harmonics"], raw["harmonics"].detach()
    torch.testing.assert_close(found[:, 0], expected[:, 0], rtol=TOLERANCE, atol=TOLERANCE)
    start = splats().raw["harmonics"]
    share = RATES["others"] / RATES["constant"]
    torch.testing.assert_close(found[:, 1:] - start[:, 1:], share * (expected - start)[:, 1:], rtol=1e-3, atol=1e-5)


def test_splats_that_a_photograph_does_not_show_stay_as_they_are():
    seen = EVERY % 3 == 0
    parameters, adam = stepped(2, pulled=seen)
    before = splats().raw
    for name in NAMES:
        same = (parameters.raw[name] == before[name]).reshape(COUNT, -1).all(dim=1)
        assert torch.equal(same, ~seen), name
    assert adam.steps.tolist() == (2 * seen).tolist()


def test_drawing_only_what_is_in_view_changes_nothing():
    seen = EVERY % 3 == 0
    among_all, of_all = stepped(2, pulled=seen)
    alone, of_some = stepped(2, rows=torch.nonzero(seen)[:, 0])
    assert all(torch.equal(among_all.raw[name], alone.raw[name]) for name in NAMES)
    assert all(torch.equal(of_all.square[name], of_some.square[name]) for name in NAMES)
    assert torch.equal(of_all.steps, of_some.steps)


def test_harmonics_beyond_those_drawn_stay_as_they_are():
    parameters, adam = splats(), Adam()
    leaves = parameters.leaves(EVERY, 0)
    photograph_loss(leaves, random_weights(0, 1)).backward()
    adam.step(parameters.raw, EVERY, leaves, torch.ones(COUNT, 2), RATES, PRESSURE)
    changed = parameters.raw["harmonics"] != splats().raw["harmonics"]
    assert changed[:, 0].all()
    assert not changed[:, 1:].any()


@pytest.mark.parametrize("count", [2, 3])
def test_steps_are_the_same_bits_for_any_number_of_threads(count, monkeypatch):
    monkeypatch.setattr(threads, "WORTH_THREADS", 0)
    results = []
    for number in (1, count):
        monkeypatch.setattr(threads, "thread_count", lambda number=number: number)
        results.append(stepped(2)[0].raw)
    assert all(torch.equal(results[0][name], results[1][name]) for name in NAMES)


def test_new_rows_start_without_memory_and_dropped_ones_are_gone():
    _, adam = stepped(2)
    adam.forget(torch.tensor([3]), 2)
    assert adam.steps[[2, 3, COUNT, COUNT + 1]].tolist() == [2, 0, 0, 0]
    assert float(adam.square["centers"][3].sum()) == 0 < float(adam.square["centers"][2].sum())
    adam.keep(torch.arange(COUNT + 2) < 3)
    assert adam.steps.tolist() == [2, 2, 2]
    assert adam.mean["logits"].shape == (3,)
