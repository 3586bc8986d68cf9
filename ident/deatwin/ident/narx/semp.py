"""Simulation-error minimisation with pruning (SEMP): terms are judged by the free run of the model they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.forward import forward_selection
from deatwin.ident.narx.free_run import March
from deatwin.ident.narx.identifier import FitStatus, NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.neighbours import CompressedRegression, Neighbours
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.response import DIVERGED
from deatwin.ident.narx.terms import Lags, Rule, Term
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Semp", "SempStep"]

Array = NDArray[np.float64]
Booleans = NDArray[np.bool_]

# Ten to thirty sections are enough to know the variance of a mean, and long enough to be independent of each other
# (Schmeiser, Oper. Res. 30 (1982) 556-568, doi:10.1287/opre.30.3.556).
_SECTIONS = 20
# A free run that goes astray in one section alone passes every test over the sections. Whatever they say, the final
# model's mean squared error is at most so many times the least of the path: a choice, far beyond what chance does.
_CLEARLY_WORSE = 2.0
_STEPS = 4  # times max_terms: a search that still turns terms over then goes nowhere


@dataclass(frozen=True, kw_only=True)
class SempStep:
    """One step of the search: a term added or exchanged, and those pruned thereupon.

    Parameters
    ----------
    added : tuple of Term
        What was added: one term; all new ones where the search went on from the model of forward regression.
    pruned : tuple of Term
        The terms that were taken out, by the exchange and by pruning.
    terms : tuple of Term
        The terms after the step.
    srr : float
        Simulation error reduction ratio of the addition: by what share of the mean square of the output the mean
        squared simulation error fell.
    msse : float
        Mean squared simulation error after the step, square of the output's unit.
    """

    added: tuple[Term, ...]
    pruned: tuple[Term, ...]
    terms: tuple[Term, ...]
    srr: float
    msse: float


class Semp(NarxIdentifier):
    """Add the term that most lowers the error of the free run, prune, and so on.

    In every step the parameters of each model with one candidate more are estimated by least squares, all these models
    are run free, and the candidate with the largest simulation error reduction ratio is added,
    ``SRR = (MSSE(M) - MSSE(M + x)) / mean(y^2)`` with the mean squared simulation error MSSE. Then terms are pruned as
    long as the model without one simulates better than the model before the addition.

    The simulation error is one number of one noisy record: among many candidates it is often lowered more by a false
    term than by the true one. Two tests therefore stand beside the published rules, and are switched off by
    ``level=0.5, significance=None``:

    - Simulation errors are compared by a paired t test on the sums over about twenty sections of the records. Only
      what is better at this level counts as better; of the candidates that simulate as well as the best of them, the
      one that lowers the one-step error most is added, if the free run is no worse with it.
    - A term is a candidate only if it lowers the one-step error significantly (F test, its level divided by the number
      of candidates that compete), and is pruned when it does so no longer and the free run is no worse without it.

    Additions end when no candidate is left, at ``max_terms``, or when the SRR is below ``threshold``. Then, which is
    not published either and is switched off by ``max_exchanges=0``, a term is exchanged for a candidate that makes the
    free run better, or the one-step error smaller and the free run no worse; and once the search goes on from that
    model of the forward regression that simulates best, if it does so better than the present one: a resonance, for
    one, cannot always be found by adding single terms to what simulates well. The model is where the search ends; or,
    where a free run went astray in a few sections only, which no test over them sees, the last step whose mean squared
    error is at most twice the least.

    Parameters
    ----------
    output_lags, input_lags : int, sequence, or mapping of str to int or sequence of int
        A number n for the lags 1..n, or the lags themselves (an input lag may be 0), in samples; for every channel, or
        for each: in order, as ``[[1, 2], [4, 5]]``, or by name, as ``{"u": [1, 2], "w": [4, 5]}``.
    degree : int
        Largest degree of a candidate.
    rule : callable, optional
        Takes a `Term` and says whether it is a candidate; see `deatwin.ident.narx.rules`.
    max_terms : int
        Largest number of terms.
    threshold : float, optional
        Least SRR of an addition, as published; dimensionless. Without it the tests alone decide.
    level : float
        One-sided level of the test between simulation errors, above 0; 0.5 takes every difference as real.
    significance : float, optional
        Probability with which any of the false candidates of a step enters a true model; None for no test.
    max_exchanges : int
        How often a term may be exchanged for a candidate when no addition is left; 0 for the published search.

    Attributes
    ----------
    model_ : NarxModel
        The identified model, in physical units; ``theta_cov`` is ``sigma^2 (P'P)^-1``.
    terms_ : tuple of Term
        Its terms.
    path_ : tuple of SempStep
        The steps of the search.
    srr_ : ndarray, shape (n_steps,)
        Simulation error reduction ratio of each step before pruning, dimensionless.
    msse_ : ndarray, shape (n_steps,)
        Mean squared simulation error after each step, square of the output's unit.

    References
    ----------
    Piroddi, Spinelli, "An identification algorithm for polynomial NARX models based on simulation error minimization",
    Int. J. Control 76 (2003) 1767-1781, doi:10.1080/00207170310001635419. Tests and exchanges are not from there.
    """

    def __init__(
        self,
        *,
        output_lags: Lags = 2,
        input_lags: Lags = 2,
        degree: int = 2,
        rule: Rule | None = None,
        max_terms: int = 15,
        threshold: float | None = None,
        level: float = 0.01,
        significance: float | None = 0.01,
        max_exchanges: int = 20,
    ) -> None:
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.degree = degree
        self.rule = rule
        self.max_terms = max_terms
        self.threshold = threshold
        self.level = level
        self.significance = significance
        self.max_exchanges = max_exchanges

    def _check(self) -> None:
        if self.max_terms < 1:
            raise ModelError(f"max_terms = {self.max_terms}; it must be at least 1")
        if self.max_exchanges < 0:
            raise ModelError(f"max_exchanges = {self.max_exchanges}; it must not be negative")
        if not 0 < self.level <= 0.5:
            raise ModelError(f"level = {self.level}; it must lie above 0 and not above 0.5")
        if self.significance is not None and not 0 < self.significance < 1:
            raise ModelError(f"significance = {self.significance}; it must lie between 0 and 1, or be None")

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        data.require_samples_for(self.max_terms + 1)
        search, share = _Search(self, data), 0.0
        try:
            while search.advance():
                share = max(share, min(len(search.chosen) / self.max_terms, 0.99))
                error = search.path[-1].msse ** 0.5
                progress(share, f"{len(search.chosen)} terms, free-run error {error:.4g} rms")
        except KeyboardInterrupt:
            if not search.path:
                raise
            self.status_ = FitStatus.INTERRUPTED
        if not search.path:
            raise ModelError("no candidate alone makes a model whose free run stays finite")
        self.path_ = tuple(search.path)
        self.srr_ = np.array([step.srr for step in search.path])
        self.msse_ = np.array([step.msse for step in search.path])
        final = [step for step in self.path_ if step.msse <= _CLEARLY_WORSE * self.msse_.min()][-1]
        kept = data.only([data.table.terms.index(term) for term in final.terms])
        self.terms_ = kept.table.terms
        found = least_squares(*kept.matrix())
        progress(1.0, f"{len(self.terms_)} terms")
        return kept.model(found.theta, found.theta_cov, found.noise_variance, identifier=self)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the simulation error reduction ratio of each step on a logarithmic axis, and the threshold.

        A step that made the simulation error larger, as the tests allow within its uncertainty, has no point.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
        axes = axes_or_new(ax)
        steps = np.arange(1, len(self.path_) + 1)
        axes.semilogy(steps, np.where(self.srr_ > 0, self.srr_, np.nan), "o-", label="SRR")
        if self.threshold is not None:
            axes.axhline(self.threshold, color="tab:red", linestyle="--", label="threshold")
        labels = [
            "\n".join([*(f"+ {term}" for term in step.added), *(f"− {term}" for term in step.pruned)])
            for step in self.path_
        ]
        axes.set_xticks(steps, labels, rotation=60, ha="right", fontsize="small")
        axes.set_ylabel("simulation error reduction ratio")
        axes.legend(loc="upper right")
        return axes


class _Search:
    """The search of `Semp`, step by step.

    Simulation errors are sums of squares over each section of the records, in squares of the scaled output.
    """

    def __init__(self, settings: Semp, data: Regression) -> None:
        self.settings = settings
        self.data = data
        self.regression = CompressedRegression.of(data)
        self.power = float(self.regression.target @ self.regression.target)
        signals = [data.scaled(record) for record in data.recordings]
        self.marches = [
            March.of(
                data.table.terms, {"u": inputs, "y": outputs}, "y", outputs[[data.output]],
                first=data.first, alone=data.output,
            )
            for inputs, outputs in signals
        ]  # fmt: skip
        wanted = min(_SECTIONS, max(2, data.n_samples // 10))
        lengths = np.array([outputs.shape[1] - data.first for _, outputs in signals])
        self.sections = np.maximum(1, np.rint(wanted * lengths / lengths.sum())).astype(int)
        self.path: list[SempStep] = []
        self.chosen: list[int] = []
        self.squares = self.power  # of the one-step errors
        self.errors = np.array([self.power])
        self.exchanges = 0
        self.restarted = False
        self.seen = {frozenset[int]()}

    def advance(self) -> bool:
        """Change the model and prune it; tell whether that was possible."""
        if len(self.path) >= _STEPS * self.settings.max_terms:
            return False
        before, old = self.errors, self.chosen
        if self._add() or self._exchange():
            rival = before
        elif self._restart():
            rival = self.errors
        else:
            return False
        srr, added = float(before.sum() - self.errors.sum()) / self.power, self.chosen
        self._prune(rival)
        self.seen.add(frozenset(self.chosen))
        terms = self.data.table.terms
        self.path.append(
            SempStep(
                added=tuple(terms[i] for i in added if i not in old),
                pruned=tuple(terms[i] for i in dict.fromkeys([*old, *added]) if i not in self.chosen),
                terms=tuple(terms[i] for i in self.chosen),
                srr=srr,
                msse=float(self.errors.sum()) / self.data.n_samples * self.data.output_scale**2,
            )
        )
        return True

    def _add(self) -> bool:
        """Add the candidate whose model simulates best."""
        if len(self.chosen) >= self.settings.max_terms:
            return False
        models = self.regression.larger(self.chosen)
        if not self.chosen:
            models, errors = self._simulated(models)
            sound = errors.sum(axis=1) < self.power
            return self._take_best(models, errors, sound if sound.any() else ~sound)
        models, errors = self._simulated(models.only(models.f_ratio >= self._critical(models.freedom)))
        enough = self._as_good(errors)
        if self.settings.threshold is not None:
            enough &= self.errors.sum() - errors.sum(axis=1) >= self.settings.threshold * self.power
        return self._take_best(models, errors, enough)

    def _exchange(self) -> bool:
        """Exchange a term for a candidate, to simulate better, or as well with a smaller one-step error."""
        if not self.chosen or self.exchanges >= self.settings.max_exchanges:
            return False
        self.exchanges += 1
        models = self.regression.exchanged(self.chosen)
        models, errors = self._simulated(models.only(models.f_ratio >= self._critical(models.freedom)))
        closer = self._as_good(errors) & (models.squares < self.squares)
        return self._take_best(models, errors, closer | self._worse(self.errors, errors))

    def _restart(self) -> bool:
        """Go on from the model of forward regression that simulates best, if it does so better than the present one."""
        if not self.settings.max_exchanges or self.restarted:
            return False
        self.restarted = True
        steps = forward_selection(self.regression.rows.copy(), self.regression.target, self.settings.max_terms)
        order: list[int] = []
        best, best_errors, left = order, np.array([np.inf]), self.power
        for step in steps:
            freedom = self.data.n_samples - len(order) - 1
            if (left - step.residual) * freedom < self._critical(freedom) * step.residual:
                break
            order, left = [*order, step.candidate], step.residual
            theta, _ = self.regression.fit(order)
            (errors,) = self._errors(np.array([order]), theta[None])
            if errors.sum() < best_errors.sum():
                best, best_errors = order, errors
        if not best or frozenset(best) in self.seen or not self._worse(self.errors, best_errors):
            return False
        self.chosen, self.errors, self.squares = best, best_errors, self.regression.fit(best)[1]
        return True

    def _prune(self, rival: Array) -> None:
        """Take out terms that are idle, or without which the model simulates better than a rival, that before."""
        while len(self.chosen) > 1:
            models, errors = self._simulated(self.regression.smaller(self.chosen))
            idle = (models.f_ratio < self._critical(models.freedom)) & self._as_good(errors)
            better = self._worse(rival, errors)
            if idle.any():
                self._take(models, errors, int(np.argmin(np.where(idle, models.f_ratio, np.inf))))
            elif better.any():
                self._take(models, errors, int(np.argmin(np.where(better, errors.sum(axis=1), np.inf))))
            else:
                return

    def _take_best(self, models: Neighbours, errors: Array, allowed: Booleans) -> bool:
        """Go on to the model that simulates best, of equally good ones to that with the least one-step error."""
        if not allowed.any():
            return False
        totals = np.where(allowed, errors.sum(axis=1), np.inf)
        equal = allowed & ~self._worse(errors, errors[np.argmin(totals)])
        self._take(models, errors, int(np.argmin(np.where(equal, models.squares, np.inf))))
        return True

    def _take(self, models: Neighbours, errors: Array, choice: int) -> None:
        """Go on to one of the models."""
        self.chosen = models.chosen[choice].tolist()
        self.errors = errors[choice]
        self.squares = float(models.squares[choice])

    def _simulated(self, models: Neighbours) -> tuple[Neighbours, Array]:
        """Run new models free; return those that do not diverge, and their errors, shape (n_models, n_sections)."""
        if models.chosen.shape[1] in map(len, self.seen):
            new = [frozenset(chosen) not in self.seen for chosen in models.chosen.tolist()]
            models = models.only(np.array(new, dtype=bool))
        errors = self._errors(models.chosen, models.theta)
        finite: Booleans = np.isfinite(errors.sum(axis=1))
        return models.only(finite), errors[finite]

    def _errors(self, chosen: NDArray[np.int64], theta: Array) -> Array:
        """Run models free; return their errors, shape (n_models, n_sections)."""
        runs = zip(self.marches, self.sections.tolist(), strict=True)
        return np.concatenate(
            [march.squared_errors(chosen, theta, limit=DIVERGED, sections=sections) for march, sections in runs],
            axis=1,
        )

    def _as_good(self, errors: Array) -> Booleans:
        """Whether errors are not larger than those of the present model, nor than those of no model.

        The test finds nothing in a run that goes wild in one section alone; such a run is worse than none.
        """
        return ~self._worse(errors, self.errors) & (errors.sum(axis=1) < self.power)

    def _worse(self, errors: Array, than: Array) -> Booleans:
        """Whether errors are larger, by a paired t test over the sections."""
        from scipy.special import stdtrit

        difference = errors - than
        n = difference.shape[-1]
        spread = difference.std(axis=-1, ddof=1) / np.sqrt(n)
        worse: Booleans = difference.mean(axis=-1) > -stdtrit(n - 1, self.settings.level) * spread
        return worse

    def _critical(self, freedom: int) -> float:
        """Return the F ratio that the best of the false candidates exceeds with the given probability."""
        from scipy.special import stdtrit

        if self.settings.significance is None:
            return 0.0
        chosen = self.data.n_samples - freedom - 1
        competing = max(len(self.regression.rows) - chosen, 1)
        return float(stdtrit(freedom, self.settings.significance / competing / 2)) ** 2  # F of 1 and n is t^2 of n
