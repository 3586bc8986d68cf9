"""The references of a check, run on the physics plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deatwin.control.design.lambda_tuning import PiController
from deatwin.control.linear.model import LinearModel
from deatwin.control.loop.closed_loop import ClosedLoop, closed_loop, sine_reference, step_reference
from deatwin.plant.model import Plant

__all__ = ["Trial"]

Progress = Callable[[float], None]

STEP_SHARE = 0.3
"""Amplitude of the references, as a share of the stroke from the operating point to the nearer limit."""
PLATEAU = 10.0
"""Closed-loop times for which a step's level is held."""
SHORTEST = 50
"""Samples for which it is held at least, so that what still moves at its end is not the step itself."""
SINE_SHARE = 0.2
"""Frequency of the sine reference, as a share of the bandwidth 1/(2 pi lambda) that was asked for."""
SINE_PERIODS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """A controller and a plant to try it on.

    Parameters
    ----------
    plant : Plant
        The actuator.
    controller : PiController
        To be tried.
    linear : LinearModel
        Sound model of the actuator as the controller sees it: sets the operating point and the amplitude.
    rng : numpy.random.Generator
        Source of the sensor's noise.
    """

    plant: Plant
    controller: PiController
    linear: LinearModel
    rng: np.random.Generator

    @property
    def centre(self) -> float:
        """Output about which the references move, in its unit."""
        output = self.linear.require().operating_output
        return 0.0 if output is None else output

    @property
    def amplitude(self) -> float:
        """Of the references, in the output's unit."""
        c = self.controller
        room = min(c.operating_input - c.command_min, c.command_max - c.operating_input)
        return STEP_SHARE * abs(self.linear.static_gain) * room

    @property
    def frequency_Hz(self) -> float:
        """Of the sine reference, Hz."""
        return SINE_SHARE / (2 * np.pi * self.controller.closed_loop_time)

    def steps(self, factor: float, progress: Progress | None = None) -> ClosedLoop:
        """Run the step reference.

        Parameters
        ----------
        factor : float
            By which both gains of the controller are raised.
        progress : callable, optional
            Called with the share that is done.

        Returns
        -------
        ClosedLoop
        """
        plateau = max(
            round(PLATEAU * self.controller.closed_loop_time / self.controller.sample_time), SHORTEST
        )
        reference = step_reference(self.centre, self.amplitude, plateau)
        controller = self.controller.scaled(factor)
        return closed_loop(self.plant, controller, reference, rng=self.rng, progress=progress)

    def sine(self, progress: Progress | None = None) -> ClosedLoop:
        """Run the sine reference.

        Parameters
        ----------
        progress : callable, optional
            Called with the share that is done.

        Returns
        -------
        ClosedLoop
        """
        reference = sine_reference(
            self.centre, self.amplitude, self.frequency_Hz, self.controller.sample_time, SINE_PERIODS
        )
        return closed_loop(self.plant, self.controller, reference, rng=self.rng, progress=progress)

    def sine_error(self) -> float:
        """Rms error on the sine that the model predicts: its amplitude times the sensitivity function."""
        omega = 2 * np.pi * self.frequency_Hz
        loop = self.controller.response([omega]) * self.linear.response([omega])
        return float(self.amplitude / np.sqrt(2.0) / np.abs(1.0 + loop[0]))
