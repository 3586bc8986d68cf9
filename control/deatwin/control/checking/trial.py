"""Run the references of a check, steps and a sine, on the physics plant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.control.checking.verdict import Runs
from deatwin.control.controllers.base import Controller, room_of
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel
from deatwin.control.loop.closed_loop import ClosedLoop, closed_loop
from deatwin.control.loop.references import LEVELS, sine_reference, step_reference
from deatwin.control.progress import Progress, part
from deatwin.plant.arrays import Array
from deatwin.plant.model import Plant

STEP_SHARE = 0.3  # Amplitude of the references, as a share of the stroke from the operating point to the nearer limit
PLATEAU = 10.0  # Time for which a step's level is held, in closed-loop times
SHORTEST = 50  # Least number of samples of a level, so that motion at its end is not the step itself
SINE_SHARE = 0.2  # Frequency of the sine reference, as a share of the requested bandwidth 1/(2 pi lambda)
SINE_PERIODS = 3
LONGEST = 200_000  # Largest number of samples of steps and sine together; each draw of the model runs through them, too


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A controller with the references on which it is tested."""

    controller: Controller
    linear: LinearModel
    rng: np.random.Generator  # Random generator for the sensor noise

    @property
    def centre(self) -> float:
        """Output about which the references move, in its unit."""
        output = self.linear.require().operating_output
        return 0.0 if output is None else output

    @property
    def amplitude(self) -> float:
        """Amplitude of the references, in the output's unit."""
        return STEP_SHARE * abs(self.linear.static_gain) * room_of(self.controller)

    @property
    def frequency_Hz(self) -> float:
        """Frequency of the sine reference, Hz."""
        return SINE_SHARE / (2 * np.pi * self.controller.closed_loop_time)

    @property
    def step_reference(self) -> Array:
        """Steps that rise in a closed-loop time, in the output's unit."""
        h, time = self.controller.sample_time, self.controller.closed_loop_time
        plateau = max(round(PLATEAU * time / h), SHORTEST)
        return step_reference(self.centre, self.amplitude, plateau, rise=min(round(time / h), plateau - 1))

    @property
    def sine_reference(self) -> Array:
        """A slow sine, in the output's unit."""
        h = self.controller.sample_time
        return sine_reference(self.centre, self.amplitude, self.frequency_Hz, h, SINE_PERIODS)

    def runs(self, source: str, plant: Plant, progress: Progress | None = None) -> Runs:
        """Run both references on a plant. `plant` with the controller's sample time."""
        steps = self._run(plant, self.controller, self.step_reference, part(progress, 0.0, 0.5))
        sine = self._run(plant, self.controller, self.sine_reference, part(progress, 0.5, 1.0))
        return Runs(source=source, steps=steps, sine=sine)

    def raised(self, plant: Plant, factor: float, progress: Progress | None = None) -> ClosedLoop:
        """Run the steps with a larger loop gain. `plant` must have the controller's sample time."""
        return self._run(plant, self.controller.scaled(factor), self.step_reference, progress)

    def _run(self, plant: Plant, controller: Controller, reference: Array, progress: Progress | None) -> ClosedLoop:
        return closed_loop(plant, controller, reference, rng=self.rng, progress=progress)

    def sine_error(self) -> float:
        """Return the rms error that the model predicts for the sine, with the law's own response to the reference."""
        omega = 2 * np.pi * self.frequency_Hz
        law = self.controller.local(self.controller.operating_input)
        z, model = np.exp(1j * omega * self.controller.sample_time), self.linear.response([omega])[0]
        asked, seen = law.c @ np.linalg.solve(z * np.eye(law.c.size) - law.a, law.b) + law.d
        return float(self.amplitude / np.sqrt(2.0) * np.abs(1.0 - asked * model / (1.0 - seen * model)))


def require_short_runs(controller: Controller) -> None:
    """Raise ControlError if steps and sine, which grow with the closed-loop time, would need too many samples."""
    times = len(LEVELS) * PLATEAU + SINE_PERIODS * 2 * np.pi / SINE_SHARE  # duration of the runs in closed-loop times
    time, h = controller.closed_loop_time, controller.sample_time
    if times * time > LONGEST * h:
        raise ControlError(
            f"the closed-loop time of {time:g} s is too long for a sample time of {h:g} s: the simulated runs would "
            f"need {times * time / h:.3g} samples, but the limit is {LONGEST}; give "
            f"{_rounded_down(LONGEST * h / times):g} s or less"
        )


def _rounded_down(value: float) -> float:
    """Round down to three digits, so that the printed number still satisfies the limit."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(np.floor(value / unit) * unit)
