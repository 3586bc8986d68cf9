"""The free-run residual of an identified model, as a random process that is assumed to continue in closed loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp
from typing import Self

import numpy as np

from deatwin.ident.arguments import real_number
from deatwin.ident.narx.excited import number_of
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.response import lagged_products
from deatwin.plant.arguments import require_fields
from deatwin.plant.arrays import Array, require_generator
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

RMS_KEY, TIME_KEY = "free_run_residual_rms", "free_run_residual_time_s"
"""Keys of a model's provenance for its residual's rms, in the output's unit, and correlation time, s."""
DIVERGED = {"free_run": "diverged"}
"""Entry in the provenance of a model whose free run diverged on the recording from which it was identified."""
_SHORT = 0.1  # share of a recording: longer lags have too few pairs for a reliable covariance
_CHANCE = 1e-3  # probability that noise alone passes for an oscillating residual
_START = 0.05  # share of a recording, at its start, where the free run still depends on the measured start


class DivergedError(ModelError):
    """Raised if the free run of a model diverges before the end of a recording."""


@dataclass(frozen=True, kw_only=True)
class Residual:
    """First-order process (Ornstein-Uhlenbeck) with the rms and correlation time of a free-run residual.

    Parameters
    ----------
    rms : float
        Root mean square of the residual without the sensor's white noise, in the output's unit.
    correlation_time : float
        Time after which the autocorrelation has fallen to 1/e, in s.

    Raises
    ------
    ModelError
        If a value is not finite, the rms is negative, or the correlation time is not positive.
    """

    rms: float
    correlation_time: float

    def __post_init__(self) -> None:
        require_fields(self, rms=real_number, correlation_time=real_number)
        if not (0.0 <= self.rms < np.inf and 0.0 < self.correlation_time < np.inf):
            raise ModelError(
                f"a residual of {self.rms:g} rms that lasts for {self.correlation_time:g} s: the rms must not be "
                "negative and the time be positive, both finite"
            )

    def draw(self, count: int, draws: int, sample_time: float, rng: np.random.Generator) -> Array:
        """Draw stationary realisations of the process, one per column, shape (count, draws), in the output's unit.

        `count` is the number of samples, `draws` that of realisations, `sample_time` is in s, `rng` generates them.
        """
        from scipy.signal import lfilter

        require_generator(rng)
        pole = exp(-sample_time / self.correlation_time)
        shocks = rng.standard_normal((count, draws))
        shocks[1:] *= np.sqrt(1.0 - pole**2)
        return np.asarray(self.rms * lfilter([1.0], [1.0, -pole], shocks, axis=0), dtype=np.float64)

    @property
    def provenance(self) -> dict[str, str]:
        """Rms and correlation time as entries for the provenance of a `NarxModel`."""
        return {RMS_KEY: f"{self.rms:.6g}", TIME_KEY: f"{self.correlation_time:.6g}"}

    @classmethod
    def of_provenance(cls, provenance: Mapping[str, str]) -> Self | None:
        """Read the residual from a model's `provenance`; None if there is none.

        Raises
        ------
        DivergedError
            If the provenance states that the model's free run diverged; a subclass of ModelError.
        ModelError
            If an entry is not a valid number.
        """
        if DIVERGED.items() <= provenance.items():
            raise DivergedError("the model's free run fails on the recording from which it was identified: it diverged")
        rms, time = number_of(provenance, RMS_KEY), number_of(provenance, TIME_KEY)
        return None if rms is None or time is None else cls(rms=rms, correlation_time=time)


def free_run_residual(model: NarxModel, recording: Recording) -> Residual:
    """Measure the rms and correlation time of a model's free-run residual on a recording.

    Parameters
    ----------
    model : NarxModel
        Model with one output.
    recording : Recording
        Recording in the model's units, preferably one that was not used for the fit.

    Raises
    ------
    DivergedError
        If the free run diverges; a subclass of ModelError.

    Notes
    -----
    An oscillating residual is treated as a slowly varying process with the rms and correlation time of its envelope.
    This overestimates the uncertainty of a control loop rather than underestimating it.
    """
    require_model(model)
    run = model.simulate(recording)
    if not run.status.ok:
        raise DivergedError(f"the model's free run fails on the recording: {run.status.value}")
    error = (run.measured - run.outputs)[0]
    error = error[round(_START * error.size) :]
    error = error - error.mean()
    covariance = lagged_products(error) / error.size
    # White sensor noise is in the covariance at lag 0 only.
    first = _first_lag(covariance)
    coloured = max(float(abs(covariance[first]) if first > 1 else covariance[1]), 0.0)
    envelope = np.maximum.accumulate(np.abs(_short(covariance))[::-1])[::-1]  # the largest at each lag or later
    curve = covariance[1:] if first == 1 else envelope
    lags = _falls_to(curve, np.exp(-1.0) * coloured)
    variance = min(coloured * np.exp(first / lags), float(covariance[0]))
    return Residual(rms=float(np.sqrt(variance)), correlation_time=lags * model.sample_time)


def _first_lag(covariance: Array) -> int:
    """Return the lag that determines the size of the coloured part: the first, unless another is certainly larger."""
    from scipy.stats import norm

    sizes = np.abs(_short(covariance))
    # Bartlett: covariances of white noise have the standard deviation c(0) / sqrt(n), and their difference sqrt(2)
    # times that; the largest of many lags is compared with the first.
    error = covariance[0] * np.sqrt(2.0 / covariance.size) * norm.isf(_CHANCE / sizes.size)
    largest = int(np.argmax(sizes))
    return largest + 1 if sizes[largest] > max(covariance[1], 0.0) + error else 1


def _short(covariance: Array) -> Array:
    """Return the covariance from lag 1 on, at lags much shorter than the recording."""
    return covariance[1 : max(round(_SHORT * covariance.size), 2)]


def _falls_to(curve: Array, level: float) -> float:
    """Return after how many samples, with a fraction, a curve first falls below a level, within the curve's length."""
    below = int(np.argmax(np.append(curve < level, True)))
    if below == 0 or below == curve.size:
        return float(max(below, 1))
    return max(below - float((level - curve[below]) / (curve[below - 1] - curve[below])), 1.0)
