"""Compare the propagated uncertainty of a frequency response with posterior draws."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from operator import attrgetter
from statistics import NormalDist
from time import process_time
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import probability, read_only, whole_number
from deatwin.ident.frequency.response import Band, FrequencyResponse
from deatwin.ident.frequency.uncertainty.propagate import Propagated, UncertaintyWarning, propagate
from deatwin.ident.frequency.uncertainty.regions import (
    Quantity,
    Uncertain,
    draw_theta,
    evaluate,
    plot_draws,
    response_of,
)
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.arrays import Array, Complex, require_generator
from deatwin.plant.datasets import Metadata, attribute, variable
from deatwin.plant.drawing import Axes
from deatwin.plant.errors import ModelError

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


_MOST_BYTES = 1 << 31  # of complex draws


class SampleStatus(Enum):
    """Status of a sampled frequency response: whether draws had to be left out.

    The value of each member is a message for the user.
    """

    OK = "all draws have the operating point, with the model's stability"
    LOST = (
        "some draws are left out, because they have no equilibrium or their stability differs from that of the model: the result is valid only if the true "
        "operating point is like that of the model; identify on more data or leave out terms"
    )

    @property
    def ok(self) -> bool:
        """True if no draw was left out."""
        return self is SampleStatus.OK


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled(Uncertain):
    """Frequency response at random draws from the posterior of the model's parameters, as `sample` returns it.

    Parameters
    ----------
    response : FrequencyResponse
        Frequency response at the estimated parameters, with n points.
    level : float
        Default coverage probability of the confidence regions and bands.
    dof : float
        Degrees of freedom of the Student-t posterior of the parameters; infinite if the posterior is normal.
    draws : ndarray of complex, shape (n_kept, n)
        Response at each draw that was kept, in the response's unit.
    n_without : int
        Number of draws left out because the model has no equilibrium at these parameters.
    n_other : int
        Number of draws left out because the equilibrium is stable for the draw and unstable for the estimated
        parameters, or conversely.
    """

    draws: Complex = field(metadata=variable("draw", "point", unit=attrgetter("unit")))
    n_without: int = field(metadata=attribute())
    n_other: int = field(metadata=attribute())

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "status": attribute(name="draws", of=attrgetter("status.name")),
    }

    @property
    def source(self) -> str:
        """Text for legends that states the number of draws."""
        return f"of {len(self.draws)} draws"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the response in the complex plane, on `ax` or new axes, with the draws and their ellipses."""
        axes = super().plot(ax)
        plot_draws(self, self.draws, axes)
        return axes

    @property
    def status(self) -> SampleStatus:
        """Status that says whether draws were left out."""
        return SampleStatus.LOST if self.n_without or self.n_other else SampleStatus.OK

    @property
    def linear_law(self) -> NDArray[np.bool_]:
        """True where an ellipse describes the uncertainty: here at all n points, because no linearisation is used."""
        return np.ones(self.values.shape, dtype=np.bool_)

    @property
    def mean(self) -> Complex:
        """Mean of the draws, complex, shape (n,), in ``unit``."""
        return np.asarray(self.draws.mean(axis=0))

    @cached_property
    def covariance(self) -> Array:
        """Covariance of real and imaginary part, shape (n, 2, 2), in the square of ``unit``."""
        away = self.draws - self.mean
        pairs = ((away.real, away.real), (away.real, away.imag), (away.imag, away.imag))
        rr, ri, ii = (np.einsum("kn,kn->n", a, b) for a, b in pairs)
        return read_only(np.stack([rr, ri, ri, ii], axis=-1).reshape(-1, 2, 2) / (len(away) - 1))

    def gain_band(self, level: float | None = None) -> Band:
        """Return the pointwise band of the gain, in ``unit``, of probability `level`, by default ``self.level``.

        Its ends are central quantiles of the draws' gains. Where the true gain is near zero, the band may lie above the
        true gain, because the scatter of real and imaginary part increases the gains of the draws.
        `Propagated.gain_band` avoids this.
        """
        return self._band(np.abs(self.draws), level)

    def phase_band(self, level: float | None = None) -> Band:
        """Return the pointwise band of the phase, degrees, of probability `level`, by default ``self.level``.

        Its ends are the phase of ``response`` plus central quantiles of the draws' deviations from that phase.
        """
        turned = np.angle(self.draws * np.conj(np.where(self.values == 0, 1.0, self.values)))
        return self._band(self.phase_deg + np.degrees(turned), level)

    def _band(self, values: Array, level: float | None) -> Band:
        level = self.level if level is None else probability(level)
        # The true value is like one more draw: it lies below the k-th of n with probability k / (n + 1), as in this
        # definition of the quantiles only.
        low, high = np.quantile(values, [(1 - level) / 2, (1 + level) / 2], axis=0, method="weibull")
        nowhere = np.zeros(low.shape, dtype=np.bool_)
        return Band(level=level, low=read_only(low), high=read_only(high), linear_law=nowhere)


def sample(
    model: NarxModel, quantity: Quantity, rng: np.random.Generator, n_draws: int = 2000, *, level: float = 0.95
) -> Sampled:
    """Compute a frequency response at random draws from the posterior of a model's parameters.

    Two kinds of draws are left out and counted: those for which the model has no equilibrium, and those for which the
    stability of the equilibrium differs from that at the estimated parameters.

    Parameters
    ----------
    model : NarxModel
        Model with the covariance ``theta_cov`` of its parameters. Their posterior is Student-t if ``theta_dof`` is
        finite, and normal otherwise.
    quantity : callable
        Function that takes a model and returns a FrequencyResponse, for example
        ``partial(gfrf, order=1, omega=omega)``.
    rng : numpy.random.Generator
        Random generator for the draws.
    n_draws : int
        Number of draws, at least 2.
    level : float
        Default coverage probability of the confidence regions and bands.

    Raises
    ------
    ModelError
        If `level`, `rng` or `n_draws` is not as described, the draws need more than 2 GiB, the covariance of the
        parameters is invalid, `quantity` does not return a FrequencyResponse, or fewer than two draws are kept.
    """
    response = response_of(model, quantity, level)
    n_draws = whole_number(n_draws, "n_draws", 2)
    require_generator(rng)
    size = 16 * n_draws * response.values.size
    if size > _MOST_BYTES:
        raise ModelError(
            f"{size / 2**30:.3g} GiB, more than {_MOST_BYTES >> 30} GiB, are needed for these draws; take fewer, or fewer "
            "frequencies (at_points)"
        )
    found = evaluate(model, quantity, response, draw_theta(model, rng, n_draws))
    kept = found.exists & (found.stable == response.status.ok)
    if kept.sum() < 2:
        raise ModelError(
            f"of {n_draws} draws {int(kept.sum())} have the model's operating point; its parameters are too uncertain"
        )
    draws = found.values if kept.all() else found.values[kept]
    return Sampled(
        response=response,
        level=level,
        dof=model.theta_dof,
        draws=draws,
        n_without=int(np.sum(~found.exists)),
        n_other=int(np.sum(found.exists & ~kept)),
    )
