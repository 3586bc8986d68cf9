"""The mean of a frequency response over a band of output frequencies: what a comparison compares.

A test of all frequencies at once would be one of the few parameters, the same in every band. The mean is linear in the
response, so its law does not depend on the size of the response.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import read_only, real_numbers
from deatwin.ident.frequency.checks import whole_order
from deatwin.ident.frequency.comparison.equality import Scatter
from deatwin.ident.frequency.gfrf import frequency_grid, gfrf
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

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
