"""Find an unstable pole of a model or of recordings alone, with its uncertainty, and the predictions that it allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.long_arx import FOR_EACH, RESOLVED, first_samples
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.response import Fit
from deatwin.plant.arrays import Array
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Recording

_LAGS = 50
"""Most lags; Akaike's criterion chooses how many are needed. Sensor noise on a fast-sampled plant needs forty."""
_WIDE = 1.96  # Standard deviations on either side within which 95 % of a normal law lie
# Growth per sample that no sensible loop holds: the sensitivity of a loop one sample late is at least as large (Seron,
# Braslavsky & Goodwin, "Fundamental Limitations in Filtering and Control", Springer 1997, section 3.3).
_FASTEST = 2.0
_RARELY_LESS = 0.063  # Standard deviations on either side within which 5 % of a normal law lie


@dataclass(frozen=True, kw_only=True)
class RecordedPole:
    """Largest pole of a long ARX model, with the standard deviation of its magnitude. Outside the unit circle it is the
    plant's, even in a loop, if the controller sees no disturbance before the output shows it (Ljung, 1999, section
    13.4)."""

    pole: complex
    deviation: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the magnitude."""
        half = _WIDE * self.deviation
        return abs(self.pole) - half, abs(self.pole) + half


def recorded_pole(recordings: Sequence[Recording], first_lag: int = 1) -> RecordedPole | None:
    """Return the largest pole of recordings, inputs acting from `first_lag` on; None if it cannot be the plant's."""
    signals = _scaled(recordings)
    n_inputs, n_outputs = len(signals[0][0]), len(signals[0][1])
    n_samples, width = sum(outputs.shape[1] for _, outputs in signals), n_inputs + n_outputs
    most = min(_LAGS, (n_samples // FOR_EACH - 1) // (width + len(signals)))
    signals = [one for one in signals if one[1].shape[1] > most]
    if most < 1 or not signals:
        return None
    head = 1 if first_lag else 1 + n_inputs
    columns = np.concatenate([_columns(*one, most, first_lag) for one in signals], axis=1)
    n = columns.shape[1]
    triangle = np.asarray(np.linalg.qr(columns.T, mode="r"), dtype=np.float64)
    tail = triangle[:, -n_outputs:]
    floor = n * RESOLVED**2 * np.eye(n_outputs)
    left = [tail[k:].T @ tail[k:] + floor for k in range(head, head + most * width + 1, width)]  # with 0, 1, ... lags
    costs = [
        n * np.linalg.slogdet(squares / n)[1] + 2.0 * n_outputs * width * lags for lags, squares in enumerate(left)
    ]
    lags = int(np.argmin(costs))
    if lags == 0:  # the outputs have no dynamics
        return RecordedPole(pole=0.0, deviation=0.0)
    size = head + lags * width
    inverse = np.linalg.pinv(triangle[:size, :size], rcond=1e-10)
    own = head + (np.arange(lags)[:, None] * width + np.arange(n_outputs)).ravel()
    theta, covariance = (inverse @ tail[:size])[own], (inverse @ inverse.T)[np.ix_(own, own)]
    found, drive = _largest(theta, covariance, left[lags] / (n - size))
    return None if _would_have_grown(found, drive, signals) else found


def _scaled(recordings: Sequence[Recording]) -> list[tuple[Array, Array]]:
    """Return moving inputs and all outputs of the first samples, without means and in standard deviations."""
    beginnings = first_samples(recordings)
    signals = []
    for kind in ("inputs", "outputs"):
        parts = [getattr(record, kind) for record in beginnings]
        together = np.concatenate(parts, axis=1)
        spread, moving = together.std(axis=1), np.ptp(together, axis=1) > 0.0
        kept = moving if kind == "inputs" else np.ones_like(moving)
        scale = np.where(moving, spread, 1.0)[kept, None]
        signals.append([(part[kept] - together.mean(axis=1)[kept, None]) / scale for part in parts])
    return list(zip(*signals, strict=True))


def _columns(inputs: Array, outputs: Array, most: int, first_lag: int) -> Array:
    """Return constant, inputs at lag 0 if they count, both signals at each lag, and the target; shape (n_columns, n)."""
    n = outputs.shape[1]
    lagged = [signal[:, most - lag : n - lag] for lag in range(1, most + 1) for signal in (outputs, inputs)]
    at_once = [] if first_lag else [inputs[:, most:]]
    return np.concatenate([np.ones((1, n - most)), *at_once, *lagged, outputs[:, most:]])


def _would_have_grown(found: RecordedPole, drive: Array, signals: Sequence[tuple[Array, Array]]) -> bool:
    """Return whether the mode, left alone, would have left the span of the outputs. Shapes: `drive` (n_outputs,)."""
    rate = float(np.log(max(found.interval[0], 1.0)))
    if rate == 0.0 or rate > np.log(_FASTEST):
        return rate > 0.0
    for inputs, outputs in signals:
        moved = np.flatnonzero(np.any(np.diff(inputs, axis=1) != 0.0, axis=0)) + 1
        lasted = max(end - begin for begin, end in pairwise([0, *moved.tolist(), outputs.shape[1]]))
        growth = lasted * rate - 0.5 * np.log(np.expm1(2.0 * rate))  # of the root of the sum of squares
        span = np.ptp(outputs, axis=1)
        if np.any(np.log(np.maximum(_RARELY_LESS * drive, np.finfo(float).tiny)) + growth > np.log(span + RESOLVED)):
            return True
    return False


def _largest(theta: Array, covariance: Array, noise: Array) -> tuple[RecordedPole, Array]:
    """Return the companion matrix' largest eigenvalue, its standard deviation, and the drive of its mode by output."""
    from scipy.linalg import eig

    n_outputs = theta.shape[1]
    companion = np.eye(theta.shape[0], k=-n_outputs)
    companion[:n_outputs] = theta.T
    values, left, right = eig(companion, left=True, right=True)
    which = int(np.argmax(np.abs(values)))
    value, row, column = values[which], left[:, which].conj(), right[:, which]
    turn = np.conj(value) / max(abs(value), np.finfo(float).tiny)
    slopes = np.real(turn * np.outer(row[:n_outputs], column) / (row @ column))
    variance = float(np.einsum("ij,ab,ia,jb->", noise, covariance, slopes, slopes))
    driven = np.sqrt(np.real(row[:n_outputs] @ noise @ row[:n_outputs].conj())) / abs(row @ column)
    drive = np.asarray(driven * np.abs(column[:n_outputs]), dtype=np.float64)
    return RecordedPole(pole=complex(value), deviation=max(variance, 0.0) ** 0.5), drive


_STEP = 1e-4  # step as a share of the output's range, which keeps half of the digits for polynomials of low degree
_ROUNDING = 1e-7  # accuracy of a double pole at 1: half of the digits, less a few for the companion matrix
_SURE = 2.0  # standard deviations by which a pole must lie outside: 98 % on that side
_WORTH_SAYING = 0.01  # difference of two poles that is reported, as a share of the rate of growth
_SURER = 3.1  # standard deviations if nothing else speaks for an unstable pole: one false alarm in a thousand


@dataclass(frozen=True, kw_only=True, eq=False)
class Unstable:
    """Unstable pole of a model, and the fit of the model's predictions several steps ahead.

    Parameters
    ----------
    pole : complex
        Pole z of largest magnitude of the model linearised at the mean of the recordings.
    sample_time : float
        Time between two samples in s.
    steps : int
        Number of samples in which the unstable mode grows by a factor of e, but no more than the recordings allow.
    ahead : Fit
        Fit of the predictions ``steps`` samples ahead.
    recorded_pole : complex or None
        Pole z of largest magnitude of a high-order ARX model of the recordings; None if the recordings are too short
        for such a model. Noise does not bias this pole.
    interval : tuple of float, or None
        95 % interval of the magnitude of `recorded_pole`. For recordings from a control loop, the interval is valid if
        the controller does not respond to a disturbance before the disturbance appears in the output.
    """

    pole: complex
    sample_time: float
    steps: int
    ahead: Fit
    recorded_pole: complex | None = None
    interval: tuple[float, float] | None = None

    @property
    def rate(self) -> complex:
        """Continuous-time pole ln(z) / sample time: real part in 1/s, imaginary part in rad/s."""
        return complex(np.log(self.pole) / self.sample_time)

    def sentences(self, units: Sequence[str]) -> list[str]:
        """Return sentences on the pole and on the prediction error; `units` are the units of the outputs."""
        ahead = ", ".join(
            f"{with_unit(rms, unit)} rms (fit {percent:.4g} %)"
            for rms, percent, unit in zip(self.ahead.rms, self.ahead.percent, units, strict=True)
        )
        useless = (
            ", no better than the mean of the output: the pole is biased, or terms are missing; with a model of the noise "
            "(Armax, Narmax) the pole is not biased"
        )
        return [
            f"the model's unstable pole: {_written(self.pole, self.sample_time)}{self._recorded}",
            f"{self.steps} steps ahead, the time in which a deviation grows by a factor of e, the error of the prediction "
            f"is {ahead}"
            f"{useless if np.any(self.ahead.percent <= 0.0) else ''}",
        ]

    @property
    def _recorded(self) -> str:
        """Return what the recordings alone say about the pole."""
        if self.recorded_pole is None or self.interval is None:
            return ""
        low, high = self.interval
        told = f"; a linear model (ARX) of high order, which noise does not bias, has a pole at {_sized(self.recorded_pole, self.interval)}"
        if high < 1.0:
            return f"{told}: the plant is stable there, and the NARX model is wrong"
        told += f", {_rate(self.recorded_pole, self.sample_time)}"
        if low <= 1.0:
            return f"{told}; the recordings cannot distinguish this pole from a stable one"
        rates = np.log([abs(self.pole), abs(self.recorded_pole)])
        apart = abs(rates[0] - rates[1]) > _WORTH_SAYING * rates[1] and not low <= abs(self.pole) <= high
        return f"{told}; trust this pole" if apart else told


Recorded = Callable[[], RecordedPole | None]


def recorded_once(model: NarxModel, recordings: Sequence[Recording]) -> Recorded:
    """Return a function that computes the recordings' pole when it is first needed, and caches it."""
    lags = [v.lag for term in model.terms for v, _ in term.factors if v.kind == "u"]
    return cache(partial(recorded_pole, recordings, 0 if 0 in lags else 1))


def stable_model_of_unstable(model: NarxModel, recordings: Sequence[Recording], recorded: Recorded) -> str:
    """Return a sentence if recordings certainly have an unstable pole but the model's free run is bounded."""
    return "" if np.any(np.abs(poles_at(model, recordings)) > 1.0) else unstable_pole_lacked(recorded(), recordings)


def unstable_pole_lacked(found: RecordedPole | None, recordings: Sequence[Recording]) -> str:
    """Return a sentence if recordings certainly have an unstable pole and the model has none."""
    if found is None or not _surely_outside(found, recordings):
        return ""
    return (
        f"a linear model (ARX) of high order has an unstable pole, {_sized(found.pole, found.interval)}, "
        f"{_rate(found.pole, recordings[0].sample_time)}, which this model lacks: the plant is unstable, and "
        "the recording was made in a closed loop; no fit of the free run can find this pole, but a fit one step ahead can, "
        "best with a model of the noise (Armax, Narmax)"
    )


def _surely_outside(found: RecordedPole, recordings: Sequence[Recording]) -> bool:
    """Return whether recordings certainly have an unstable pole that grows by e within the longest of them."""
    longest = max(record.n_samples for record in recordings)
    return abs(found.pole) - max(_SURER * found.deviation, 1.0 / longest) > 1.0


def _written(pole: complex, sample_time: float) -> str:
    """Write a pole in discrete and continuous time."""
    sign = f"z = {pole.real:.4g}" if not pole.imag else f"|z| = {abs(pole):.4g}"
    return f"{sign}, {_rate(pole, sample_time)}"


def _rate(pole: complex, sample_time: float) -> str:
    """Write a pole in continuous time."""
    rate = complex(np.log(pole) / sample_time)
    return f"{rate.real:+.3g} 1/s" + (f", {abs(rate.imag):.3g} rad/s" if pole.imag else "")


def _sized(pole: complex, interval: tuple[float, float]) -> str:
    """Write the magnitude of a pole with its interval, with one digit more than the interval's width."""
    digits = int(np.clip(1 - np.floor(np.log10(max(interval[1] - interval[0], 1e-12))), 2, 8))
    return f"|z| = {abs(pole):.{digits}f} (95 % interval {interval[0]:.{digits}f} to {interval[1]:.{digits}f})"


def unstable_model(
    model: NarxModel, recordings: Sequence[Recording], recorded: Recorded, *, diverged: bool
) -> Unstable | None:
    """Return a model's unstable pole at the recordings' mean, or None if in doubt, as of a limit cycle."""
    poles = poles_at(model, recordings)
    if (
        not poles.size
        or abs(poles[0]) <= 1.0 + _ROUNDING
        or abs(poles[0]) - _SURE * _deviation(model, recordings) <= 1.0
    ):
        return None
    nonlinear = bool(model.table.functions) or any(term.degree > 1 for term in model.terms)
    found = recorded()
    if nonlinear and not diverged and (found is None or not _surely_outside(found, recordings)):
        return None
    growing = round(1.0 / float(np.log(abs(poles[0]))))
    room = min(record.n_samples for record in recordings) - model.table.max_lag
    steps = int(np.clip(growing, 2, max(2, room // 2)))
    ahead = Fit.of([model.predict(record, steps=steps) for record in recordings])
    if not np.all(np.isfinite(ahead.mean_square)):  # lost within one growth by e, which no pole explains
        return None
    return Unstable(
        pole=complex(poles[0]),
        sample_time=model.sample_time,
        steps=steps,
        ahead=ahead,
        recorded_pole=None if found is None else found.pole,
        interval=None if found is None else found.interval,
    )


def poles_at(model: NarxModel, recordings: Sequence[Recording]) -> NDArray[np.complex128]:
    """Return the poles of a model that is linearised at the mean of recordings, largest magnitude first."""
    longest = max((v.reach for term in model.terms for v, _ in term.factors if v.kind == "y"), default=0)
    lags = sorted({lag for v in model.table.variables if v.kind == "y" for lag in (v.lag, v.reach)})
    m = model.n_outputs
    companion = np.eye(m * longest, k=-m)
    level, inputs, moved = _point(model, recordings)
    for lag in lags:
        for row in range(m):
            found = []
            for sign in (1.0, -1.0):
                outputs = np.tile(level[:, None], inputs.shape[1])
                outputs[row, -1 - lag] += sign * moved[row]
                rest = replace(recordings[0], inputs=inputs, outputs=outputs, extras={}, extra_units={})
                found.append(model.predict(rest).outputs[:, -1])
            companion[:m, (lag - 1) * m + row] = (found[0] - found[1]) / (2.0 * moved[row])
    poles = np.linalg.eigvals(companion) if longest else np.empty(0)
    return np.asarray(poles[np.argsort(-np.abs(poles))], dtype=np.complex128)


def _point(model: NarxModel, recordings: Sequence[Recording]) -> tuple[Array, Array, Array]:
    """Return mean outputs, constant mean inputs over the samples of one prediction, and the step of each output."""
    outputs = np.concatenate([record.outputs for record in recordings], axis=1)
    inputs = np.concatenate([record.inputs for record in recordings], axis=1).mean(axis=1)
    span = np.ptp(outputs, axis=1)
    steps = _STEP * np.where(span > 0, span, 1.0)
    return outputs.mean(axis=1), np.tile(inputs[:, None], model.table.max_lag + 1), steps


def _deviation(model: NarxModel, recordings: Sequence[Recording]) -> float:
    """Return the standard deviation of the largest pole's magnitude, by differences along the parameters."""
    size = float(abs(poles_at(model, recordings)[0]))
    spread: Array = np.sqrt(np.maximum(np.asarray(model.theta_cov).diagonal(), 0.0))
    slopes = np.zeros(spread.size)
    for i in np.flatnonzero(spread):
        theta = model.theta.copy()
        theta[i] += 0.01 * spread[i]
        moved = float(abs(poles_at(replace(model, theta=theta), recordings)[0]))
        slopes[i] = (moved - size) / (0.01 * spread[i])
    return float(max(float(slopes @ model.theta_cov @ slopes), 0.0) ** 0.5)
