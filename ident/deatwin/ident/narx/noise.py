"""Noise models: noise terms are added to the process terms of any identifier, which gives a NARMAX model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from itertools import combinations_with_replacement

import numpy as np

from deatwin.ident.arguments import one_of, positive, whole_number
from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.forward import CRITERIA, criterion_values, forward_selection
from deatwin.ident.narx.identifier import FitStatus, NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.prediction_error import NoiseFit, noise_rows, prediction_error_fit, spread
from deatwin.ident.narx.regression import Recordings, Regression
from deatwin.ident.narx.terms import ChannelLags, Term, TermTable, Variable, channel_numbers, lag_list, require_terms
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError


@dataclass(eq=False, repr=False)
class Narmax(NarxIdentifier):
    """Add a noise model to a process model, to obtain y(k) = f(y, u) + g(y, u, e) + e(k).

    The terms of f are called process terms, and those of g, which contain e(k-l), noise terms. Another identifier
    chooses the process terms. The noise terms are either given, or chosen by their error reduction ratio (`Frols`). For
    this choice, e is first estimated as the residual of a model with many more lags than the process model.

    The parameters of all terms are then estimated together, by the smallest sum of squared prediction errors. If the
    noise terms are chosen, choice and estimation are repeated once with the resulting e. If the noise is coloured, the
    noise model removes the bias of the process parameters and corrects their confidence intervals.

    If white noise is added to the readings of a plant ``A(q) y = f(u)``, the noise model has the coefficients of A. The
    noise terms e(k-1) to e(k-n) then correspond to the process terms y(k-1) to y(k-n).

    Parameters
    ----------
    process : NarxIdentifier
        Identifier that chooses the process terms, as ``Frols(output_lags=4)`` or ``Fixed(terms=["y(k-1)", "u(k-1)"])``.
        A fit does not change it.
    noise_terms : sequence of Term or str, or mapping of str to such sequences, optional
        Noise terms, as ``["e(k-1)", "e(k-2)"]``. For several outputs, the noise terms of each equation, as
        ``{"y1": ["e1(k-1)"], "y2": []}``. If omitted, they are chosen according to the next four arguments.
    noise_lags : int or sequence of int
        Lags of e in samples: a number n for 1..n, or a list of lags.
    noise_degree : int
        Largest degree of a noise term. If it is 2 or larger, the candidates include products of lagged e with each
        other and with the lagged signals of the process candidates.
    max_noise_terms : int
        Largest number of noise terms.
    criterion : str
        Criterion that decides the number of noise terms, which may be 0: "ebic", "bic" or "aic", as in `Frols`. "none"
        keeps ``max_noise_terms`` terms.
    tolerance : float
        The estimation has converged when an undamped Gauss-Newton step changes e by less than this share of the rms
        value of e.
    max_iterations : int
        Largest number of iterations of an estimation.

    Attributes
    ----------
    model_ : NarxModel
        Model with the process terms followed by the noise terms, in physical units. Its free run sets e to zero.
    process_ : NarxIdentifier
        Fitted identifier of the process terms.
    noise_terms_ : tuple of Term
        Noise terms, given or chosen.
    status_ : FitStatus
        Outcome of the fit; ``NOT_CONVERGED`` if the estimation did not converge.
    changes_ : ndarray, shape (n_iterations,)
        Rms change of e that the undamped Gauss-Newton step of each iteration would cause, divided by the rms value of
        e.

    References
    ----------
    Billings, "Nonlinear System Identification: NARMAX Methods in the Time, Frequency, and Spatio-Temporal Domains"
    (2013), chapter 3, doi:10.1002/9781118535561.
    Ljung, "System Identification: Theory for the User", 2nd ed. (1999), chapters 7 and 10 (prediction errors) and 9
    (their covariance).

    Examples
    --------
    >>> import numpy as np
    >>> from deatwin.ident.narx.fixed import Fixed
    >>> from deatwin.plant.recording import Recording
    >>> rng = np.random.default_rng(0)
    >>> u, clean = rng.normal(size=2000), np.zeros(2000)
    >>> for k in range(1, 2000):
    ...     clean[k] = 0.8 * clean[k - 1] + u[k - 1]
    >>> readings = Recording.from_arrays(u, clean + rng.normal(size=2000), 1.0)
    >>> narmax = Narmax(Fixed(terms=["y(k-1)", "u(k-1)"]), noise_terms=["e(k-1)"]).fit(readings)
    >>> {str(term): round(value, 1) for term, value in zip(narmax.model_.terms, narmax.model_.theta.tolist())}
    {'y(k-1)': 0.8, 'u(k-1)': 1.0, 'e(k-1)': -0.8}
    """

    process: NarxIdentifier
    _: KW_ONLY
    noise_terms: Sequence[Term | str] | Mapping[str, Sequence[Term | str]] | None = None
    noise_lags: ChannelLags = 2
    noise_degree: int = 2
    max_noise_terms: int = 5
    criterion: str = "ebic"
    tolerance: float = 1e-6
    max_iterations: int = 100

    def _check(self) -> None:
        if not isinstance(self.process, NarxIdentifier):
            raise ModelError(f"process = {self.process!r}; give an identifier, as Frols(output_lags=4)")
        self.process._check()
        if self.noise_terms is not None:
            require_terms(self.noise_terms, "noise_terms", '["e(k-1)", "e(k-2)"]')
        if not lag_list(self.noise_lags, smallest=1):
            raise ModelError("noise_lags gives no lag at all; a noise model needs e(k-1) or later")
        one_of(self.criterion, "criterion", (*CRITERIA, "none"))
        for name, least in (("noise_degree", 1), ("max_noise_terms", 0), ("max_iterations", 1)):
            whole_number(getattr(self, name), name, least)
        positive(self.tolerance, "tolerance")

    def _resting(self, data: list[Regression], model: NarxModel) -> list[Regression]:
        return data  # the origin is that of the process

    def _regression(self, recordings: Recordings, output: int) -> Regression:
        return self.process._regression(recordings, output)

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        self.process_ = self.process._fitted_clone(data, lambda share, doing: progress(0.5 * share, doing))
        self.status_ = self.process_.status_
        given = self._given(data)
        lags = lag_list(self.noise_lags, smallest=1) if given is None else (TermTable(given).max_lag,)
        process = replace(
            data.about(self.process_.model_), table=TermTable(self.process_.model_.terms), first=max(data.first, *lags)
        )
        candidates = _candidates(data, lags, self.noise_degree) if given is None else TermTable(given)
        terms: tuple[Term, ...] = ()
        fit = self._fit(process, terms)
        noise = _long_errors(process) if given is None else fit.noise
        with self._keeping():
            for share in (0.6, 0.8) if given is None else (0.6,):
                chosen = self._choose(process, candidates, noise) if given is None else given
                progress(share, f"noise model of {len(chosen)} terms")
                terms, fit = chosen, self._fit(process, chosen)
                noise = fit.noise
        self.noise_terms_, self.changes_ = terms, np.array(fit.changes)
        if self.status_ is FitStatus.DONE and not fit.converged:
            self.status_ = FitStatus.NOT_CONVERGED
        found = fit.estimate
        whole = replace(process, table=TermTable(process.table.terms + terms))
        return whole.model(found.theta, found.theta_cov, found.noise_variance, identifier=self)

    def _fit(self, process: Regression, terms: tuple[Term, ...]) -> NoiseFit:
        return prediction_error_fit(process, terms, tolerance=self.tolerance, max_iterations=self.max_iterations)

    def _given(self, data: Regression) -> tuple[Term, ...] | None:
        """Return the given noise terms of one equation; None if there are none."""
        if self.noise_terms is None:
            return None
        record = data.recordings[0]
        table = Fixed(terms=self.noise_terms)._table(record, data.output)
        own = channel_numbers(len(record.outputs))[data.output]
        for term in table.terms:
            noise = [v for v, _ in term.factors if v.kind == "e"]
            if not noise or any(v.channel != own and (v.channel, own) != (1, 0) for v in noise):
                raise ModelError(
                    f"noise term {term}: each must hold the noise e{own or ''}(k-l) of its own output, and no other"
                )
        return table.terms

    def _choose(self, process: Regression, candidates: TermTable, noise: Sequence[Array]) -> tuple[Term, ...]:
        """Choose noise terms by their error reduction ratio, after the process terms."""
        given, target = process.matrix()
        rows = noise_rows(process, candidates, noise)
        most = min(self.max_noise_terms, target.size - len(given) - 1)
        steps = list(forward_selection(rows, target, most, given=given))
        count = len(steps)
        if self.criterion != "none":
            residual = target - least_squares(given, target).theta @ given
            without = CRITERIA[self.criterion](float(np.mean(residual**2)), target.size, 0, len(candidates.terms))
            values = criterion_values(self.criterion, steps, target, len(candidates.terms))
            count = int(np.argmin([without, *values]))
        return tuple(candidates.terms[step.candidate] for step in steps[:count])


def _candidates(data: Regression, lags: tuple[int, ...], degree: int) -> TermTable:
    """Return all products of the candidates' lagged signals and of e that contain e."""
    own = channel_numbers(len(data.recordings[0].outputs))[data.output]
    noise = [Variable("e", own, lag) for lag in lags]
    plain = [v for v in data.table.variables if v.shape is None]
    products = (
        Term.product(chosen)
        for n in range(1, degree + 1)
        for chosen in combinations_with_replacement([*plain, *noise], n)
    )
    return TermTable(tuple(term for term in products if any(v.kind == "e" for v, _ in term.factors)))


def _long_errors(process: Regression) -> tuple[Array, ...]:
    """Return e, (n_outputs, n) by recording, of many lags (Hannan, Rissanen, Biometrika 69 (1982) 81-94)."""
    record = process.recordings[0]
    inputs = channel_numbers(len(record.inputs))
    shortest = min(r.n_samples for r in process.recordings)
    longest = max(1, min(max(10, 3 * process.first), shortest // 3, process.n_samples // (4 + 4 * len(inputs))))
    signals = [("y", channel_numbers(len(record.outputs))[process.output]), *(("u", number) for number in inputs)]
    lagged = [Variable(kind, number, lag) for kind, number in signals for lag in range(1, longest + 1)]
    terms = dict.fromkeys([*process.table.terms, *(Term.product([variable]) for variable in lagged)])
    table = TermTable(tuple(terms))
    long = replace(process, table=table, first=max(process.first, table.max_lag))
    rows, target = long.matrix()
    return spread(long, target - np.linalg.lstsq(rows.T, target)[0] @ rows)
