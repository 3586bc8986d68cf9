"""Controllers from identified models: a sampled PI by lambda tuning."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel

if TYPE_CHECKING:
    from control import TransferFunction

__all__ = ["FirstOrderDelay", "PiController", "lambda_tuning", "reduce_to_first_order"]

_EARLY, _LATE = 1.0 - np.exp(-1.0 / 3.0), 1.0 - np.exp(-1.0)  # a first-order lag is there at T/3 and at T
_SETTLED = 1e-4  # of the final value: what the slowest pole leaves at the end of the step response
_LONGEST = 200_000  # samples of a step response
_DELAY_SHARE = 3.0
"""The closed loop is slower than the delay by this factor; Rivera et al. ask for at least 1.7."""
_SAMPLES = 10.0
"""Samples in a closed-loop time constant (Åström & Wittenmark, Computer-Controlled Systems, section 4.4: the
crossover frequency times the sample time at most 0.05 to 0.14)."""
_BAND_SHARE = 0.5
"""The crossover lies at this share of the band that the recording excited."""


@dataclass(frozen=True, kw_only=True)
class FirstOrderDelay:
    """``gain * exp(-delay s) / (time_constant s + 1)``: what lambda tuning needs to know of a plant.

    Parameters
    ----------
    gain : float
        Output unit by input unit.
    time_constant, delay : float
        s.
    """

    gain: float
    time_constant: float
    delay: float


@dataclass(frozen=True, kw_only=True)
class PiController:
    """A sampled PI controller with limits and anti-windup by conditional integration.

    ``u(k) = u_0 + K_p e(k) + s(k)``, ``s(k) = s(k-1) + K_i h e(k)``; where the command would pass a limit, it
    stays at the limit, and an error that pushes further is not integrated.

    Parameters
    ----------
    sample_time : float
        h, s.
    proportional : float
        K_p, input unit by output unit.
    integral : float
        K_i, input unit by output unit and second.
    operating_input : float
        u_0, the command for no error, in its unit.
    command_min, command_max : float
        Limits of the command, in its unit.
    closed_loop_time : float
        Time constant that was asked of the closed loop, s.

    Raises
    ------
    ControlError
        If a value is not finite, or the operating input does not lie inside the limits.
    """

    sample_time: float
    proportional: float
    integral: float
    operating_input: float
    command_min: float
    command_max: float
    closed_loop_time: float

    def __post_init__(self) -> None:
        values = (self.proportional, self.integral, self.operating_input, self.command_min, self.command_max)
        if not (all(map(isfinite, values)) and self.sample_time > 0.0 and self.closed_loop_time > 0.0):
            raise ControlError(f"every value of a controller must be finite, and its times positive: {self}")
        if not self.command_min < self.operating_input < self.command_max:
            raise ControlError(
                f"the operating input {self.operating_input:g} must lie between the limits of the command, "
                f"{self.command_min:g} and {self.command_max:g}"
            )

    @property
    def numerator(self) -> tuple[float, float]:
        """Coefficients of z^0 and z^-1, input unit by output unit."""
        return self.proportional + self.integral * self.sample_time, -self.proportional

    @property
    def denominator(self) -> tuple[float, float]:
        """Coefficients of z^0 and z^-1."""
        return 1.0, -1.0

    def command(self, error: float, memory: float) -> tuple[float, float]:
        """One sample of the controller.

        Parameters
        ----------
        error : float
            Reference minus reading, in the output's unit.
        memory : float
            The integral s(k-1) that the sample before returned, 0 at the start, in the input's unit.

        Returns
        -------
        command : float
            Inside the limits, in the input's unit.
        memory : float
            s(k).
        """
        change = self.integral * self.sample_time * error
        wanted = self.operating_input + self.proportional * error + memory + change
        command = min(max(wanted, self.command_min), self.command_max)
        further = (wanted - command) * change > 0.0
        return command, memory if further else memory + change

    def response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Frequency response from error to command.

        Parameters
        ----------
        omega : array_like, shape (n,)
            Angular frequencies above 0, rad/s.

        Returns
        -------
        ndarray of complex, shape (n,)
            Input unit by output unit.
        """
        delay = np.exp(-1j * np.asarray(omega, dtype=np.float64) * self.sample_time)
        values = np.polyval(self.numerator[::-1], delay) / np.polyval(self.denominator[::-1], delay)
        return np.asarray(values, dtype=np.complex128)

    def scaled(self, factor: float) -> PiController:
        """The same controller with another loop gain.

        Parameters
        ----------
        factor : float
            Of both gains.

        Returns
        -------
        PiController
        """
        return replace(self, proportional=factor * self.proportional, integral=factor * self.integral)

    def to_control(self) -> TransferFunction:
        """The controller without its limits as a discrete system of python-control.

        Returns
        -------
        control.TransferFunction
            From error to command, ``dt`` equal to the sample time.
        """
        import control

        return control.tf(
            self.numerator, self.denominator, self.sample_time, inputs=["error"], outputs=["command"]
        )


def reduce_to_first_order(linear: LinearModel) -> FirstOrderDelay:
    """Reduce a model to gain, lag and delay by two points of its step response.

    A lag with a delay reaches 28.3 % of its final value a third of its time constant after the delay, and
    63.2 % the whole. Unlike the slowest pole, or moments of the impulse response, this is not misled by the
    slow creep of an actuator that answers nearly at once: most of its response is there after a sample, and
    what follows slowly moves neither point.

    Parameters
    ----------
    linear : LinearModel
        As the controller sees it (`LinearModel.in_loop`).

    Returns
    -------
    FirstOrderDelay
        Neither lag nor delay is negative.

    Raises
    ------
    ModelError
        If no controller can be designed on the model.

    References
    ----------
    C. L. Smith, Digital Computer Process Control (1972): the two-point method; also in Seborg, Edgar,
    Mellichamp, Process Dynamics and Control, section 7.2.
    """
    slowest = float(np.abs(linear.require().poles).max(initial=0.0))
    decay = np.log(_SETTLED) / np.log(slowest) if slowest > 0.0 else 0.0
    count = int(min(max(decay, 0.0), _LONGEST)) + linear.numerator.size + linear.denominator.size + 1
    reached = linear.step_response(count) / linear.static_gain
    early, late = (_first_time(reached, share) * linear.sample_time for share in (_EARLY, _LATE))
    time_constant = 1.5 * (late - early)
    return FirstOrderDelay(
        gain=linear.static_gain, time_constant=time_constant, delay=max(late - time_constant, 0.0)
    )


def _first_time(values: np.ndarray, level: float) -> float:
    """Sample, with its fraction, at which a level is first reached."""
    after = int(np.argmax(values >= level))
    if after == 0:
        return 0.0
    return float(after - (values[after] - level) / (values[after] - values[after - 1]))


def lambda_tuning(
    linear: LinearModel,
    *,
    command_limits: tuple[float, float],
    closed_loop_time: float | None = None,
    band_Hz: float | None = None,
) -> PiController:
    r"""Tune a sampled PI controller for a wanted time constant of the closed loop.

    For a gain K, a lag T and a delay theta, internal model control gives with the first-order expansion of
    the delay :math:`K_i = 1/(K(\lambda + \theta))` and :math:`K_p = T K_i`.

    - theta includes half a sample for the hold.
    - K is the largest gain from 0 Hz to the crossover, so that a model that answers more at once than at rest
      is not given too much.
    - A lag shorter than lambda is not cancelled but counted with the delay: :math:`K_p = 0`,
      :math:`K_i = 1/(K(\lambda + \theta + T))`. Cancelling it would gain little speed and lift the loop gain
      at all frequencies above, where a DEA has its ball's lightly damped mode, which a recording up to 1 Hz
      does not show. So a nearly static actuator gets an integral controller.

    Parameters
    ----------
    linear : LinearModel
        As the controller sees it (`LinearModel.in_loop`).
    command_limits : (float, float)
        Least and largest command, in its unit.
    closed_loop_time : float, optional
        Lambda, s. By default the largest of the lag, three times the delay, ten samples, and what puts the
        crossover at half of `band_Hz`.
    band_Hz : float, optional
        Band that the recording excited, Hz.

    Returns
    -------
    PiController
        At the sample time of the model.

    Raises
    ------
    ModelError
        If no controller can be designed on the model.
    ControlError
        If the closed-loop time is shorter than a sample, or the limits do not enclose the operating input.

    References
    ----------
    Rivera, Morari & Skogestad, "Internal model control: PID controller design", Ind. Eng. Chem. Process Des.
    Dev. 25 (1986) 252-265, doi:10.1021/i200032a041.
    """
    plant, h = reduce_to_first_order(linear), linear.sample_time
    lag, delay = plant.time_constant, plant.delay + 0.5 * h
    if closed_loop_time is None:
        crossover_time = 0.0 if band_Hz is None else 1.0 / (2 * np.pi * _BAND_SHARE * band_Hz)
        closed_loop_time = max(lag, _DELAY_SHARE * delay, _SAMPLES * h, crossover_time)
    if not (isfinite(closed_loop_time) and closed_loop_time >= h):
        raise ControlError(
            f"a closed-loop time of {closed_loop_time:g} s: it must be finite and at least a sample, {h:g} s"
        )
    cancelled = lag if lag >= closed_loop_time else 0.0
    horizon = closed_loop_time + delay + (lag - cancelled)
    frequencies = np.linspace(0.0, min(1.0 / horizon, np.pi / h), 200)
    gain = np.copysign(np.abs(linear.response(frequencies)).max(), plant.gain)
    integral = 1.0 / (gain * horizon)
    return PiController(
        sample_time=h, proportional=float(cancelled * integral), integral=float(integral),
        operating_input=linear.operating_input, command_min=float(command_limits[0]),
        command_max=float(command_limits[1]), closed_loop_time=float(closed_loop_time),
    )  # fmt: skip
