"""The mean of a frequency response over a band of output frequencies, and tests of whether two means are equal.

A test of all frequencies at once would be one of the few parameters, the same in every band. The mean is linear in the
response, so its law does not depend on the size of the response.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import read_only, real_numbers
from deatwin.ident.frequency.gfrf import frequency_grid, gfrf
from deatwin.ident.frequency.linear import whole_order
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.robust import Cosines
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

_FLAT = 1e-12  # share of the largest variance below which a direction has no scatter
_HALVINGS = 100  # bisections of the multiplier of a margin, to 1e-30 of its bound


class Scatter(NamedTuple):
    """Uncertainty of a vector of means."""

    scale: Array  # shape (..., q, q): Squared scale of its t law
    dof: float  # Degrees of freedom of that law; infinite for a normal law


@dataclass(frozen=True, kw_only=True)
class Equality:
    """Test of the hypothesis that two vectors of means are equal."""

    statistic: float  # Squared distance in units of its scatter; for a drift, the ratio of variances
    dof: tuple[float, float]
    p_value: float  # Probability of a larger statistic


def equality(difference: ArrayLike, scatters: Sequence[Scatter], margin: float = 0.0) -> Equality:
    """Test whether a difference (2,) of independent means is at most a margin (Krishnamoorthy, Yu, Stat. Probab. Lett. 66
    (2004) 161-169); of several differences, the largest p-value counts (Berger, Technometrics 24 (1982) 295-300)."""
    from scipy.stats import chi2, f

    inverse, rank = _inverted(np.asarray(sum(s.scale for s in scatters), dtype=np.float64))
    statistic = _beyond(np.asarray(difference, dtype=np.float64), inverse, margin)
    freedom = np.broadcast_to(_freedom(inverse, scatters, rank), statistic.shape)
    second = freedom - rank + 1
    if np.isinf(freedom).all():
        p = chi2.sf(statistic, rank)
    else:
        p = f.sf(statistic * second / (freedom * rank), rank, second)
    worst = np.unravel_index(np.argmax(p), p.shape)
    return Equality(statistic=float(statistic[worst]), dof=(float(rank), float(second[worst])), p_value=float(p[worst]))


def _inverted(total: Array) -> tuple[Array, int]:
    """Return inverse scales of the directions that have scatter, and the number of these directions."""
    sizes, directions = np.linalg.eigh(total)
    largest = sizes[..., -1:]
    if not np.all(largest > 0):
        raise ModelError("the models have no covariance: nothing says whether a difference is significant")
    kept = sizes > _FLAT * largest
    inverse = np.where(kept, 1.0, 0.0) / np.where(kept, sizes, 1.0)
    return (directions * inverse[..., None, :]) @ directions.swapaxes(-1, -2), int(kept.sum(axis=-1).max())


def _freedom(inverse: Array, scatters: Sequence[Scatter], rank: int) -> Array:
    """Degrees of freedom of the sum of the scatters (Krishnamoorthy and Yu)."""
    rates: Array = np.zeros(inverse.shape[:-2])
    for scale, dof in scatters:
        share = scale @ inverse
        trace = np.trace(share, axis1=-2, axis2=-1)
        rates = rates + (np.trace(share @ share, axis1=-2, axis2=-1) + trace**2) / dof
    with np.errstate(divide="ignore"):
        return np.asarray((rank + rank**2) / rates, dtype=np.float64)


def _beyond(difference: Array, inverse: Array, margin: float) -> Array:
    """Return the smallest squared distance to a point whose distance from zero is within the margin."""
    if margin <= 0:
        return np.asarray(np.einsum("...i,...ij,...j->...", difference, inverse, difference), dtype=np.float64)
    # The nearest point x of the disc solves (A + t) x = A d with A the inverse scale; t >= 0 shrinks x to the margin.
    sizes, axes = np.linalg.eigh(inverse)
    along = np.einsum("...ij,...i->...j", axes, difference)
    low = np.zeros(along.shape[:-1])
    high = sizes.max(axis=-1) * np.linalg.norm(along, axis=-1) / margin
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        nearest = sizes * along / (sizes + middle[..., None] + np.finfo(float).tiny)
        far = np.linalg.norm(nearest, axis=-1) > margin
        low, high = np.where(far, middle, low), np.where(far, high, middle)
    left = along * high[..., None] / (sizes + high[..., None] + np.finfo(float).tiny)
    return np.asarray(np.sum(sizes * left**2, axis=-1), dtype=np.float64)


def holm(p_values: ArrayLike) -> Array:
    """Correct p-values (n,) for their number (Holm, Scand. J. Stat. 6 (1979) 65-70)."""
    given = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(given, kind="stable")
    corrected = np.empty_like(given)
    corrected[order] = np.minimum(np.maximum.accumulate(given[order] * np.arange(given.size, 0, -1)), 1.0)
    return corrected


def no_drift(cosines: Cosines) -> Equality:
    """Test for drift: are slow cosines no larger than others (Rao, Bull. Inst. Int. Stat. 33 (1951) 177)?"""
    slow, fast = cosines.slow, cosines.fast
    if cosines.n_slow == 0 or slow.shape[1] > 2:
        raise ModelError(f"{cosines.n_slow} slow cosines of {slow.shape[1]} series; give some, of one or two series")
    sizes, directions = np.linalg.eigh(fast.T @ fast)
    if not sizes[-1] > 0:
        raise ModelError("the series do not scatter: nothing says whether a drift is significant")
    kept = directions[:, sizes > _FLAT * sizes[-1]]
    counts = sorted({*(2**k for k in range(cosines.n_slow.bit_length())), cosines.n_slow})
    surest = min((_wilks(slow[:count] @ kept, fast @ kept) for count in counts), key=lambda test: test.p_value)
    return replace(surest, p_value=min(1.0, len(counts) * surest.p_value))


def _wilks(effect: Array, error: Array) -> Equality:
    """Test whether one or two series have larger values in ``effect`` than in ``error``."""
    from scipy.stats import f

    rank = effect.shape[1]
    within = error.T @ error
    ratio = float(np.linalg.det(within) / np.linalg.det(within + effect.T @ effect)) ** (1 / rank)
    first, second = rank * len(effect), rank * (len(error) - rank + 1)
    statistic = (1 - ratio) / ratio * second / first
    return Equality(statistic=statistic, dof=(first, second), p_value=float(f.sf(statistic, first, second)))


Range = tuple[float, float]

LINES = 8  # Frequencies in a band, enough for the curvature of a response with few poles
TONES = 16  # Values of each further input frequency, over both signs
_HIGHEST = 5  # highest order that is compared: half a million combinations of frequencies


@dataclass(frozen=True, kw_only=True, eq=False)
class BandMean:
    """H_n, averaged over the combinations of input frequencies whose sum lies in a band."""

    order: int  # Order n of the response
    from_Hz: float  # Lower edge of the band of the sum
    to_Hz: float  # Upper edge of that band
    value: Array  # shape (2,): Real and imaginary part of the mean, in ``unit``
    gradient: Array  # shape (2, n_terms): Derivative of the value by the parameters of the model
    scatter: Scatter
    gain: float  # Root mean square of the gain over the combinations, in ``unit``
    unit: str


def band_frequencies(order: int, band: Range, input_band: Range) -> Array:
    """Return input frequencies (n,), rad/s, with sums evenly in `band` and each in `input_band`, Hz."""
    sums = band[0] + (band[1] - band[0]) * (np.arange(LINES) + 0.5) / LINES
    tones = input_band[1] * (2 * np.arange(TONES) + 1 - TONES) / TONES
    grid = frequency_grid(sums, *[tones] * (order - 1))
    each = np.column_stack([grid[:, 1:], grid[:, 0] - grid[:, 1:].sum(axis=1)])
    inside = np.all((np.abs(each) >= input_band[0]) & (np.abs(each) <= input_band[1]), axis=1)
    chosen = 2 * np.pi * each[inside]
    return chosen[:, 0] if order == 1 else chosen


def band_means(
    model: NarxModel,
    orders: Iterable[int],
    bands: Sequence[Range],
    *,
    operating_input: ArrayLike | None = None,
    input_band: Range | None = None,
) -> tuple[BandMean, ...]:
    """Average a model's responses over bands of output frequencies, with inputs within `input_band`, Hz."""
    several, wanted = whole_orders(orders), _ranges(bands, "bands")
    inputs = (0.0, max(high for _, high in wanted)) if input_band is None else _ranges([input_band], "input_band")[0]
    found = []
    for order in several:
        for band in wanted:
            omega = band_frequencies(order, band, inputs)
            if len(omega):
                found.append(_mean(model, order, band, omega, operating_input))
    if not found:
        raise ModelError(f"no order reaches a band with input frequencies from {inputs[0]:g} to {inputs[1]:g} Hz")
    return tuple(found)


def whole_orders(orders: Iterable[int]) -> tuple[int, ...]:
    """Return the orders of the responses that are compared."""
    several = tuple(orders) if isinstance(orders, Iterable) else ()
    if not several:
        raise ModelError(f"orders = {orders!r}; give integers from 1 to {_HIGHEST}, as (1, 2)")
    return tuple(whole_order(order, _HIGHEST) for order in several)


def _ranges(bands: Sequence[Range], name: str) -> tuple[Range, ...]:
    given = real_numbers(bands, name)
    if given.ndim != 2 or given.shape[1] != 2:
        raise ModelError(f"{name}: at least one pair of frequencies in Hz is needed, as (0.0, 0.1); got {bands!r}")
    for low, high in given:
        if not 0 <= low < high < np.inf:
            raise ModelError(f"a band goes from 0 Hz or more to a higher frequency; got {low:g} to {high:g} Hz")
    return tuple((float(low), float(high)) for low, high in given)


def _mean(model: NarxModel, order: int, band: Range, omega: Array, operating_input: ArrayLike | None) -> BandMean:
    response = gfrf(model, order, omega, operating_input=operating_input)
    mean, slope = response.values.mean(), response.gradient.mean(axis=0)
    gradient = np.stack([slope.real, slope.imag])
    # The squared scale of a t law is smaller than its covariance.
    share = 1.0 if np.isinf(model.theta_dof) else (model.theta_dof - 2) / model.theta_dof
    return BandMean(
        order=order,
        from_Hz=band[0],
        to_Hz=band[1],
        value=read_only([mean.real, mean.imag]),
        gradient=read_only(gradient),
        scatter=Scatter(scale=read_only(share * gradient @ model.theta_cov @ gradient.T), dof=model.theta_dof),
        gain=float(np.sqrt(np.mean(response.gain**2))),
        unit=response.unit,
    )
