"""Make PI and PID laws with limits from their gains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.control.arguments import finite, instance, number, pair, positive, require_fields, taking
from deatwin.control.controllers.law import REFERENCE, Law
from deatwin.control.controllers.linear import LinearController
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.control.stability.loops import loop_margins

Limits = tuple[float, float]  # Least and largest command, in its unit


@dataclass(frozen=True, kw_only=True)
class PidGains:
    """Gains of the PID controller ``u = (K_p + K_i/s) (r - y) - K_d s/(T_f s + 1) y``.

    u is the command, r the reference and y the reading; `pid` makes a controller from the gains.

    Parameters
    ----------
    proportional : float
        Proportional gain K_p, input unit per output unit.
    integral : float
        Integral gain K_i, input unit per output unit and per second.
    derivative : float
        Derivative gain K_d, input unit times second per output unit.
    filter_time : float
        Time constant T_f of the derivative's filter, s.

    Raises
    ------
    ControlError
        If a value is not finite, the integral gain is 0, the filter time is negative, or a derivative has no filter.
    """

    proportional: float
    integral: float
    derivative: float = 0.0
    filter_time: float = 0.0

    def __post_init__(self) -> None:
        require_fields(self, proportional=finite, integral=finite, derivative=finite, filter_time=finite)
        if self.integral == 0.0:
            raise ControlError("a controller for a drifting actuator needs integral action: integral must not be 0")
        if self.filter_time < 0.0 or (self.derivative != 0.0 and self.filter_time == 0.0):
            raise ControlError(f"a derivative needs a positive filter_time; it is {self.filter_time:g} s")

    @property
    def name(self) -> str:
        """``I``, ``PI`` or ``PID``."""
        return ("P" if self.proportional else "") + "I" + ("D" if self.derivative else "")

    @classmethod
    def of_law(cls, law: Law, sample_time: float) -> PidGains | None:
        """Return the gains of a `law` from `PidGains.law`, None for any other law. `sample_time` in s."""
        if law.c.size not in (1, 2) or law.a[0, 0] != 1.0 or not law.c[0]:
            return None
        step = float(law.b[0, REFERENCE] * law.c[0])
        derivative = filter_time = 0.0
        if law.c.size == 2:
            pole = float(law.a[1, 1])
            if not 0.0 < pole < 1.0:
                return None
            filter_time = pole * sample_time / (1.0 - pole)
            derivative = float(law.c[1]) * (filter_time + sample_time)
        proportional = float(law.d[REFERENCE]) - step
        if abs(proportional) <= 1e-12 * abs(step):  # only rounding remains of the difference
            proportional = 0.0
        if step == 0.0:
            return None
        found = cls(
            proportional=proportional, integral=step / sample_time, derivative=derivative, filter_time=filter_time
        )
        again = found.law(sample_time)
        same = all(
            np.allclose(one, other, rtol=1e-9, atol=0.0)
            for one, other in ((again.a, law.a), (again.d, law.d), (again.b * again.c[:, None], law.b * law.c[:, None]))
        )
        return found if same else None

    def law(self, sample_time: float) -> Law:
        """Return the sampled law, with integral and derivative by backward differences.

        Parameters
        ----------
        sample_time : float
            Sampling time h, s.

        Returns
        -------
        Law
            Law whose first state is the integral part of the command, in the input's unit. With a derivative, the
            second state is the filtered reading, in the output's unit. Laws with different gains have the same state of
            rest, as `ScheduledController` requires.

        Raises
        ------
        ControlError
            If the sampling time is not positive.
        """
        positive(sample_time, "sample_time")
        step = self.integral * sample_time
        pi = Law.of_error([[1.0]], [step], [1.0], self.proportional + step)
        if not self.derivative:
            return pi
        # D(k) = p D(k-1) - g (y(k) - y(k-1)) = g (y_f(k) - y(k)), where y_f(k+1) = p y_f(k) + (1 - p) y(k)
        p = self.filter_time / (self.filter_time + sample_time)
        g = self.derivative / (self.filter_time + sample_time)
        return Law(
            a=np.diag([1.0, p]), b=np.vstack([pi.b, [0.0, 1.0 - p]]), c=np.array([1.0, g]), d=pi.d - np.array([0.0, g])
        )

    def windup(self, sample_time: float) -> np.ndarray:
        """Return the anti-windup gain, for a tracking time of the integral time (one sample for an I controller).

        Parameters
        ----------
        sample_time : float
            Sampling time, s.

        Returns
        -------
        ndarray, shape (n,)
            Back-calculation gain of each state, for `LinearController`.

        Raises
        ------
        ControlError
            If the sampling time is not positive.
        """
        positive(sample_time, "sample_time")
        share = self.integral * sample_time / self.proportional if self.proportional else 1.0
        tracking = min(abs(share), 1.0)
        return np.array([tracking, 0.0] if self.derivative else [tracking])


@taking(linear=linear_model, gains=instance(PidGains), command_limits=pair, closed_loop_time=number)
def pid(linear: LinearModel, gains: PidGains, command_limits: Limits, closed_loop_time: float) -> LinearController:
    """Make an I, PI or PID controller with given gains for the operating point of a model.

    Parameters
    ----------
    linear : LinearModel
        Model of the actuator for which the gains were designed.
    gains : PidGains
        Gains of the controller.
    command_limits : (float, float)
        Least and largest command, in its unit.
    closed_loop_time : float
        Closed-loop time constant for which the gains were designed, s. It is stored in the controller, and does not
        change the gains.

    Returns
    -------
    LinearController
        Controller with the sampling time of the model.

    Raises
    ------
    ControlError
        If the closed loop of controller and model is unstable, or an argument is invalid.
    """
    h = linear.sample_time
    law = gains.law(h)
    if not loop_margins(linear, law).stable[0]:
        raise ControlError(
            f"with a closed-loop time of {closed_loop_time:.3g} s the loop would be unstable on the model itself: "
            "ask for a longer one, or choose another design"
        )
    return with_law(gains.name, linear, command_limits, closed_loop_time, law, gains.windup(h))


def with_law(
    name: str, linear: LinearModel, command_limits: Limits, closed_loop_time: float, law: Law, windup: np.ndarray
) -> LinearController:
    """Make a controller of a law that was designed on a model. Shapes: `windup` (n,)."""
    low, high = command_limits
    return LinearController(
        name=name,
        sample_time=linear.sample_time,
        operating_input=linear.operating_input,
        operating_output=linear.rest_output,
        command_min=float(low),
        command_max=float(high),
        closed_loop_time=float(closed_loop_time),
        law=law,
        windup=windup,
    )
