"""Every material, friction match, wall and terrain: fifty substeps, then a whole collapse, against the reference."""

from typing import get_args

import numpy as np
import pytest

from slideframe.problem import Material, SimulationProblem, Transfer, Wall, kind_of, models_of
from slideframe.problem.material import FrictionMatch
from slideframe.verification.agreement import compare
from slideframe.verification.scenes import slice_of

# physics.md, "Agreement ladder"
FIELD_TOLERANCE = 1e-3
LONG_TOLERANCE_TO_REFERENCE, LONG_TOLERANCE_BETWEEN = 0.02, 0.01
# what is below it is rounding of the velocity gradient, in a mass that falls as one
SMALL_STRAIN = 1e-3
SPACING = 0.125
STIFFNESS = {"density": 2000, "youngs_modulus": 1e6, "poisson_ratio": 0.3}
EARTH = {"kind": "drucker_prager", "friction_angle": 30, "cohesion": 1e3, "dilatancy_angle": 5} | STIFFNESS
# One for each member of the union, and more where a member has modes.
MATERIALS = {
    "elastic": {"kind": "elastic"} | STIFFNESS,
    "sand": {"kind": "sand", "friction_angle": 30} | STIFFNESS,
    "sand that forgets expansion": {"kind": "sand", "friction_angle": 30, "volume_correction": False} | STIFFNESS,
    **{match: EARTH | {"friction_match": match} for match in get_args(FrictionMatch)},
    "cut off": EARTH | {"tension_cutoff": 200.0},
}
WALLS = {kind: {"kind": kind} for kind in get_args(Wall.model_fields["kind"].annotation)}
WALLS["friction"] = {"kind": "friction", "friction_angle": 20.0}
TRANSFERS = {
    "apic": {"kind": "apic"},
    "pic": {"kind": "pic_flip", "flip_share": 0.0},
    "flip": {"kind": "pic_flip", "flip_share": 1.0},
    "asflip": {"kind": "asflip"},
}
GROUND = {
    "terrain_vertices": np.array([[-1, -1, 0.3], [4, -1, -0.1], [4, 1, -0.1], [-1, 1, 0.3]], np.float32),
    "terrain_triangles": np.array([[0, 1, 2], [0, 2, 3]], np.int32),
}


def test_every_material_is_compared():
    assert {material["kind"] for material in MATERIALS.values()} == {kind_of(model) for model in models_of(Material)}


def test_every_transfer_is_compared():
    assert {transfer["kind"] for transfer in TRANSFERS.values()} == {kind_of(model) for model in models_of(Transfer)}


def scene(material="sand", floor="friction", duration=0.2, frames=1, ground=False, transfer="apic"):
    """A block of 1 m by 0.5 m at the low wall that slumps towards an open channel of 3 m."""
    start = slice_of((0.0, 0.375 if ground else 0.0), (1.0, 0.875 if ground else 0.5), SPACING, 3.0)
    if ground:
        start = start.model_copy(update=GROUND)
    boundary = {"floor": WALLS["slip" if ground else floor]}
    if ground:
        boundary["terrain"] = WALLS[floor]
    simulation = {"duration": duration, "frame_rate": frames / duration, "grid_spacing": SPACING}
    simulation |= {"transfer": TRANSFERS[transfer], "record_stress": True}
    problem = {"material": MATERIALS[material], "boundary": boundary, "simulation": simulation}
    return start, SimulationProblem.model_validate(problem)


def named(what):
    return "-".join(name if value is True else value for name, value in what.items())


SHORT = [
    *({"material": material} for material in MATERIALS),
    *({"floor": floor} for floor in WALLS),
    *({"floor": floor, "ground": True} for floor in WALLS),
    *({"transfer": transfer} for transfer in TRANSFERS),
]


def relative(mine, theirs):
    return np.abs(mine - theirs).max() / max(np.abs(theirs).max(), 1e-6)


@pytest.mark.parametrize("what", SHORT, ids=named)
def test_short_runs_agree_field_by_field(motion, backend, what):
    mine, theirs = (motion(name, *scene(**what))[-1] for name in (backend, "reference"))
    assert relative(mine.positions, theirs.positions) <= FIELD_TOLERANCE
    assert relative(mine.velocities, theirs.velocities) <= FIELD_TOLERANCE
    assert relative(mine.deformation_gradients, theirs.deformation_gradients) <= FIELD_TOLERANCE
    strained = max(float(theirs.plastic_strains.max()), SMALL_STRAIN)
    assert np.abs(mine.plastic_strains - theirs.plastic_strains).max() <= FIELD_TOLERANCE * strained


# One of each law, and the ways to meet the ground: a collapse takes the reference seconds.
LONG = [
    {"material": "elastic"},
    {"material": "sand"},
    {"material": "mohr_coulomb", "floor": "stick"},
    {"floor": "open"},
    {"floor": "friction", "ground": True},
    {"transfer": "flip"},
    {"transfer": "asflip"},
]


def collapse(what):
    return scene(**what, duration=0.6, frames=3)


@pytest.mark.parametrize("what", LONG, ids=named)
def test_long_runs_agree_in_what_matters(motion, backend, what):
    filling, problem = collapse(what)
    result = compare(*(motion(name, filling, problem) for name in (backend, "reference")), filling, problem)
    assert result.agrees(LONG_TOLERANCE_TO_REFERENCE), result.figures


@pytest.mark.parametrize("what", LONG, ids=named)
def test_long_runs_agree_between_backends(motion, what):
    filling, problem = collapse(what)
    result = compare(*(motion(name, filling, problem) for name in ("mpm_warp", "mpm_taichi")), filling, problem)
    assert result.agrees(LONG_TOLERANCE_BETWEEN), result.figures


def test_a_stronger_sand_breaks_the_agreement(motion):
    """Negative control: five degrees of friction angle are no rounding."""
    filling, problem = collapse({"material": "sand"})
    stronger = problem.model_copy(update={"material": problem.material.model_copy(update={"friction_angle": 35.0})})
    frames = [motion("mpm_warp", filling, each) for each in (problem, stronger)]
    assert not compare(*frames, filling, problem).agrees(LONG_TOLERANCE_TO_REFERENCE)
