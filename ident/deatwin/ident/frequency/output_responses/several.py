"""Nonlinear output frequency responses of models with several inputs, each with levels of its own."""

from __future__ import annotations

import warnings
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.frequency.checks import whole_order
from deatwin.ident.frequency.dc import deviations
from deatwin.ident.frequency.gfrf import unit_of
from deatwin.ident.frequency.output_responses.estimate import TRUNCATION, as_fitted, quotient
from deatwin.ident.frequency.output_responses.levels import chebyshev_levels, separated
from deatwin.ident.frequency.output_responses.powers import product_spectrum
from deatwin.ident.frequency.output_responses.result import NofrfStatus, NofrfWarning
from deatwin.ident.frequency.output_responses.steady import steady_state
from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.ident.frequency.spectrum import cross_order, one_period, spectrum_of
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.errors import ModelError

_MORE = 2  # Orders fitted beyond the requested one; a fit with as many again shows the effect of those left out


def nofrf_of_inputs(
    model: NarxModel, excitation: ArrayLike, order: int, *, operating_input: ArrayLike | None = None
) -> tuple[FrequencyResponse, ...]:
    """Estimate nonlinear output frequency responses of a model with several inputs by least squares over levels.

    The model is simulated with several levels of each input, in all combinations. At each line, the parts of the output
    are separated by their growth with these levels, because each part is proportional to a power of each input.
    `nofrf_exact` computes the same responses from the equations.

    Parameters
    ----------
    model : NarxModel
        Model of one output.
    excitation : array_like, shape (n_inputs, n_samples)
        One period of the inputs as deviations from the operating input, at the model's sampling time, in their units.
    order : int
        Largest total order of the responses, which is the sum of the powers of all inputs; at least 1.
    operating_input : array_like, shape (n_inputs,), optional
        Constant inputs about which the model is analysed, in their units; the mean of the training inputs by default.

    Returns
    -------
    tuple of FrequencyResponse
        Responses of all powers whose sum is at most the order, in the order of this sum; the attribute ``inputs`` of a
        response repeats the name of each input as often as its power.

    Warns
    -----
    NofrfWarning
        If the excitation is not suitable, the output does not repeat, or orders that were not fitted change a part of
        the output by more than 1 %.

    Raises
    ------
    ModelError
        If order or excitation are not as described, an input is not excited, the model diverges at a level, or the
        model has no equilibrium.

    References
    ----------
    Peng, Lang, Billings, "Non-linear output frequency response functions for multi-input non-linear Volterra systems",
    Int. J. Control 80 (2007) 843-855.
    """
    wanted, about, count = whole_order(order), deviations(model, operating_input), len(model.input_names)
    period = np.atleast_2d(one_period(excitation, model.sample_time, count))
    most = wanted + 2 * _MORE
    tried = [p for p in product(range(most, -1, -1), repeat=count) if 0 < sum(p) <= most]
    powers = np.array(sorted(tried, key=sum))
    inputs = [product_spectrum(period, p, model.sample_time, model.input_units) for p in powers.tolist()]
    levels = np.array(list(product(chebyshev_levels(most + 2 - most % 2), repeat=count)))
    states = [steady_state(about.model, level[:, None] * period) for level in levels]
    if any(state.diverged for state in states):
        raise ModelError("the model diverges under the excitation: lower its amplitude")
    spectra, in_range = spectrum_of([state.values for state in states]), np.array([u.in_range for u in inputs])
    matrix = np.prod(levels[:, None, :] ** powers, axis=2)
    asked, fitted = (int(np.sum(powers.sum(axis=1) <= n)) for n in (wanted, wanted + _MORE))
    parts, more = (separated(matrix[:, :n], spectra, in_range[:n])[0][:asked] for n in (fitted, len(powers)))
    change, size = np.linalg.norm(more - parts, axis=1), np.linalg.norm(parts, axis=1)
    faults = {
        NofrfStatus.NOT_SETTLED: not all(state.settled for state in states),
        NofrfStatus.ERRATIC_EXCITATION: not all(u.suitable for u in inputs[:asked]),
        NofrfStatus.TRUNCATED: bool(np.any(change > np.maximum(TRUNCATION * size, 1e-10 * size.max()))),
    }
    for status in (status for status, present in faults.items() if present):
        warnings.warn(status.value, NofrfWarning, stacklevel=2)
    found = []
    for power, values, spectrum in zip(powers[:asked].tolist(), parts, inputs, strict=False):
        exact = cross_order(model, period, power, operating_input)
        rows = [row for row, times in enumerate(power) for _ in range(times)]
        found.append(quotient(as_fitted(exact, values), spectrum, unit_of(model, rows)))
    return tuple(found)
