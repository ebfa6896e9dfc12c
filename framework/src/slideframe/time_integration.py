"""The march of explicit solvers through time: steps that land on output times, initial stress, watch, and stop."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from slideframe.arrays import Float64Array
from slideframe.checkpoint import Checkpoints, State
from slideframe.guards import Pace, check_motion, start_frame
from slideframe.initial_stress import depths, geostatic_strain
from slideframe.problem import Grid, SimulationProblem, Vector
from slideframe.products import Filling, ParticleFrame
from slideframe.stages import Context

# The speed that a step is made for is rounded up to a multiple of this share of the wave speed, so that the rounding
# of a backend's speeds seldom changes its steps.
SPEED_GRAIN = 0.05
# The ramp of gravity and the hold test, in periods T1 = 4 H / c_p of the mass's slowest vertical oscillation.
RAMP_PERIODS = 5
HOLD_PERIODS = 1
# Share of the critical damping of that oscillation while gravity rises.
DAMPING_RATIO = 0.5
# A hold test that moves faster than this share of what sudden gravity would cause is worth a warning.
HOLD_SHARE = 0.05
# Soil that its own weight, rho g H / M, would press by more than this share is worth a warning.
SOFT_SHARE = 0.1


@dataclass(frozen=True)
class Step:
    """What a substep is done with.

    Attributes:
        time_step: s.
        gravity: m/s2.
        kept: share of every node's velocity that damping leaves.
        settling: stress builds up: the soil doesn't yield and holds to the ground and to frictional walls.
    """

    time_step: float
    gravity: Vector
    kept: float = 1.0
    settling: bool = False


class Stepper(Protocol):
    """One simulation's particles and grid, in a backend's memory."""

    def begin(self, step: Step) -> None:
        """Do all later substeps with `step`; stress terms made for another time step are made anew."""

    def substep(self) -> float:
        """Advance by one time step; return the greatest component of velocity, m/s, a huge one for NaN."""

    def load(self, hencky: Float64Array) -> None:
        """Take elastic Hencky strains (n, 3, 3) in the order of the filling as the state; before the first `begin`."""

    def restart(self) -> None:
        """Put the particles back where they were at t = 0, moving as then and undeformed, and keep their stress."""

    def motion(self) -> tuple[Float64Array, npt.NDArray[np.floating]]:
        """Return positions (n, 3), m, and velocities (n, 3), m/s, in the order of the filling."""

    def frame(self, time: float) -> ParticleFrame:
        """Return copies of the state."""


@runtime_checkable
class Resumable(Protocol):
    """A stepper that can keep its state."""

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return all that the next substep depends on."""

    def restore(self, state: State) -> None:
        """Go on from a state."""


@dataclass
class March:
    """Carries one simulation from its start to its end.

    Attributes:
        elapsed: simulated time since t = 0, s; negative while stress builds up.
        substeps: taken in the present frame.
    """

    filling: Filling
    problem: SimulationProblem
    grid: Grid
    context: Context
    speed: float = field(default=0.0, init=False)
    elapsed: float = field(default=0.0, init=False)
    substeps: int = field(default=0, init=False)
    pace: Pace = field(init=False)

    def frames(self, stepper: Stepper, checkpoints: Checkpoints | None = None) -> Iterator[ParticleFrame]:
        """Yield the frames until the duration has passed or the mass has come to rest.

        With `checkpoints`, of a stepper that can keep its state, a broken run goes on after its last one.
        """
        simulation = self.problem.simulation
        masses = self.problem.material.density * self.filling.particle_volumes.astype(np.float64)
        self.pace = pace = Pace(self.context, simulation, masses, self._first_step())
        found = checkpoints.latest() if checkpoints else None
        first, peak = 1, 0.0
        if found:
            assert isinstance(stepper, Resumable)
            first, peak = found[0] + 1, float(found[1]["peak"])
            self.speed = float(found[1]["speed"])
            stepper.restore(found[1])
            pace.resume(int(found[1]["substeps"]))
            found = None  # its arrays
        else:
            self._report_resolution()
            self._build_up_stress(stepper)
            yield self._start(stepper)
        for frame in range(first, simulation.frame_count):
            self.elapsed, self.substeps = (frame - 1) / simulation.frame_rate, 0
            with pace:
                self._advance(stepper, 1 / simulation.frame_rate, simulation.gravity)
            product = stepper.frame(frame / simulation.frame_rate)
            energy = pace.kinetic_energy(product)
            peak = max(peak, energy)
            resting = simulation.stop == "rest" and energy < simulation.rest_share * peak
            pace.frame_done(frame, self.substeps, product, energy, last=resting)
            yield product
            if resting:
                return
            if checkpoints and checkpoints.is_due(frame):
                assert isinstance(stepper, Resumable)
                own = {"substeps": pace.substeps, "speed": self.speed, "peak": peak}
                checkpoints.write(frame, stepper.state() | {name: np.array(value) for name, value in own.items()})

    def _start(self, stepper: Stepper) -> ParticleFrame:
        """Return the frame at t = 0 with the stress that has been built up."""
        start, simulation = start_frame(self.filling, self.problem), self.problem.simulation
        if not simulation.record_stress or simulation.initial_stress == "none":
            return start
        stressed = stepper.frame(0.0)
        fields = ("mean_stresses", "deviatoric_stresses")
        return start.model_copy(update={name: getattr(stressed, name) for name in fields})

    def _report_resolution(self) -> None:
        """Report how many cells lie across the mass where it's thickest, along gravity, and warn of soil too soft."""
        gravity = np.array(self.problem.simulation.gravity)
        if strength := float(np.linalg.norm(gravity)):
            simulation = self.problem.simulation
            thickness = float(depths(self.filling, -gravity / strength).max()) + simulation.particle_spacing / 2
            self.context.figure("cells_across_thickness", thickness / simulation.grid_spacing)
            pressed = strength * thickness / self.problem.material.pressure_wave_speed**2
            if pressed > SOFT_SHARE:
                self.context.warn(
                    f"the soil is too soft for its height: its own weight would press {thickness:.3g} m of it by about "
                    f"{pressed:.3g} of that; look at material.youngs_modulus"
                )

    def _first_step(self) -> float:
        self.speed = float(np.abs(self.filling.start_velocities()).max())
        frame = 1 / self.problem.simulation.frame_rate
        return frame / math.ceil(frame / self._longest_step(self._speed_bound()) - 1e-9)

    def _speed_bound(self) -> float:
        """Return the speed that steps are made for from now on, m/s."""
        simulation, wave = self.problem.simulation, self.problem.material.pressure_wave_speed
        # by the frame's end gravity may have added this
        gained = float(np.linalg.norm(simulation.gravity)) / simulation.frame_rate
        return SPEED_GRAIN * wave * math.ceil((self.speed + gained) / (SPEED_GRAIN * wave))

    def _longest_step(self, bound: float) -> float:
        """Return the stable time step for speeds up to `bound`, s."""
        simulation = self.problem.simulation
        if simulation.time_step == "fixed":
            return self.problem.time_step(self.grid)[0]
        return simulation.cfl * self.grid.spacing / (self.problem.material.pressure_wave_speed + bound)

    def _advance(
        self, stepper: Stepper, duration: float, gravity: Vector, *, kept: float = 1.0, settling: bool = False
    ) -> None:
        """Take equal steps that end exactly after `duration`; shorter ones from where the mass outruns them.

        `kept` is the share of velocity that damping leaves after `duration`.
        """
        adaptive = self.problem.simulation.time_step == "adaptive"
        # steps that shrink with the speed would let a runaway particle go on for ever: none may cross a cell in the
        # step that is enough for a fall through the whole grid
        fall_step = self.problem.time_step(self.grid)[0]
        remaining, left, bound, time_step = duration, 0, 0.0, 0.0
        while True:
            if not left or (adaptive and self.speed > bound):
                bound = self._speed_bound()
                left = max(1, math.ceil(remaining / self._longest_step(bound) - 1e-9))
                time_step = remaining / left
                stepper.begin(Step(time_step, gravity, kept ** (time_step / duration), settling))
            self.speed = stepper.substep()
            left, remaining = left - 1, remaining - time_step
            self.substeps, self.elapsed = self.substeps + 1, self.elapsed + time_step
            # written so that NaN, too, is found
            watched = max(time_step, fall_step)
            if not self.speed * watched <= self.grid.spacing:
                check_motion(*stepper.motion(), self.elapsed, self.grid, watched)
            if not left:
                return
            self.pace.substep_done(self.elapsed, time_step, self.speed)

    def _build_up_stress(self, stepper: Stepper) -> None:
        kind = self.problem.simulation.initial_stress
        if kind == "none":
            return
        if kind == "k0":
            stepper.load(geostatic_strain(self.filling, self.problem))
            return
        self._ramp(stepper)

    def _ramp(self, stepper: Stepper) -> None:
        """Let gravity rise over several periods with damping, hold it without, report how still that is, and go back.

        The scanned ground has settled already: only the stress is kept.
        """
        gravity = np.array(self.problem.simulation.gravity)
        strength, wave = float(np.linalg.norm(gravity)), self.problem.material.pressure_wave_speed
        if strength == 0:
            return
        along = self.filling.particle_positions.astype(np.float64) @ gravity / strength
        height = float(np.ptp(along)) + self.problem.simulation.particle_spacing
        period = 4 * height / wave
        part = period / 10
        kept = math.exp(-2 * DAMPING_RATIO * (2 * math.pi / period) * part)
        ramp = 10 * RAMP_PERIODS
        self.elapsed = -period * (2 * RAMP_PERIODS + HOLD_PERIODS)
        for index in range(2 * ramp):
            share = min((index + 1) / ramp, 1.0)
            self._advance(stepper, part, tuple((share * gravity).tolist()), kept=kept, settling=True)
        fastest = 0.0
        for _ in range(10 * HOLD_PERIODS):
            self._advance(stepper, part, tuple(gravity.tolist()), settling=True)
            _, velocities = stepper.motion()
            fastest = max(fastest, float(np.sqrt((velocities.astype(np.float64) ** 2).sum(axis=1).mean())))
        # a column that is loaded all at once swings with g H / c_p at its top
        sudden = strength * height / wave
        self.context.figure("hold_test_speed_m_s", fastest)
        self.context.figure("hold_test_share_of_sudden_loading", fastest / sudden)
        if fastest > HOLD_SHARE * sudden:
            self.context.warn(
                f"the initial stress is not in balance: under steady gravity the mass moves with {fastest:.3g} m/s"
            )
        stepper.restart()
        self.speed, self.elapsed = float(np.abs(self.filling.start_velocities()).max()), 0.0
