"""What each transfer between particles and grid keeps: momentum, spin, and the motion that the grid can't see."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from slideframe.problem import (
    AffineTransfer,
    BlendTransfer,
    Elastic,
    SeparableTransfer,
    Simulation,
    SimulationProblem,
    Transfer,
)
from slideframe.verification.card import Line
from slideframe.verification.case import Case
from slideframe.verification.conservation import GRAVITY, flying_block, momentum, spinning_plate, turning
from slideframe.verification.rig import Motion, Rig
from slideframe.verification.scenes import filling, lattice

# Positions stay under the pairs' grid only if no excess moves them.
TRANSFERS: dict[str, Transfer] = {
    "PIC": BlendTransfer(flip_share=0.0),
    "APIC": AffineTransfer(),
    "FLIP 0.95": BlendTransfer(flip_share=0.95),
    "FLIP": BlendTransfer(flip_share=1.0),
    "AFLIP 0.9": SeparableTransfer(velocity_share=0.9, separation=0.0),
}


def paired_block(rig: Rig, transfer: Transfer) -> Motion:
    """Return a block that flies freely, whose particles are pairs at one place that move against each other."""
    positions, volume = lattice((0.5, 0.5, 0.5), (1.0, 1.0, 1.0), (8, 8, 8))
    velocities = np.zeros((2 * len(positions), 3), np.float32)
    velocities[:, 0] = np.repeat([1.0, -1.0], len(positions))
    start = filling(
        np.tile(positions, (2, 1)), volume / 2, ((0, 0, 0), (1.5, 1.5, 1.5)), particle_velocities=velocities
    )
    problem = SimulationProblem(
        material=Elastic(density=1000, youngs_modulus=1e6, poisson_ratio=0.3),
        simulation=Simulation(
            duration=0.01, frame_rate=100, grid_spacing=0.125, gravity=(0, 0, 0), time_step="fixed", transfer=transfer
        ),
    )
    return rig.run(start, problem)


def unseen(rig: Rig) -> Iterator[Line]:
    """Pairs at one place that move against each other: the grid is at rest, so each substep keeps the share alone."""
    for name, transfer in TRANSFERS.items():
        motion = paired_block(rig, transfer)
        _, substeps = motion.problem.time_step(motion.problem.grid(motion.filling))
        kept = float(np.abs(motion.velocities[-1, :, 0]).mean())
        expected = transfer.constants.velocity_share**substeps
        title = f"speed against one another of paired particles, {name}"
        yield Line(title, "", expected, kept, 1e-4, "share of the excess, to the power of the substeps")


def impulse(rig: Rig) -> Iterator[Line]:
    """Momentum of a block that vibrates, spins and falls, under the transfers that split stress from momentum."""
    for name in ("FLIP 0.99", "ASFLIP 0.99"):
        motion = flying_block(rig, (1.0, -2.0, 3.0), 2.0, GRAVITY, PLATES[name])
        expected = motion.masses.sum() * np.array(GRAVITY) * motion.times[-1]
        error = float(np.abs(momentum(motion)[-1] - momentum(motion)[0] - expected).max() / np.abs(expected).max())
        yield Line(f"momentum of a flying block, error, {name}", "", 0.0, error, 1e-5, "Newton's second law")


def spins(rig: Rig) -> Iterator[Line]:
    """The spinning plate: ASFLIP keeps what APIC does, and PIC must lose it, or the card couldn't tell them apart."""
    kept = {name: turning(spinning_plate(rig, each)) for name, each in PLATES.items()}
    change = float(np.abs(kept["ASFLIP 0.99"][2:] / kept["ASFLIP 0.99"][1] - 1).max())
    yield Line("angular momentum of a spinning plate, change, ASFLIP 0.99", "", 0.0, change, 1e-3, "Fei et al. 2021")
    left = float(kept["PIC"][-1] / kept["PIC"][0])
    yield Line("control: what PIC leaves of it", "", 0.0, left, 1e-2, "Jiang et al. 2015")
    order = ["PIC", "FLIP 0.99", "ASFLIP 0.99"]
    ordered = all(kept[low][-1] < kept[high][-1] for low, high in pairwise(order))
    yield Line("it falls in the order " + ", ".join(order), "", 1.0, float(ordered), 0.0, "Fei et al. 2021")


PLATES: dict[str, Transfer] = {
    "PIC": BlendTransfer(flip_share=0.0),
    "FLIP 0.99": BlendTransfer(),
    "ASFLIP 0.99": SeparableTransfer(),
}

CASES = (
    Case("what the grid can't see, by transfer", unseen),
    Case("momentum, by transfer", impulse),
    Case("spin, by transfer", spins),
)
