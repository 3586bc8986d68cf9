"""Controllers from identified models: a sampled PI or PID by lambda tuning."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np

from deatwin.control.arguments import number, pair, positive, taking
from deatwin.control.controllers.linear import LinearController
from deatwin.control.design.pid import PidGains, pid
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.plant.arrays import Array, Complex

_EARLY, _LATE = 1.0 - np.exp(-1.0 / 3.0), 1.0 - np.exp(-1.0)  # Response of a first-order lag at T/3 and at T
_SETTLED = 1e-4  # What the slowest pole leaves at the end of the step response, as a share of the final value
_LONGEST = 200_000  # Largest number of samples of a step response
_DELAY_SHARE = 3.0  # Least ratio of the closed-loop time to the delay; Rivera et al. ask for at least 1.7
_SAMPLES = 10.0
"""Least number of samples in a closed-loop time constant (Åström & Wittenmark, Computer-Controlled Systems, section
4.4: the crossover frequency times the sample time at most 0.05 to 0.14)."""
_BAND_SHARE = 0.5  # Highest crossover, as a share of the band that the recording excited
_FILTER_SHARE = 0.1
"""Time constant of the derivative's filter, as a share of the derivative time (Skogestad, section 2)."""


@dataclass(frozen=True, kw_only=True)
class FirstOrderDelay:
    """A model with one lag and a delay, as lambda tuning needs it: ``gain * exp(-delay s) / (time_constant s + 1)``."""

    gain: float  # Static gain, output unit per input unit
    time_constant: float  # Time constant of the lag, s
    delay: float  # Delay, s


def reduce_to_first_order(linear: LinearModel) -> FirstOrderDelay:
    """Find gain, lag and delay from two points of the step response (Smith, Digital Computer Process Control, 1972)."""
    slowest = float(np.abs(linear.require_in_loop().poles).max(initial=0.0))
    decay = np.log(_SETTLED) / np.log(slowest) if slowest > 0.0 else 0.0
    count = int(min(max(decay, 0.0), _LONGEST)) + linear.numerator.size + linear.denominator.size + 1
    reached = linear.step_response(count) / linear.static_gain
    if reached.max() < _LATE:
        raise ControlError(
            f"the model has not settled to 63 % within {count} samples, the longest response that is computed: sample "
            "more slowly, or leave slow effects out"
        )
    early, late = (_first_time(reached, share) * linear.sample_time for share in (_EARLY, _LATE))
    time_constant = 1.5 * (late - early)
    return FirstOrderDelay(gain=linear.static_gain, time_constant=time_constant, delay=max(late - time_constant, 0.0))


def _first_time(values: np.ndarray, level: float) -> float:
    """Return the time at which a level is first reached, in samples, interpolated between samples."""
    after = int(np.argmax(values >= level))
    if after == 0:
        return 0.0
    return float(after - (values[after] - level) / (values[after] - values[after - 1]))


@taking(linear=linear_model, command_limits=pair, closed_loop_time=number, band_Hz=positive)
def lambda_tuning(
    linear: LinearModel,
    *,
    command_limits: tuple[float, float],
    closed_loop_time: float | None = None,
    band_Hz: float | None = None,
) -> LinearController:
    r"""Tune a sampled PI controller for a desired closed-loop time constant.

    The model is approximated by a gain K, a lag with the time constant T and a delay :math:`\theta`. For a desired
    closed-loop time constant :math:`\lambda`, internal model control gives the integral gain
    :math:`K_i = 1/(K(\lambda + \theta))` and the proportional gain :math:`K_p = T K_i`.

    - :math:`\theta` includes half a sample for the zero-order hold.
    - K is the largest gain of the model at any frequency from 0 Hz to the crossover.
    - If T is shorter than :math:`\lambda`, the controller is purely integral, with
      :math:`K_i = 1/(K(\lambda + \theta + T))`. A proportional part would raise the loop gain at high frequencies,
      where the actuator may have a lightly damped mode that the model lacks.

    Parameters
    ----------
    linear : LinearModel
        Model of the actuator with the delay of the loop (`LinearModel.in_loop`).
    command_limits : (float, float)
        Least and largest command, in its unit.
    closed_loop_time : float, optional
        Closed-loop time constant :math:`\lambda`, s. By default the largest of T, :math:`3\theta`, ten samples and, if
        `band_Hz` is given, the time constant for a crossover at half of `band_Hz`.
    band_Hz : float, optional
        Upper end of the frequency band that the model's recording excited, Hz. It affects only the default of
        `closed_loop_time`.

    Returns
    -------
    LinearController
        Controller with the sampling time of the model.

    Raises
    ------
    ModelError
        If the status of the model is not OK, for example because its operating point is unstable.
    ControlError
        If an argument is invalid, if the model responds to a command in the same sample or needs more than 200000
        samples to reach 63 % of a step, or if the loop would be unstable.

    References
    ----------
    Rivera, Morari & Skogestad, Ind. Eng. Chem. Process Des. Dev. 25 (1986) 252-265, doi:10.1021/i200032a041.

    Examples
    --------
    >>> model = dict(numerator=[0.0, 0.0, 0.2], denominator=[1.0, -0.9], covariance=np.zeros((4, 4)), sample_time=0.1)
    >>> linear = LinearModel(**model, operating_input=1.0, operating_output=2.0)
    >>> lambda_tuning(linear, command_limits=(0.0, 5.0), closed_loop_time=0.5).name
    'PI'
    """
    plant, h = reduce_to_first_order(linear), linear.sample_time
    lag, delay = plant.time_constant, plant.delay + 0.5 * h
    wanted = require_time(closed_loop_time, h) or _default_time(h, lag, delay, band_Hz)
    cancelled = lag if lag >= wanted else 0.0
    horizon = wanted + delay + (lag - cancelled)
    integral = 1.0 / (_largest_gain(linear, horizon) * horizon)
    gains = PidGains(proportional=cancelled * integral, integral=integral)
    return pid(linear, gains, command_limits, wanted)


@taking(linear=linear_model, command_limits=pair, closed_loop_time=number, band_Hz=positive)
def lambda_tuning_pid(
    linear: LinearModel,
    *,
    command_limits: tuple[float, float],
    closed_loop_time: float | None = None,
    band_Hz: float | None = None,
) -> LinearController:
    r"""Tune a sampled PID controller for a desired closed-loop time constant.

    The model is approximated by a gain K, two lags with the time constants :math:`T_1 \geq T_2`, and a delay
    :math:`\theta`. For a desired closed-loop time constant :math:`\lambda`, the controller is
    :math:`K_c (1 + 1/(T_I s)) (1 + T_2 s)` with :math:`K_c = T_1/(K(\lambda + \theta))` and
    :math:`T_I = \min(T_1, 4(\lambda + \theta))`. The derivative acts on the reading alone and is filtered;
    :math:`\theta` includes the time constant of this filter. As in `lambda_tuning`, K is increased if the gain of the
    model between 0 Hz and the crossover exceeds the static gain.

    Parameters
    ----------
    linear : LinearModel
        Model of the actuator with the delay of the loop (`LinearModel.in_loop`). The time constant :math:`T_2` must be
        at least one sampling time.
    command_limits : (float, float)
        Least and largest command, in its unit.
    closed_loop_time : float, optional
        Closed-loop time constant :math:`\lambda`, s. By default the largest of :math:`T_2`, :math:`3\theta`, ten
        samples and, if `band_Hz` is given, the time constant for a crossover at half of `band_Hz`.
    band_Hz : float, optional
        Upper end of the frequency band that the model's recording excited, Hz. It affects only the default of
        `closed_loop_time`.

    Returns
    -------
    LinearController
        Controller with the sampling time of the model.

    Raises
    ------
    ModelError
        If the status of the model is not OK, for example because its operating point is unstable.
    ControlError
        If an argument is invalid, if the model responds to a command in the same sample, if :math:`T_2` is shorter than
        one sampling time, or if the closed loop would be unstable.

    References
    ----------
    Skogestad, J. Process Control 13 (2003) 291-309 (rules for model reduction and PID controller tuning).
    """
    plant, h = reduce_to_second_order(linear), linear.sample_time
    filter_time = max(_FILTER_SHARE * plant.second_lag, h)
    delay = plant.delay + filter_time
    wanted = require_time(closed_loop_time, h) or _default_time(h, plant.second_lag, delay, band_Hz)
    horizon = wanted + delay
    share, peak = plant.gain / linear.static_gain, _largest_gain(linear, horizon) / linear.static_gain
    gain = linear.static_gain * max(share, min(share, 1.0) * peak)  # a lead near a lag raises both share and peak
    integral_time = min(plant.first_lag, 4.0 * horizon)
    series = plant.first_lag / (gain * horizon)
    gains = PidGains(
        proportional=series * (1.0 + plant.second_lag / integral_time),
        integral=series / integral_time,
        derivative=series * plant.second_lag,
        filter_time=filter_time,
    )
    return pid(linear, gains, command_limits, wanted)


def default_closed_loop_time(linear: LinearModel, band_Hz: float | None = None) -> float:
    """Return the closed-loop time that `lambda_tuning` uses by default; the recording excited `band_Hz`."""
    plant, h = reduce_to_first_order(linear), linear.sample_time
    return _default_time(h, plant.time_constant, plant.delay + 0.5 * h, band_Hz)


def require_time(wanted: float | None, sample_time: float) -> float | None:
    """Return a closed-loop time after a check; None if none is given."""
    if wanted is None or (isfinite(wanted) and wanted >= sample_time):
        return wanted
    raise ControlError(
        f"a closed-loop time of {wanted:g} s: it must be finite and at least a sample, {sample_time:g} s"
    )


def _default_time(h: float, lag: float, delay: float, band_Hz: float | None) -> float:
    crossover_time = 0.0 if band_Hz is None else 1.0 / (2 * np.pi * _BAND_SHARE * band_Hz)
    return max(lag, _DELAY_SHARE * delay, _SAMPLES * h, crossover_time)


def _largest_gain(linear: LinearModel, horizon: float) -> float:
    """Return the largest gain at frequencies up to 1/horizon, with the sign of the static gain."""
    frequencies = np.linspace(0.0, min(1.0 / horizon, np.pi / linear.sample_time), 200)
    return float(np.copysign(np.abs(linear.response(frequencies)).max(), linear.static_gain))


_REAL = 0.01
"""Largest ratio of oscillation to decay of a pair of poles that counts as a double lag (damping 1 - 5e-5), because
rounding splits equal lags."""
_CLOSE = 1.6 * (1 - 1e-3)
"""Ratio of a zero's time constant to the next smaller lag below which the two may cancel: 1.6, less rounding."""
_ROUNDS = 20  # Largest number of iterations between the delay and the zeros, which depend on each other


@dataclass(frozen=True, kw_only=True)
class SecondOrderDelay:
    """A model with two lags and a delay: ``gain * exp(-delay s) / ((first_lag s + 1) (second_lag s + 1))``."""

    gain: float
    first_lag: float  # Longer lag, s
    second_lag: float  # Shorter lag, s
    delay: float  # Delay, s, including half a sample for the hold


def reduce_to_second_order(linear: LinearModel) -> SecondOrderDelay:
    """Reduce a model by its real poles and zeros (Skogestad, J. Process Control 13 (2003) 291, 2.1 and 2.2)."""
    h = linear.require_in_loop().sample_time
    lags, leads = _times(linear.poles, h), _times(linear.zeros, h)
    rest = max(linear.mean_delay - lags.sum() + leads.sum(), 0.0)
    delay, share, kept = rest, 1.0, lags
    for _ in range(_ROUNDS):
        share, kept = _without_leads(lags, leads, max(delay, 0.5 * h))
        before, delay = delay, rest + 0.5 * kept[2:3].sum() + kept[3:].sum()
        if abs(delay - before) < 1e-9 * h:
            break
    first, second = (*kept[:2], 0.0, 0.0)[:2]
    second += 0.5 * kept[2:3].sum()
    if second < h:
        poles = ", ".join(f"{pole:.3g}" for pole in np.sort_complex(linear.poles)[::-1])
        raise ControlError(
            f"the model has no second lag of at least one sample, {h:g} s, that a derivative could cancel "
            f"(poles in z: {poles or 'none'}): use a PI controller (lambda_tuning)"
        )
    return SecondOrderDelay(
        gain=linear.static_gain * share,
        first_lag=float(max(first, second)),
        second_lag=float(min(first, second)),
        delay=float(delay),
    )


def _times(roots: Complex, h: float) -> Array:
    """Return the time constants, s, of the real poles or zeros between 0 and 1, longest first."""
    rates = np.log(roots[roots != 0.0].astype(np.complex128))
    real = rates.real[(rates.real < 0.0) & (np.abs(rates.imag) <= _REAL * np.abs(rates.real))]
    return np.asarray(np.sort(-h / real)[::-1])


def _without_leads(lags: Array, leads: Array, delay: float) -> tuple[float, Array]:
    """Cancel each lead against a neighbouring lag; return the gain factor and the remaining lags."""
    kept, factor = [float(lag) for lag in lags], 1.0
    for lead in leads:
        if not kept:
            break
        above, below = [lag for lag in kept if lag >= lead], [lag for lag in kept if lag < lead]
        near = not above or (bool(below) and lead / max(below) < min(min(above) / lead, _CLOSE))
        lag = max(below) if near else min(above)
        kept.remove(lag)
        ratio, left = _smaller_lag(lead, lag, delay) if near else _larger_lag(lead, lag, delay)
        factor *= ratio
        if left > 0.0:
            kept.append(left)
    return factor, np.sort(kept)[::-1]


def _smaller_lag(lead: float, lag: float, delay: float) -> tuple[float, float]:
    """Approximate ``(lead s + 1)/(lag s + 1)`` by a gain if the lead exceeds the lag (rules T1, T1a and T1b)."""
    return max(lead, delay) / max(lag, delay), 0.0


def _larger_lag(lead: float, lag: float, delay: float) -> tuple[float, float]:
    """Approximate a lead and a larger lag by a gain and a lag (rules T2 and T3)."""
    if lead >= 5.0 * delay:
        return lead / lag, 0.0
    bounded = min(lag, 5.0 * delay)
    return bounded / lag, bounded - lead
