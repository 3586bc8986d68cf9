"""Noise models: the NARMAX model of a process model's residuals, by extended least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.criteria import CRITERIA, criterion_values
from deatwin.ident.narx.estimate import Estimate, least_squares
from deatwin.ident.narx.forward import forward_selection
from deatwin.ident.narx.identifier import FitStatus, NarxIdentifier, Progress
from deatwin.ident.narx.lags import ChannelLags, lag_list
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Recordings, Regression
from deatwin.ident.narx.terms import Term, TermTable, Variable
from deatwin.plant.errors import ModelError, nearest

__all__ = ["Narmax", "NoiseFit", "NoiseStatus", "extended_least_squares"]

Array = NDArray[np.float64]

_KNOWN = ("ebic", "bic", "aic", "none")


class NoiseStatus(Enum):
    """How the iteration of the noise ended; the value is the advice."""

    CONVERGED = "converged"
    NOT_CONVERGED = (
        "the noise did not settle: take fewer noise terms or lags, or more iterations; the estimates are those of the "
        "last iteration"
    )

    @property
    def ok(self) -> bool:
        """Whether the noise settled."""
        return self is NoiseStatus.CONVERGED


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseFit:
    """Estimates of process and noise terms together.

    Parameters
    ----------
    estimate : Estimate
        Of the process terms and, after them, the noise terms; scaled.
    noise : tuple of ndarray, each of shape (n_outputs, n)
        e of each recording, scaled; zero before the first fitted sample and for the other outputs.
    changes : tuple of float
        Root mean square change of e in each iteration, relative to e.
    status : NoiseStatus
        Whether e settled.
    """

    estimate: Estimate
    noise: tuple[Array, ...]
    changes: tuple[float, ...]
    status: NoiseStatus


class Narmax(NarxIdentifier):
    """Add a noise model to a process model: y(k) = f(y, u) + g(y, u, e) + e(k).

    The process terms are those that another identifier chooses. The noise terms, each of which holds some e(k-l), are
    chosen by their error reduction ratio beside the process terms, e being the residual so far; both are then
    estimated together by extended least squares, e being computed anew until it settles, and the choice is made once
    more with that e. Where the noise is coloured this takes the bias off the process terms, and lets their intervals
    cover.

    A free run of the model leaves e at zero, a prediction runs it along.

    Parameters
    ----------
    process : NarxIdentifier
        Chooses the process terms, as ``Frols(output_lags=4)`` or ``Fixed(terms=["y(k-1)", "u(k-1)"])``; it is not
        changed by a fit.
    noise_lags : int or sequence of int
        A number n for the lags 1..n of e, or the lags themselves, in samples.
    noise_degree : int
        Largest degree of a noise term; from 2 on products of e with itself and with all lagged signals of the process'
        candidates are candidates too.
    max_noise_terms : int
        Largest number of noise terms.
    criterion : str
        "ebic", "bic" or "aic" choose the number of noise terms, which may be 0; "none" keeps ``max_noise_terms``.
    tolerance : float
        e has settled when its root mean square change in an iteration is less than this share of it.
    max_iterations : int
        Largest number of iterations.

    Attributes
    ----------
    model_ : NarxModel
        Process terms and, after them, noise terms, in physical units.
    process_ : NarxIdentifier
        The fitted identifier of the process terms.
    noise_terms_ : tuple of Term
        The chosen noise terms.
    noise_status_ : NoiseStatus
        Whether the noise settled.
    changes_ : ndarray, shape (n_iterations,)
        Root mean square change of e in each iteration, relative to e.

    References
    ----------
    Billings, "Nonlinear System Identification: NARMAX Methods in the Time, Frequency, and Spatio-Temporal Domains"
    (2013), chapter 3, doi:10.1002/9781118535561.
    Ljung, "System Identification: Theory for the User", 2nd ed. (1999), chapters 7 (pseudo-linear regressions) and 9
    (the covariance of estimates that make errors uncorrelated with given signals).
    """

    def __init__(
        self,
        process: NarxIdentifier,
        *,
        noise_lags: ChannelLags = 2,
        noise_degree: int = 2,
        max_noise_terms: int = 5,
        criterion: str = "ebic",
        tolerance: float = 1e-6,
        max_iterations: int = 100,
    ) -> None:
        self.process = process
        self.noise_lags = noise_lags
        self.noise_degree = noise_degree
        self.max_noise_terms = max_noise_terms
        self.criterion = criterion
        self.tolerance = tolerance
        self.max_iterations = max_iterations

    def _check(self) -> None:
        if not isinstance(self.process, NarxIdentifier):
            raise ModelError(f"process = {self.process!r}; give an identifier, as Frols(output_lags=4)")
        self.process._check()
        if not lag_list(self.noise_lags, smallest=1):
            raise ModelError("noise_lags gives no lag at all; a noise model needs e(k-1) or later")
        if self.criterion not in _KNOWN:
            raise ModelError(
                f"criterion = {self.criterion!r}{nearest(self.criterion, _KNOWN)}; known are {', '.join(_KNOWN)}"
            )
        for name, least in (("noise_degree", 1), ("max_noise_terms", 0), ("max_iterations", 1)):
            if getattr(self, name) < least:
                raise ModelError(f"{name} = {getattr(self, name)}; it must be at least {least}")
        if not self.tolerance > 0:
            raise ModelError(f"tolerance = {self.tolerance}; it must be positive")

    def _regression(self, recordings: Recordings, output: int) -> Regression:
        return self.process._regression(recordings, output)

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        self.process_ = self.process._fitted_clone(data, lambda share, doing: progress(0.5 * share, doing))
        self.status_ = self.process_.status_
        lags = lag_list(self.noise_lags, smallest=1)
        process = replace(
            data.about(self.process_.model_), table=TermTable(self.process_.model_.terms), first=max(data.first, *lags)
        )
        candidates = _candidates(data, lags, self.noise_degree)
        terms: tuple[Term, ...] = ()
        fit = self._fit(process, terms)
        try:
            for share in (0.6, 0.8):
                chosen = self._choose(process, candidates, fit)
                progress(share, f"noise model of {len(chosen)} terms")
                terms, fit = chosen, self._fit(process, chosen)
        except KeyboardInterrupt:
            self.status_ = FitStatus.INTERRUPTED
        self.noise_terms_, self.noise_status_ = terms, fit.status
        self.changes_ = np.array(fit.changes)
        found = fit.estimate
        whole = replace(process, table=TermTable(process.table.terms + terms))
        return whole.model(found.theta, found.theta_cov, found.noise_variance, identifier=self)

    def _fit(self, process: Regression, terms: tuple[Term, ...]) -> NoiseFit:
        return extended_least_squares(
            process, terms, tolerance=self.tolerance, max_iterations=self.max_iterations
        )

    def _choose(self, process: Regression, candidates: TermTable, fit: NoiseFit) -> tuple[Term, ...]:
        """Choose noise terms by their error reduction ratio beside the process terms, at the noise so far."""
        given, target = process.matrix()
        rows = _noise_rows(process, candidates, fit.noise)
        most = min(self.max_noise_terms, target.size - len(given) - 1)
        steps = list(forward_selection(rows, target, most, given=given))
        count = len(steps)
        if self.criterion != "none":
            residual = target - least_squares(given, target).theta @ given
            without = CRITERIA[self.criterion](
                float(np.mean(residual**2)), np.inf, target.size, 0, len(candidates.terms)
            )
            values = criterion_values(self.criterion, steps, target, len(candidates.terms))
            count = int(np.argmin([without, *values]))
        return tuple(candidates.terms[step.candidate] for step in steps[:count])


def extended_least_squares(
    process: Regression, noise_terms: Sequence[Term], *, tolerance: float = 1e-6, max_iterations: int = 100
) -> NoiseFit:
    """Estimate process and noise terms together.

    Least squares of the process terms gives the first e. Then the noise terms are computed of e, all parameters are
    estimated by least squares, and the residual is the new e, until it settles: a pseudo-linear regression. Its
    covariance is ``s^2 (Z Psi')^-1 Z Z' (Psi Z')^-1`` with the regressors Z and the slopes Psi = -de/dtheta, in which
    the dependence of e on its own past is counted.

    Parameters
    ----------
    process : Regression
        On the process terms; its first sample must allow for the lags of the noise.
    noise_terms : sequence of Term
        Each with a factor e(k-l); none gives plain least squares.
    tolerance : float
        e has settled when its root mean square change is less than this share of it.
    max_iterations : int
        Largest number of iterations.

    Returns
    -------
    NoiseFit

    Raises
    ------
    ModelError
        If there are too few samples.
    """
    rows, target = process.matrix()
    table = TermTable(tuple(noise_terms))
    estimate = least_squares(rows, target)
    noise = target - estimate.theta @ rows
    if not table.terms:
        return NoiseFit(estimate=estimate, noise=_spread(process, noise), changes=(), status=NoiseStatus.CONVERGED)
    status, changes = NoiseStatus.NOT_CONVERGED, []
    for _ in range(max_iterations):
        whole = np.vstack([rows, _noise_rows(process, table, _spread(process, noise))])
        estimate = least_squares(whole, target)
        before, noise = noise, target - estimate.theta @ whole
        changes.append(float(np.linalg.norm(noise - before) / max(np.linalg.norm(noise), np.finfo(float).tiny)))
        if changes[-1] <= tolerance:
            status = NoiseStatus.CONVERGED
            break
    spread = _spread(process, noise)
    cov = _covariance(process, table, estimate, whole, spread)
    return NoiseFit(
        estimate=replace(estimate, theta_cov=cov), noise=spread, changes=tuple(changes), status=status
    )


def _candidates(data: Regression, lags: tuple[int, ...], degree: int) -> TermTable:
    """Return all products of the lagged signals of the candidates and of e that hold some e."""
    outputs = len(data.recordings[0].outputs)
    noise = [Variable("e", data.output + 1 if outputs > 1 else 0, lag) for lag in lags]
    products = (
        Term.product(chosen)
        for n in range(1, degree + 1)
        for chosen in combinations_with_replacement([*data.table.variables, *noise], n)
    )
    return TermTable(tuple(term for term in products if any(v.kind == "e" for v, _ in term.factors)))


def _spread(data: Regression, noise: Array) -> tuple[Array, ...]:
    """Return e of all fitted samples as one array a recording, shape (n_outputs, n), zero elsewhere."""
    spread, begin = [], 0
    for record in data.recordings:
        end = begin + record.n_samples - data.first
        one = np.zeros(record.outputs.shape)
        one[data.output, data.first :] = noise[begin:end]
        spread.append(one)
        begin = end
    return tuple(spread)


def _noise_rows(data: Regression, table: TermTable, noise: Sequence[Array]) -> Array:
    """Evaluate noise terms over all fitted samples, shape (n_terms, n_samples)."""
    return np.concatenate(
        [
            table.rows(*data.scaled(record), data.first, record.n_samples, e)
            for record, e in zip(data.recordings, noise, strict=True)
        ],
        axis=1,
    )


def _covariance(
    data: Regression, table: TermTable, estimate: Estimate, rows: Array, noise: Sequence[Array]
) -> Array:
    """Return the covariance of a pseudo-linear regression."""
    slopes = _slopes(data, table, estimate.theta[-len(table.terms) :], rows, noise)
    norms = np.linalg.norm(rows, axis=1)[:, None]
    if not np.all(np.isfinite(slopes)):  # the noise model is not invertible: e grows along its own past
        return estimate.theta_cov
    z = rows / norms
    inverse = np.linalg.pinv(z @ (slopes / norms).T)
    root = inverse @ z / norms
    return np.asarray(estimate.noise_variance * (root @ root.T))


def _slopes(
    data: Regression, table: TermTable, theta: Array, rows: Array, noise: Sequence[Array]
) -> Array:
    """Return s(k) = -de(k)/dtheta = z(k) - sum_l c_l(k) s(k-l), c_l being the slope of the noise terms by e(k-l)."""
    from scipy.linalg.lapack import dtbtrs

    lags = sorted({v for v in table.variables if v.kind == "e"})
    slopes, begin = np.empty_like(rows), 0
    for record, e in zip(data.recordings, noise, strict=True):
        n = record.n_samples - data.first
        band = np.zeros((lags[-1].lag + 1, n))
        band[0] = 1.0
        for variable in lags:
            weights, parts = _derivative(table, theta, variable)
            along = weights @ parts.rows(*data.scaled(record), data.first, record.n_samples, e)
            band[variable.lag, : n - variable.lag] = along[variable.lag :]
        solved, _ = dtbtrs(band, rows[:, begin : begin + n].T, uplo="L", diag="U")
        slopes[:, begin : begin + n] = solved.T
        begin += n
    return slopes


def _derivative(table: TermTable, theta: Array, variable: Variable) -> tuple[Array, TermTable]:
    """Return coefficients and terms of the derivative of a sum of terms by one lagged signal."""
    weights, terms = [], []
    for term, value in zip(table.terms, theta, strict=True):
        power = dict(term.factors).get(variable, 0)
        if power:
            factors = list(term.expanded)
            factors.remove(variable)
            weights.append(value * power)
            terms.append(Term.product(factors))
    return np.array(weights), TermTable(tuple(terms))
