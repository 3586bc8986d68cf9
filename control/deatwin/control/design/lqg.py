"""LQG with integral action on the sampled model."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np

from deatwin.control.arguments import number, pair, positive, taking
from deatwin.control.controllers.law import Law
from deatwin.control.controllers.linear import LinearController
from deatwin.control.design.lambda_tuning import default_closed_loop_time, require_time
from deatwin.control.design.pid import Limits, with_law
from deatwin.control.design.states import States, integrating
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.plant.arrays import Array

_REACHED = 1.0 - np.exp(-1.0)  # Share of a step that is reached after one time constant
_LEAST, _STEP = np.log(1e-8), np.log(30.0)
"""Logarithms of the least weight of the command's changes relative to the error, and of the factor between weights in
the search for a bracket."""
_LONGEST = 1e5  # Longest response that is computed, in samples
_DIGITS = 1e-6  # Relative error of the transfer function up to which margins can be trusted
_OBSERVER_SHARE = 0.5
"""Time over which the observer averages if drift and noise are unknown, as a share of the closed-loop time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LqgGains:
    """Gains of a regulator that weights changes of the command, and of an observer for an output that drifts."""

    states: States
    regulator: Array
    observer: Array

    def law(self) -> tuple[Law, Array]:
        """Return the law from reference and reading to command, and the follower gains (n + 2,)."""
        n, gain, m = self.states.b.size, self.states.gain, self.observer
        a, c = _with_drift(self.states)
        forward = float(self.regulator[:n] @ self.states.rest + self.regulator[n])
        # v = u(k-1) - K_x (x - x_s) - K_u (u(k-1) - u_s), where u_s = r - d and x_s = rest * u_s.
        feedback = np.append(self.regulator[:n], forward)
        corrected = np.eye(n + 1) - np.outer(m, c)  # from predicted states to states corrected by the reading
        c_v = np.append(-feedback @ corrected, 1.0 - self.regulator[n])
        d_v = np.array([forward, -feedback @ m])
        applied = np.concatenate([self.states.b, [0.0, 1.0]])
        a_v, b_v = np.zeros((n + 2, n + 2)), np.zeros((n + 2, 2))
        a_v[: n + 1, : n + 1], b_v[: n + 1, 1] = a @ corrected, a @ m
        law = Law(a=a_v + np.outer(applied, c_v), b=(b_v + np.outer(applied, d_v)) / gain, c=c_v, d=d_v / gain)
        return integrating(law), applied  # exact integration, which rounding has disturbed


@taking(linear=linear_model, command_limits=pair, closed_loop_time=number, noise=number, drift=number, band_Hz=positive)
def lqg(
    linear: LinearModel,
    *,
    command_limits: Limits,
    closed_loop_time: float | None = None,
    noise: float = 1.0,
    drift: float | None = None,
    band_Hz: float | None = None,
) -> LinearController:
    r"""Design a sampled LQG controller with integral action.

    The regulator minimises :math:`\sum [(y - r)^2 + \rho \, (\Delta u)^2]` for the reading y, the reference r and the
    change :math:`\Delta u` of the command from sample to sample. The weight :math:`\rho` is chosen so that the reading
    has reached 63 % of a reference step when one closed-loop time plus the model's delay has passed.

    The observer is the stationary Kalman filter of the model for three disturbances: white noise on the reading, a
    random walk of the output (drift), and white noise on the command. The noise on the command, times the static gain,
    has the standard deviation of one step of the random walk. Because the observer estimates the drift, the loop has no
    error at rest.

    Parameters
    ----------
    linear : LinearModel
        Model of the actuator with the delay of the loop (`LinearModel.in_loop`).
    command_limits : (float, float)
        Least and largest command, in its unit.
    closed_loop_time : float, optional
        Closed-loop time constant, s. The default is computed as in `lambda_tuning`, from the lag and delay of the
        model, the sampling time and `band_Hz`.
    noise : float
        Standard deviation of the reading's noise, in the output's unit. Only the ratio of `noise` to `drift` matters.
        If `drift` is omitted, `noise` has no influence.
    drift : float, optional
        Standard deviation of the change of the random walk in one second, in the output's unit. The default makes
        the observer average the noise over half the closed-loop time.
    band_Hz : float, optional
        Upper end of the frequency band that the model's recording excited, Hz. It affects only the default of
        `closed_loop_time`.

    Returns
    -------
    LinearController
        Controller with the sampling time of the model and two degrees of freedom. The observer uses the limited
        command.

    Raises
    ------
    ModelError
        If the status of the model is not OK, for example because its operating point is unstable.
    ControlError
        If an argument is invalid, if the model responds to a command in the same sample, if the closed-loop time cannot
        be reached (the message gives one that can), or if it is so long that rounding errors spoil the controller.

    References
    ----------
    K. J. Åström and B. Wittenmark, Computer-Controlled Systems (3rd ed. 1997), chapter 11. G. Pannocchia and J. B.
    Rawlings, "Disturbance models for offset-free model-predictive control", AIChE J. 49 (2003) 426-437: why an
    observer that estimates the drift leaves no error at rest.
    """
    h = linear.sample_time
    wanted = require_time(closed_loop_time, h) or default_closed_loop_time(linear, band_Hz)
    moved = noise * np.sqrt(h) / (_OBSERVER_SHARE * wanted) if drift is None else drift
    if not (isfinite(noise) and isfinite(moved) and min(noise, moved) > 0.0):
        raise ControlError(f"noise ({noise:g}) and drift ({moved:g}) must be positive and finite")
    law, windup = lqg_gains(linear, wanted, float(moved * np.sqrt(h) / noise)).law()
    if law.lost_digits(h) > _DIGITS:
        raise ControlError(
            f"a closed-loop time of {wanted:.3g} s is {wanted / h:.0f} samples: the controller's slow poles lie so "
            "close together that its transfer function loses its digits; sample more slowly, or ask for a shorter time"
        )
    return with_law("LQG", linear, command_limits, wanted, law, windup)


def lqg_gains(linear: LinearModel, closed_loop_time: float, drift_by_noise: float) -> LqgGains:
    """Return both gains of an LQG controller; `drift_by_noise` is the drift per sample divided by the noise."""
    states = States.of(linear)
    if linear.realisation is not None:  # most of a plant's states are redundant; eight digits remain
        states = states.balanced()
    return LqgGains(
        states=states,
        regulator=_regulator(states, closed_loop_time / linear.sample_time, linear.sample_time),
        observer=_observer(states, drift_by_noise),
    )


def _in_steps(states: States) -> tuple[Array, Array]:
    """Return the model with the last command as an additional state; its input is the change of the command."""
    a = np.block([[states.a, states.b[:, None]], [np.zeros((1, states.b.size)), np.ones((1, 1))]])
    return a, np.append(states.b, 1.0)


def _with_drift(states: States) -> tuple[Array, Array]:
    """Return the model with a random walk added to its output."""
    n = states.b.size
    a = np.eye(n + 1)
    a[:n, :n] = states.a
    return a, np.append(states.c, 1.0)


def _regulator(states: States, samples: float, sample_time: float) -> Array:
    """Return the gain whose closed loop reaches 63 % of a step in a given number of samples."""
    from scipy.optimize import brentq

    def excess(logarithm: float) -> float:
        return _rise(states, _regulator_of(states, float(np.exp(logarithm))), limit=4.0 * samples) - samples

    low = high = 2.0 * np.log(samples)  # the value for an actuator that responds at once
    while excess(high) < 0.0:
        high += _STEP
    while excess(low) > 0.0:
        low -= _STEP
        if low < _LEAST:
            fastest = _rise(states, _regulator_of(states, float(np.exp(low))), limit=_LONGEST) * sample_time
            raise ControlError(
                f"a closed-loop time of {samples * sample_time:.4g} s cannot be reached: the model allows "
                f"{fastest:.4g} s at least"
            )
    return _regulator_of(states, float(np.exp(brentq(excess, low, high, xtol=1e-6))))


def _regulator_of(states: States, weight: float) -> Array:
    """Return the linear quadratic gain for a given weight on changes of the command."""
    from scipy.linalg import solve_discrete_are

    a, b = _in_steps(states)
    seen = np.append(states.c, 0.0)
    p = solve_discrete_are(a, b[:, None], np.outer(seen, seen), np.array([[weight]]))
    return np.asarray((b @ p @ a) / (weight + b @ p @ b))


def _rise(states: States, regulator: Array, limit: float) -> float:
    """Return the number of samples after the delay until the response to a step reaches 63 %, or the limit."""
    a, b = _in_steps(states)
    closed = a - np.outer(b, regulator)
    gap = -np.append(states.rest, 1.0)  # distance from the target
    before = 0.0
    for k in range(1, int(limit) + states.delay + 2):
        gap = closed @ gap
        reached = 1.0 + float(states.c @ gap[:-1])
        if reached >= _REACHED:
            return k - (reached - _REACHED) / (reached - before) - (states.delay - 1)
        before = reached
    return limit


def _observer(states: States, drift: float) -> Array:
    """Return the stationary Kalman gain in filter form, for a reading with unit noise."""
    from scipy.linalg import solve_discrete_are

    a, c = _with_drift(states)
    pushed = np.append(states.b, 0.0)
    moves = np.diag(np.eye(1, c.size, c.size - 1)[0])
    p = solve_discrete_are(a.T, c[:, None], drift**2 * (np.outer(pushed, pushed) + moves), np.ones((1, 1)))
    return np.asarray(p @ c / (1.0 + c @ p @ c))
