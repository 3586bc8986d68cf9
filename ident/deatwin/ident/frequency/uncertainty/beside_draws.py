"""Compare the propagated uncertainty of a frequency response with posterior draws."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from time import process_time

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import FrequencyResponse
from deatwin.ident.frequency.uncertainty.propagate import Propagated, UncertaintyWarning, propagate
from deatwin.ident.frequency.uncertainty.regions import Quantity
from deatwin.ident.frequency.uncertainty.sampling import Sampled, sample
from deatwin.ident.narx import NarxModel
from deatwin.plant.arrays import Array, Complex

DRAWS = 20_000  # Draws of the parameters
SIMULTANEOUS = 0.99  # Probability that all elements at all frequencies lie in the Monte Carlo band
# Nonlinearity up to which propagation must agree with the draws: the covariance is then off by the square of this, 1 %,
# which that many draws cannot distinguish from zero.
STRICT = 0.1
CHUNKS = 40  # Sets of `DRAWS` draws each, with which the error of the linear law is measured
CALLS = 7  # Calls of propagation, of which the fastest counts
_FLAT = 1e-9  # share of the larger variance below which an axis is degenerate
_DIGITS = "₀₁₂₃₄₅₆₇₈"


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """A response with its propagated uncertainty and with draws."""

    case: str
    propagated: Propagated
    sampled: Sampled
    curve: Complex  # shape (n_curve,): Response at more frequencies, to be drawn as a line

    @property
    def symbol(self) -> str:
        """Symbol and order of the response, as plain text."""
        return symbol_of(self.propagated.response)

    @property
    def relative(self) -> Array:
        """Largest standard deviation in any direction of the complex plane, divided by the gain, shape (n,)."""
        longest: Array = np.sqrt(np.linalg.eigvalsh(self.propagated.covariance)[:, -1])
        return longest / self.propagated.gain

    @property
    def whitened(self) -> Array:
        """Covariance of the draws in axes in which the propagated covariance is the unit matrix, shape (n, 2, 2)."""
        return whitened(self.propagated.covariance, self.sampled.covariance)

    @property
    def strict(self) -> NDArray[np.bool_]:
        """True where propagation should agree with the draws to their accuracy, shape (n,)."""
        return np.asarray(self.propagated.nonlinearity <= STRICT)

    @property
    def largest(self) -> float:
        """Largest difference between the two covariances, divided by its Monte Carlo error."""
        error = np.array([[2.0, 1.0], [1.0, 2.0]]) / len(self.sampled.draws)  # of a Wishart matrix of unit mean
        departure = np.abs(self.whitened - np.eye(2)) / np.sqrt(error)
        return float(np.max(departure[self.strict], initial=0.0))

    @property
    def allowed(self) -> float:
        """Limit of `largest` that an exact propagated covariance keeps with probability `SIMULTANEOUS`."""
        return NormalDist().inv_cdf(1 - (1 - SIMULTANEOUS) / (2 * 3 * max(1, int(self.strict.sum()))))

    @property
    def ratio(self) -> float:
        """Draws' variance divided by the propagated one, where and in the direction in which it is farthest from 1."""
        values = np.linalg.eigvalsh(self.whitened).ravel()
        return float(values[np.argmax(np.abs(np.log(values)))])

    @property
    def held(self) -> float:
        """Share of the draws inside the 95 % region, at the frequency where it is farthest from 95 %."""
        shares = self.propagated.contains(self.sampled.draws).mean(axis=0)
        return float(shares[np.argmax(np.abs(shares - 0.95))])


def symbol_of(response: FrequencyResponse) -> str:
    """Symbol and order of a response, as plain text."""
    return f"{response.symbol}{_DIGITS[response.order]}"


def whitened(reference: Array, covariance: Array) -> Array:
    """Return covariances in axes in which the reference is the unit matrix. Shapes: all (n, 2, 2)."""
    sizes, axes = np.linalg.eigh(reference)
    flat = sizes <= _FLAT * sizes[:, 1:]
    root = np.where(flat, 0.0, 1 / np.sqrt(np.where(flat, 1.0, sizes)))
    turned = (axes * root[:, None, :]).swapaxes(1, 2)
    found: Array = turned @ covariance @ turned.swapaxes(1, 2) + flat[:, None, :] * np.eye(2)
    return found


def departure(reference: Array, covariance: Array) -> float:
    """Return the largest relative difference of two covariances over frequency and direction, (n, 2, 2)."""
    return float(np.abs(np.linalg.eigvalsh(whitened(reference, covariance)) - 1).max())


def spread_of(
    case: str, model: NarxModel, quantity: Quantity, rng: np.random.Generator, curve: Complex | None = None
) -> Spread:
    """Propagate the uncertainty, and draw. Shapes: `curve` (n_curve,)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UncertaintyWarning)  # the page reports the status
        propagated = propagate(model, quantity)
    sampled = sample(model, quantity, rng, DRAWS)
    fine = np.empty(0, dtype=np.complex128) if curve is None else curve
    return Spread(case=case, propagated=propagated, sampled=sampled, curve=fine)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep:
    """Propagated and drawn uncertainties for larger and smaller deviations of the parameters."""

    held: Array  # shape (n,): share of the draws in the 95 % region, at the frequency where it is farthest from 95 %
    holds: NDArray[np.bool_]  # shape (n,): True if propagation states that its law holds at all frequencies


@dataclass(frozen=True, kw_only=True)
class Speed:
    """Cost of propagation for one response, and of equally accurate draws."""

    label: str
    propagated: float  # Processor time of propagation, s
    drawn: float  # Processor time of 20,000 draws, computed together, s
    equal: float  # Number of draws as accurate as propagation

    @property
    def ratio(self) -> float:
        """Time of equally accurate draws, computed together, divided by the time of propagation."""
        return self.drawn * self.equal / DRAWS / self.propagated


def columns_of(spreads: Sequence[Spread]) -> dict[str, Array]:
    """Return values, propagated covariances and covariances of the draws, for all responses in sequence."""
    every: dict[str, list[Array]] = {}
    for number, spread in enumerate(spreads, start=1):
        response = spread.propagated
        tones = response.frequency_Hz.reshape(response.values.size, -1)
        of: dict[str, Array] = {
            "response": np.full(len(tones), float(number)),
            "order": np.full(len(tones), float(response.response.order)),
            "output_frequency_Hz": tones.sum(axis=1),
            "real": response.values.real,
            "imaginary": response.values.imag,
            "nonlinearity": response.nonlinearity,
        }
        for name, (i, j) in {"real_real": (0, 0), "real_imaginary": (0, 1), "imaginary_imaginary": (1, 1)}.items():
            of[f"propagated_{name}"] = response.covariance[:, i, j]
            of[f"drawn_{name}"] = spread.sampled.covariance[:, i, j]
        for name, values in of.items():
            every.setdefault(name, []).append(values)
    return {name: np.concatenate(values) for name, values in every.items()}


def sweep_of(
    name: str, model: NarxModel, quantity: Quantity, rng: np.random.Generator, scales: tuple[float, ...]
) -> Sweep:
    """Propagate and draw with the deviations of the parameters scaled."""
    rows = [spread_of(name, replace(model, theta_cov=scale**2 * model.theta_cov), quantity, rng) for scale in scales]
    return Sweep(
        held=np.array([row.held for row in rows]),
        holds=np.array([bool(row.propagated.linear_law.all()) and row.propagated.lost == 0 for row in rows]),
    )


def speed_of(name: str, model: NarxModel, quantity: Quantity, rng: np.random.Generator) -> Speed:
    """Measure the time and the accuracy of propagation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UncertaintyWarning)
        propagated = propagate(model, quantity).covariance
        own = min(_timed(lambda: propagate(model, quantity).covariance) for _ in range(CALLS))
    begun = process_time()
    drawn = np.array([sample(model, quantity, rng, DRAWS).covariance for _ in range(CHUNKS)])
    together = (process_time() - begun) / CHUNKS
    pooled: Array = drawn.mean(axis=0)
    error = departure(pooled, propagated)
    drawn_error = float(np.mean([departure(pooled, one) for one in drawn]))
    least = drawn_error / np.sqrt(CHUNKS)  # departure of all draws pooled
    equal = DRAWS * (drawn_error / np.sqrt(max(error**2 - least**2, least**2))) ** 2
    return Speed(
        label=f"{symbol_of(quantity(model))} of {name}",
        propagated=own,
        drawn=together,
        equal=float(equal),
    )


def _timed(work: Callable[[], object]) -> float:
    """Return the processor time of a call, s."""
    begun = process_time()
    work()
    return process_time() - begun
