"""Prior knowledge: parameters, strengths of effects, and the size of the plant's model error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deatwin.ident.mismatch.likelihood import structured
from deatwin.ident.mismatch.likelihood.model import Process
from deatwin.ident.mismatch.thresholds import DEVIATIONS
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Parameter, Scale

DATA_SHEET = 0.3
"""Relative standard deviation of a plant's parameter about its nominal value: typical error of elastomers' data
sheets."""
WRONG = 0.05
"""Probability that a nominal value is simply wrong, so that the parameter may lie anywhere in its range (a contaminated
prior: Berger and Berliner, Ann. Statist. 14 (1986) 461, doi:10.1214/aos/1176349933)."""
AMPLITUDE, RATE = 2.0, 1.0
"""Half widths of the priors of an effect's strength, in typical strengths, and of the logarithm of its time constants:
with a probability of one half they are within a factor of e."""
FAST, FAST_TIMES = 0.4, (5.0, 50.0)
"""Rms of the fast part of the model error, as a share of the rig's, and its time constants in samples, since sample
times are chosen for the motion."""
TIMING = 0.15
"""Prior standard deviation of the time at which the command acts or a further reading is taken, in samples."""
LATEST = DEVIATIONS * TIMING
"""Largest timing error of a rig, in samples, half width of its 95 % interval: a rig that answers later lacks an effect."""
SLOW, SLOW_TIME, SLOW_MODES = 0.3, 3000.0, 4
"""Rms of the slow part of the model error, as a share of the rig's, its time constant in samples, and the number of its
modes that are kept in each recording."""
SPREAD, NOISE = 0.7, 0.1
"""Prior standard deviations of the logarithm of the fast error's rms, a factor of two either way, and of that of the
noise."""
LEAST_ERROR = 0.05
"""Smallest model error of a rig that states none, as a share of the noise."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnError:
    """Model error of a plant in one reading, divided by the noise's relative level, as residuals are.

    The part that does not repeat is stationary after that division: the plant errs fast where it moves most, and
    motion-dependent noise is largest there.
    """

    readings: np.ndarray  # (n,), simulated readings, SI
    late: np.ndarray  # (n,), their change if the command acts, or the reading is taken, `TIMING` samples later, SI
    times: np.ndarray  # (n,), s
    records: np.ndarray  # (n,), number of the experiment
    sample_time: float
    noise: float  # SI
    stated: float  # rms model error that the rig states, SI
    level: np.ndarray | float = 1.0  # (n,)

    @property
    def rms(self) -> float:
        """Expected rms error, SI."""
        return max(self.stated, LEAST_ERROR * self.noise)

    @cached_property
    def columns(self) -> np.ndarray:
        """Return columns for the repeatable error (bends, timing, slow modes), shape (n, k), at the expected size."""
        columns = np.column_stack(
            [
                structured.bends(self.readings, self.rms),
                self.late,
                structured.slow(self.times, self.records, SLOW * self.rms, SLOW_TIME * self.sample_time, SLOW_MODES),
            ]
        )
        return columns / np.reshape(self.level, (-1, 1))

    @property
    def of_timing(self) -> np.ndarray:
        """Return which column is the timing, bool of shape (k,)."""
        count = self.columns.shape[1]
        return np.arange(count) == count - 1 - SLOW_MODES * np.unique(self.records).size

    @property
    def process(self) -> Process:
        """Return the process of the error that does not repeat, with variance 1."""
        return Process(weights=(0.5, 0.5), times=tuple(time * self.sample_time for time in FAST_TIMES))

    @property
    def ratio(self) -> float:
        """Rms of the error that does not repeat, divided by that of the noise."""
        return FAST * self.rms / self.noise


def deviation(parameter: Parameter) -> float:
    """Deviation of a plant's own parameter from its nominal value, in the coordinate of its scale."""
    if parameter.guessed:
        return _width(parameter)
    if parameter.scale is Scale.LOGARITHMIC:
        return DATA_SHEET
    return DATA_SHEET * abs(parameter.scale.to_coordinate(parameter.value)) or _width(parameter)


def departure(parameter: Parameter, nominal: Parameter) -> float:
    """Return how far a plant's parameter is from its nominal value, in standard deviations; 0 if that is guessed."""
    if nominal.guessed:
        return 0.0
    off = nominal.scale.to_coordinate(parameter.value) - nominal.scale.to_coordinate(nominal.value)
    return off / deviation(nominal)


def nominal_odds(parameter: Parameter, nominal: Parameter) -> float:
    """Return the log prior density of a plant's parameter relative to that of its nominal value; 0 or less."""
    usual, anywhere = _densities(parameter, nominal)
    return float(np.log((usual + anywhere) / (1.0 - WRONG + anywhere)))


def is_wrong(parameter: Parameter, nominal: Parameter) -> bool:
    """Return whether a nominal value is more probably wrong than only inaccurate, given a plant's parameter."""
    usual, anywhere = _densities(parameter, nominal)
    return anywhere > usual


def _densities(parameter: Parameter, nominal: Parameter) -> tuple[float, float]:
    """Return the prior densities of a parameter, about its nominal value and anywhere, over the peak of the first law."""
    anywhere = WRONG * deviation(nominal) * np.sqrt(2.0 * np.pi / 12.0) / _width(nominal)
    return float((1.0 - WRONG) * np.exp(-0.5 * departure(parameter, nominal) ** 2)), float(anywhere)


@dataclass(frozen=True, kw_only=True)
class Coordinate:
    """Prior of a parameter's coordinate: normal, or half a normal law if the parameter cannot be negative."""

    mean: float
    deviation: float
    one_sided: bool = False
    log_factor: float = 0.0  # of a density that this normal law, times e to this power, touches at the fitted value


def coordinate(parameter: Parameter, nominal: Plant, effects: Mapping[str, Effect], reading: float) -> Coordinate:
    """Return the prior of a plant's parameter or, by its name, of an effect's; `reading` is the largest reading, SI."""
    # A parameter that only another variant of the plant has is known as well as any other.
    if parameter.name in nominal.parameters:
        known = nominal.parameters[parameter.name]
        return Coordinate(mean=known.scale.to_coordinate(known.value), deviation=deviation(known))
    name, _, own = parameter.name.partition(".")
    if name not in effects:
        return Coordinate(mean=parameter.scale.to_coordinate(parameter.value), deviation=deviation(parameter))
    effect = effects[name]
    if own not in {p.name for p in effect.describe()}:  # start of a memory, anywhere in its range if unknown
        return Coordinate(mean=0.0, deviation=_width(parameter))
    typical = effect.described(own)
    if own == effect.strength:
        width, factor = touching(strength_deviation(effect), parameter.value)
        return Coordinate(mean=0.0, deviation=width, one_sided=typical.lower >= 0.0, log_factor=factor)
    if typical.scale is Scale.LOGARITHMIC:
        mean = typical.scale.to_coordinate(typical.value)
        width, factor = touching(RATE, typical.scale.to_coordinate(parameter.value) - mean)
        return Coordinate(mean=mean, deviation=width, log_factor=factor)
    if typical.unit == "rad":  # any phase is as likely: at its centre this normal law has the density 1/(2 pi)
        return Coordinate(mean=parameter.value, deviation=float(np.sqrt(2.0 * np.pi)))
    # in the upper half of the range that is reached; otherwise hardly anything would be seen of it
    if own == effect.threshold:
        high = typical.value / 0.75 if typical.unit == "V" else min(typical.upper, reading)
        return Coordinate(mean=0.75 * high, deviation=0.25 * high)
    return Coordinate(mean=typical.value, deviation=min(_width(typical), max(abs(typical.value), 1.0)))


def touching(width: float, value: float) -> tuple[float, float]:
    """Return deviation and log factor of the normal law that touches a Cauchy law of this width at a value."""
    # Strengths and times on another rig may differ by orders of magnitude from typical ones, and a normal prior would
    # pull them by more than the recordings say. A Cauchy law does not (Gelman, Bayesian Anal. 1 (2006) 515,
    # doi:10.1214/06-BA117A). Its logarithm is convex in the square of the value, so the scaled normal law is nowhere
    # above it, and evidence that is computed with the normal law is a lower bound.
    deviation = float(np.hypot(width, value)) / np.sqrt(2.0)
    factor = np.log(width / deviation) + 0.5 * (value / deviation) ** 2 - 0.5 * np.log(2.0 * np.pi)
    return float(deviation), float(factor)


def strength_deviation(effect: Effect) -> float:
    """Return the half width of the prior of an effect's strength, in its unit; a share is at most 1."""
    typical = effect.described(effect.strength)
    return 1.0 if typical.unit == "1" and abs(typical.value) == 1.0 else AMPLITUDE * abs(typical.value)


def _width(parameter: Parameter) -> float:
    """Return the standard deviation of a uniform law over a parameter's range; 1 if the range is unbounded."""
    low, high = parameter.ends
    return float((high - low) / np.sqrt(12.0)) if np.isfinite([low, high]).all() else 1.0


def pair_odds(catalogue: int) -> float:
    """Return the prior log odds of one pair over one single effect, if all sets of each size are equally likely."""
    pairs = max(catalogue * (catalogue - 1) / 2, 1.0)
    return float(np.log(PRIORS[2] / pairs) - np.log(PRIORS[1] / max(catalogue, 1)))


PRIORS: Mapping[int, float] = {0: 1 / 2, 1: 3 / 8, 2: 1 / 10, 3: 1 / 40}
"""Prior probability of each number of effects."""
