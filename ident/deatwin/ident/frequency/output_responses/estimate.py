"""Nonlinear output frequency responses of polynomial NARX models: orders of the output, fitted at several levels."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import read_only, whole_number
from deatwin.ident.frequency.dc import Deviations, deviations
from deatwin.ident.frequency.gfrf import input_row, require_one_input, unit_of
from deatwin.ident.frequency.linear import polynomial_model, whole_order
from deatwin.ident.frequency.many import then
from deatwin.ident.frequency.output_responses.powers import InputSpectrum, input_spectrum, product_spectrum
from deatwin.ident.frequency.output_responses.result import Nofrf, NofrfStatus, NofrfWarning
from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.ident.frequency.spectrum import cross_order, one_period, output_orders, spectrum_of
from deatwin.ident.narx.free_run import free_run
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.response import divergence_limit
from deatwin.plant.arrays import Array, Booleans, Complex
from deatwin.plant.errors import ModelError

_BETTER = 2.0  # ratio by which further orders must reduce the error to be taken
_ROUNDING = 1e-12  # share of the spectra that is rounding error
_NOTHING = 1e-10  # share of all orders below which an error is not truncation: an order that is zero has such an error


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelFit:
    """Orders of the output, fitted at each spectral line to the spectra at several levels."""

    levels: Array  # shape (n_levels,): Factors of the excitation
    orders: Complex
    condition: float  # Condition number of the powers of the levels, with columns scaled to unit length
    residual: Array
    left_out: Array
    changes: Array

    def advisable_level(self, order: int, share: float) -> float:
        """Return the factor on the levels that makes the truncation error a given share of the orders up to one."""
        # Truncation begins with order N + 1; its share of Y_n grows with the level to the power N + 1 - n. Levels in
        # pairs of both signs separate even from odd orders, so that the first omitted order of n's parity counts.
        paired = np.allclose(np.sort(self.levels), np.sort(-self.levels), rtol=1e-9, atol=0.0)
        rounding = _NOTHING * np.linalg.norm(self.orders)
        factors = [1.0]
        for n, (values, change) in enumerate(zip(self.orders[:order], self.changes, strict=False), start=1):
            error, allowed = np.linalg.norm(change), max(share * np.linalg.norm(values), rounding)
            power = len(self.orders) + 1 - n
            power += power % 2 if paired else 0
            factors.append(1.0 if error <= allowed else float(allowed / error) ** (1.0 / power))
        return float(np.min(factors))


def chebyshev_levels(count: int) -> Array:
    """Return Chebyshev nodes of both signs, the largest 1, for polynomials without a constant, (count,)."""
    # An even count omits level zero, which carries no information.
    angles = (2 * np.arange(count // 2) + 1) * np.pi / (2 * count)
    positive = np.cos(angles) / np.cos(angles[0])
    return read_only(np.concatenate([positive, -positive[::-1]]))


def fit_orders(levels: Array, spectra: Complex, in_range: Sequence[Booleans], tried: range) -> LevelFit:
    """Fit Y(a) = a Y_1 + a^2 Y_2 + ... at each line over levels; `spectra` (n_levels, n_lines)."""
    # Take the smallest number of orders whose leave-one-out error is at most twice the smallest.
    reached = np.array(in_range[: levels.size])
    left_out = _left_out(levels, spectra, reached, min(tried[-1], levels.size))
    errors = left_out[tried[0] - 1 :]
    number = tried[int(np.argmax(errors <= max(_BETTER * errors.min(), _ROUNDING)))]
    orders, _ = separated(_powers(levels, number)[0], spectra, reached[:number])
    changes = np.full(orders.shape, np.nan)
    more, sizes = _powers(levels, number + 2)
    if np.linalg.matrix_rank(more / sizes) == number + 2:
        changes = np.abs(separated(more, spectra, reached[: number + 2])[0][:number] - orders)
    powers, lengths = _powers(levels, number)
    return LevelFit(
        levels=levels,
        orders=orders,
        condition=float(np.linalg.cond(powers / lengths)),
        residual=_residual(powers, spectra, orders),
        left_out=left_out,
        changes=changes,
    )


def separated(powers: Array, spectra: Complex, in_range: Booleans) -> tuple[Complex, Complex]:
    """Return the fitted orders (n_orders, n_lines), and the residual at each level when it is left out of the fit."""
    lengths = np.linalg.norm(powers, axis=0)
    orders, left_out = np.zeros(in_range.shape, dtype=np.complex128), spectra.copy()
    sets, which = np.unique(in_range, axis=1, return_inverse=True)
    for number, present in enumerate(sets.T):
        if not present.any():
            continue
        lines = which.ravel() == number
        q, r = np.linalg.qr((powers / lengths)[:, present])
        projected = q.T @ spectra[:, lines]
        orders[np.ix_(present, lines)] = np.linalg.lstsq(r, projected, rcond=None)[0] / lengths[present, None]
        # Leaving out a level increases its residual by the factor 1 / (1 - leverage).
        freedom = np.maximum(1.0 - np.sum(q**2, axis=1), np.finfo(float).eps)
        left_out[:, lines] = (spectra[:, lines] - q @ projected) / freedom[:, None]
    return orders, left_out


def _left_out(levels: Array, spectra: Complex, in_range: Booleans, most: int) -> Array:
    """Return, for 1, 2, ... orders, the unexplained share of the spectra at levels that were left out of the fit."""
    errors = np.full(most, np.inf)
    for n in range(1, min(most, levels.size - 1) + 1):
        errors[n - 1] = np.linalg.norm(separated(_powers(levels, n)[0], spectra, in_range[:n])[1])
    return np.asarray(errors / (np.linalg.norm(spectra) or 1.0), dtype=np.float64)


def _residual(powers: Array, spectra: Complex, orders: Complex) -> Array:
    """Return the share of each spectrum that the first n orders do not explain, shape (n_levels, n_orders)."""
    sums = np.cumsum(powers[:, :, None] * orders, axis=1)
    left, size = np.linalg.norm(spectra[:, None, :] - sums, axis=2), np.linalg.norm(spectra, axis=1)[:, None]
    return np.divide(left, size, out=np.zeros_like(left), where=size > 0)


def _powers(levels: Array, n_orders: int) -> tuple[Array, Array]:
    """Return the matrix of the fit, shape (n_levels, n_orders), and the norms of its columns."""
    powers = levels[:, None] ** np.arange(1, n_orders + 1)
    return powers, np.linalg.norm(powers, axis=0)


_MORE = 4  # orders beyond the requested one that may be fitted
_HIGHEST = 20  # most orders that can be fitted: with two more, the powers of the levels reach a condition number of 1e8
TRUNCATION = 0.01  # accepted truncation error of an order of the output, as a share of its rms over the lines
_RUN = 4096  # least samples of one run: a call costs as much as hundreds of samples
_PATIENCE = 1_000_000  # most samples of a simulation, or 100 periods if these are longer
_SMALL = 1e-11  # relative change of the output below which a change that no longer decreases is rounding


def nofrf(
    model: NarxModel,
    excitation: ArrayLike,
    order: int,
    *,
    highest: int | None = None,
    operating_input: ArrayLike | None = None,
) -> Nofrf:
    """Estimate nonlinear output frequency responses (NOFRFs) from simulations at several levels of an excitation.

    The output's spectrum in the steady state is Y = G_1 U_1 + G_2 U_2 + ..., where G_n is the response of order n and
    U_n is the spectrum of the input's n-th power. The model is simulated with the excitation multiplied by several
    factors (levels), which are Chebyshev nodes of both signs. The term G_n U_n grows with the n-th power of the level,
    so at each spectral line a least-squares fit over the levels separates the orders. An order n is fitted only at
    lines that are sums of n input frequencies.

    Parameters
    ----------
    model : NarxModel
        Model of one input and one output.
    excitation : array_like, shape (n_samples,)
        One period of the input as deviations from the operating input, at the model's sampling time, in the input's
        unit; see `design_excitation`.
    order : int
        Desired order n, from 1 to 20.
    highest : int, optional
        Number of orders to fit, up to 20. By default, all numbers from ``order`` to ``order`` + 4 are tried, and the
        smallest number is taken whose leave-one-out error over the levels is at most twice the least of these errors.
    operating_input : float, optional
        Constant input about which the model is analysed, in its unit; the mean of the training inputs by default.

    Warns
    -----
    NofrfWarning
        If the status of the result is not OK, for example because the excitation is too large.

    Raises
    ------
    ModelError
        If an argument is invalid, if the model has several inputs or no equilibrium, or if it diverges at so many
        levels that fewer levels than orders remain.

    References
    ----------
    Lang, Billings, "Energy transfer properties of non-linear systems in the frequency domain", Int. J. Control 78
    (2005) 345-362, doi:10.1080/00207170500095759.
    """
    order = whole_order(order)
    wanted = _wanted_orders(order, highest)
    require_one_input(model, "nofrf_exact")
    period = one_period(excitation, model.sample_time)
    orders, unit = range(1, wanted[-1] + 3), model.input_units[0]
    powers = tuple(input_spectrum(period, n, model.sample_time, unit=unit) for n in orders)
    levels = chebyshev_levels(2 * max(wanted[-1], 2))
    runs = _run(deviations(model, operating_input), period, levels, wanted[0])
    fit = fit_orders(runs.levels, runs.spectra, [u.in_range for u in powers], wanted)
    exact = output_orders(model, period, len(fit.orders), operating_input=operating_input)
    found = _judged(_result(model, order, exact, powers[: len(exact)], runs, fit), runs.settled)
    if not found.status.ok:
        warnings.warn(_said(found), NofrfWarning, stacklevel=2)
    return found


def nofrf_exact(
    model: NarxModel,
    excitation: ArrayLike,
    order: int | Mapping[str, int],
    *,
    operating_input: ArrayLike | None = None,
) -> FrequencyResponse:
    """Compute a nonlinear output frequency response (NOFRF) from the model's equations, without truncation.

    The response is G_n = Y_n / U_n. Y_n is the spectrum of the n-th order of the output (`output_orders`), and U_n that
    of the n-th power of the input. For several inputs, Y_n belongs to the part of the output that is proportional to
    the given power of each input, and U_n to the product of these powers.

    Parameters
    ----------
    model : NarxModel
        Model of one output.
    excitation : array_like, shape (n_samples,), or (n_inputs, n_samples) for several inputs
        One period of the input as deviations from the operating input, at the model's sampling time, in the input's
        unit.
    order : int, or mapping of str to int
        Order n, at least 1. With several inputs, a mapping from each input's name to its power, such as
        ``{"u1": 1, "u2": 1}``; inputs that are not named have power 0.
    operating_input : float, or array_like of shape (n_inputs,), optional
        Constant input about which the model is analysed, in its unit; the mean of the training inputs by default.

    Returns
    -------
    FrequencyResponse
        Response G_n, in output units per n-th power of the input unit, at the spectral lines at which U_n is not zero.

    Warns
    -----
    NofrfWarning
        If contributions to U_n cancel at some lines, so that G_n is erratic there (`InputSpectrum.suitable`).

    Raises
    ------
    ModelError
        For the reasons given in `output_orders`, or if the excitation is zero.

    References
    ----------
    Lang, Billings, "Energy transfer properties of non-linear systems in the frequency domain", Int. J. Control 78
    (2005) 345-362, doi:10.1080/00207170500095759.
    Peng, Lang, Billings, "Non-linear output frequency response functions for multi-input non-linear Volterra systems",
    Int. J. Control 80 (2007) 843-855.
    """
    powers = _powers_of_inputs(polynomial_model(model), order)
    periods = np.atleast_2d(one_period(excitation, model.sample_time, len(powers)))
    power = product_spectrum(periods, powers, model.sample_time, model.input_units)
    if not power.suitable:
        warnings.warn(NofrfStatus.ERRATIC_EXCITATION.value, NofrfWarning, stacklevel=2)
    output = cross_order(model, excitation, powers, operating_input)
    rows = [row for row, count in enumerate(powers) for _ in range(count)]
    return quotient(output, power, unit_of(model, rows))


def _powers_of_inputs(model: NarxModel, order: int | Mapping[str, int]) -> tuple[int, ...]:
    """Return the power of each input."""
    count = len(model.input_names)
    if not isinstance(order, Mapping):
        if count != 1:
            raise ModelError(
                f"the model has {count} inputs: give the power of each by its name, as "
                f"order={dict.fromkeys(model.input_names[:2], 1)}"
            )
        return (whole_order(order),)
    powers = [0] * count
    for name, power in order.items():
        powers[input_row(model, name)] = whole_number(power, f"the power of {name}", 0)
    whole_order(sum(powers))
    return tuple(powers)


def _wanted_orders(order: int, highest: int | None) -> range:
    """Return the range of the number of orders to fit."""
    fewest = order if highest is None else whole_number(highest, "highest", order)
    if fewest > _HIGHEST:
        raise ModelError(
            f"{fewest} orders; beyond {_HIGHEST} the powers of the levels can hardly be distinguished in double "
            "precision: fit fewer, or use `nofrf_exact`"
        )
    return range(fewest, min(order + _MORE, _HIGHEST) + 1 if highest is None else fewest + 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Runs:
    """Spectra of the output at those levels at which it stays finite."""

    levels: Array  # shape (n_levels,): Factors of the excitation at which the output stays finite
    spectra: Complex  # shape (n_levels, n_lines): Spectra of the output's deviations
    lost: Array  # Factors of the excitation at which the model diverges
    settled: bool  # True if the output becomes periodic at all of `levels`

    @property
    def kept_share(self) -> float:
        """Return the largest level without divergence, divided by the largest of all."""
        largest = float(np.abs(self.levels).max())
        return largest / max(largest, float(np.abs(self.lost).max(initial=0.0)))


def _run(about: Deviations, period: Array, levels: Array, needed: int) -> _Runs:
    states = [steady_state(about.model, level * period) for level in levels]
    kept = np.array([not state.diverged for state in states])
    if kept.sum() < needed:
        advice = "lower the amplitude of the excitation" if about.point.is_stable else NofrfStatus.UNSTABLE.value
        raise ModelError(
            f"the model diverges at {_written(levels[~kept])} times the excitation; {kept.sum()} remaining level(s) "
            f"cannot separate {needed} orders: {advice}"
        )
    return _Runs(
        levels=levels[kept],
        spectra=spectrum_of([state.values for state in states if not state.diverged]),
        lost=levels[~kept],
        settled=all(state.settled for state in states if not state.diverged),
    )


def _result(
    model: NarxModel,
    order: int,
    exact: Sequence[FrequencyResponse],
    inputs: tuple[InputSpectrum, ...],
    runs: _Runs,
    fit: LevelFit,
) -> Nofrf:
    """Return the fit before it is judged; its derivatives are those of the exact orders, without truncation."""
    outputs = tuple(as_fitted(y, values) for y, values in zip(exact, fit.orders, strict=True))
    return Nofrf(
        order=order,
        orders=tuple(quotient(y, u, unit_of(model, (0,) * u.order)) for y, u in zip(outputs, inputs, strict=True)),
        outputs=outputs,
        inputs=inputs,
        levels=read_only(runs.levels),
        lost_levels=read_only(runs.lost),
        condition=fit.condition,
        residual=fit.residual,
        left_out=fit.left_out,
        truncation=tuple(
            change[u.defined] / np.abs(u.values[u.defined]) for change, u in zip(fit.changes, inputs, strict=True)
        ),
        advisable_level=float(np.minimum(fit.advisable_level(order, TRUNCATION), runs.kept_share)),
        status=NofrfStatus.OK,
    )


def _judged(found: Nofrf, settled: bool) -> Nofrf:
    """Return the result with its most serious warning."""
    faults = {
        NofrfStatus.UNSTABLE: not found.response.status.ok,
        NofrfStatus.DIVERGED: found.lost_levels.size > 0,
        NofrfStatus.NOT_SETTLED: not settled,
        NofrfStatus.ERRATIC_EXCITATION: not all(u.suitable for u in found.inputs[: found.order]),
        NofrfStatus.TRUNCATED: found.advisable_level < 1.0,
    }
    return replace(found, status=next((status for status, present in faults.items() if present), NofrfStatus.OK))


def as_fitted(exact: FrequencyResponse, values: Complex) -> FrequencyResponse:
    """Return a fitted order of the output, which changes with the parameters as the exact order does."""
    return replace(exact, values=values, evaluate=then(exact.evaluate, partial(np.add, values - exact.values)))


def quotient(output: FrequencyResponse, power: InputSpectrum, unit: str) -> FrequencyResponse:
    """Return G_n = Y_n / U_n, where U_n is not zero."""
    powers, some = power.values[power.defined], output.at_points(power.defined)
    return replace(
        some,
        symbol="G",
        values=some.values / powers,
        unit=unit,
        differentiate=partial(_quotient_gradient, some, powers),
        evaluate=then(some.evaluate, partial(_quotient, powers)),
    )


def _quotient(powers: Complex, values: Complex) -> Complex:
    return values / powers


def _quotient_gradient(output: FrequencyResponse, powers: Complex) -> Complex:
    return output.gradient / powers[:, None]


def _said(found: Nofrf) -> str:
    """Return the advice, with the levels or orders that it concerns."""
    if found.status is NofrfStatus.DIVERGED:
        return f"{found.status.value} ({_written(found.lost_levels)} times the excitation)"
    if found.status is NofrfStatus.TRUNCATED:
        return f"{found.status.value} (about {found.advisable_level:.2g} times these levels would do)"
    return found.status.value


def _written(levels: Array) -> str:
    return ", ".join(f"{level:.3g}" for level in levels)


@dataclass(frozen=True, kw_only=True, eq=False)
class SteadyState:
    """The last period of a simulation from rest."""

    values: Array  # shape (n_samples,): Output over one period, in its unit
    settled: bool  # True if the output repeats from period to period, up to rounding
    diverged: bool  # True if the output left all bounds; the values are then its last ones


def steady_state(model: NarxModel, excitation: Array) -> SteadyState:
    """Simulate a model from rest under a period, (n_samples,) or (n_inputs, n_samples), until the output repeats."""
    lag, n = model.table.max_lag, excitation.shape[-1]
    periods = -(-_RUN // n)
    inputs = np.atleast_2d(excitation)[:, np.arange(-lag, periods * n) % n]
    outputs = np.zeros((1, lag + periods * n))
    limit = divergence_limit(model.operating, outputs)
    last, fell = np.zeros(n), np.inf
    for _ in range(max(_PATIENCE // (periods * n), 100 // periods) + 1):
        run, failed = free_run(model.table, model.theta, inputs, outputs, limit)
        values = run[0, -n:]
        if failed is not None:
            return SteadyState(values=values, settled=False, diverged=True)
        before = run[0, -2 * n : -n] if periods > 1 else last
        change, size = float(np.abs(values - before).max()), float(np.abs(values).max())
        if change == 0.0 or fell <= change <= _SMALL * size:
            return SteadyState(values=values, settled=True, diverged=False)
        last, fell = values, change
        outputs = np.zeros_like(outputs)
        outputs[0, :lag] = run[0, run.shape[1] - lag :]
    return SteadyState(values=last, settled=False, diverged=False)
