"""Reduction of a sampled model to two lags and a delay by the half rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel
from deatwin.plant.arrays import Array, Complex

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
