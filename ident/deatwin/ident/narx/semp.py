"""Simulation-error minimisation with pruning (SEMP): terms are judged by the free run of the model they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.free_run import March
from deatwin.ident.narx.identifier import FitStatus, NarxIdentifier, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.neighbours import CompressedRegression, Neighbours
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Lags, Rule, Term
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Semp", "SempStep"]

Array = NDArray[np.float64]

_DIVERGED = 1e3  # times the largest output, as for the free run of a trained model
# Ten to thirty sections are enough to know the variance of a mean, and long enough to be independent of each other
# (Schmeiser, Oper. Res. 30 (1982) 556-568, doi:10.1287/opre.30.3.556).
_SECTIONS = 20
_STEPS = 4  # times max_terms: a search that still turns terms over then goes nowhere


@dataclass(frozen=True, kw_only=True)
class SempStep:
    """One step of the search: a term added, and those pruned thereupon.

    Parameters
    ----------
    added : Term
        The term that was added.
    pruned : tuple of Term
        The terms that were then taken out.
    terms : tuple of Term
        The terms after the step.
    srr : float
        Simulation error reduction ratio of the addition: by what share of the mean square of the output the mean
        squared simulation error fell.
    msse : float
        Mean squared simulation error after the step, square of the output's unit.
    """

    added: Term
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

    - Simulation errors are compared by a paired t test on the sums over about twenty sections of the record. Only what
      is better at this level counts as better; among candidates that simulate as well as the best of them, the one that
      lowers the one-step error most is added. It may not make the free run worse than that of the best model so far.
    - A term is a candidate only if it lowers the one-step error significantly (F test, the level divided by the number
      of candidates that compete), and is pruned when it does so no longer and the free run is not worse without it.

    The search ends when no candidate is left, at ``max_terms``, or when the largest SRR is below ``threshold``.

    Parameters
    ----------
    output_lags, input_lags : int or sequence of int
        A number n for the lags 1..n, or the lags themselves (an input lag may be 0), in samples.
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

    Attributes
    ----------
    model_ : NarxModel
        The identified model, in physical units; ``theta_cov`` is ``sigma^2 (P'P)^-1``.
    terms_ : tuple of Term
        Its terms.
    path_ : tuple of SempStep
        The steps of the search.
    srr_ : ndarray, shape (n_steps,)
        Simulation error reduction ratio of each addition, dimensionless.
    msse_ : ndarray, shape (n_steps,)
        Mean squared simulation error after each step, square of the output's unit.

    References
    ----------
    Piroddi, Spinelli, "An identification algorithm for polynomial NARX models based on simulation error minimization",
    Int. J. Control 76 (2003) 1767-1781, doi:10.1080/00207170310001635419. The tests are not from there.
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
        level: float = 0.05,
        significance: float | None = 0.01,
    ) -> None:
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.degree = degree
        self.rule = rule
        self.max_terms = max_terms
        self.threshold = threshold
        self.level = level
        self.significance = significance

    def _check(self) -> None:
        if self.max_terms < 1:
            raise ModelError(f"max_terms = {self.max_terms}; it must be at least 1")
        if not 0 < self.level <= 0.5:
            raise ModelError(f"level = {self.level}; it must lie above 0 and not above 0.5")
        if self.significance is not None and not 0 < self.significance < 1:
            raise ModelError(f"significance = {self.significance}; it must lie between 0 and 1, or be None")

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        if data.n_samples <= self.max_terms + 1:
            raise ModelError(
                f"{data.n_samples} usable samples are too few for up to {self.max_terms} terms; "
                f"at least {self.max_terms + 2} are needed"
            )
        search = _Search(self, data)
        try:
            while search.advance():
                share = len(search.chosen) / self.max_terms
                error = search.path[-1].msse ** 0.5
                progress(min(share, 1.0), f"{len(search.chosen)} terms, free-run error {error:.4g} rms")
        except KeyboardInterrupt:
            if not search.path:
                raise
            self.status_ = FitStatus.INTERRUPTED
        if not search.path:
            raise ModelError("no candidate alone makes a model whose free run stays finite")
        self.path_ = tuple(search.path)
        self.srr_ = np.array([step.srr for step in search.path])
        self.msse_ = np.array([step.msse for step in search.path])
        kept = data.only([data.table.terms.index(term) for term in search.path[-1].terms])
        self.terms_ = kept.table.terms
        found = least_squares(*kept.matrix())
        return kept.model(found.theta, found.theta_cov, found.noise_variance, identifier=self)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the simulation error reduction ratio of each addition, and the threshold.

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
        labels = [f"+ {step.added}" + "".join(f"\n− {term}" for term in step.pruned) for step in self.path_]
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
        self.errors = self.best = np.array([self.power])  # of the present model, and of that which simulates best so far
        self.seen = {frozenset[int]()}

    def advance(self) -> bool:
        """Add a term and prune; tell whether that led to a new model."""
        if max(len(self.chosen), len(self.path) / _STEPS) >= self.settings.max_terms:
            return False
        before = self.errors
        added = self._add()
        if added is None:
            return False
        srr = float(before.sum() - self.errors.sum()) / self.power
        pruned = self._prune(before)
        if frozenset(self.chosen) in self.seen:
            return False
        self.seen.add(frozenset(self.chosen))
        terms = self.data.table.terms
        self.path.append(
            SempStep(
                added=terms[added],
                pruned=tuple(terms[i] for i in pruned),
                terms=tuple(terms[i] for i in self.chosen),
                srr=srr,
                msse=float(self.errors.sum()) / self.data.n_samples * self.data.output_scale**2,
            )
        )
        return True

    def _add(self) -> int | None:
        """Add the candidate whose model simulates best; return it, or None."""
        models = self.regression.larger(self.chosen)
        if self.chosen:
            models = models.only(models.f_ratio >= self._critical(models))
        models, errors = self._simulated(models)
        if not models.candidate.size:
            return None
        totals = errors.sum(axis=1)
        first = int(np.argmin(totals))
        equal = ~self._worse(errors, errors[first])
        if self.chosen:
            equal &= ~self._worse(errors, self.best) & (totals != self.errors.sum())
        if not equal.any():
            return None
        choice = int(np.argmax(np.where(equal, models.f_ratio, -1.0)))
        threshold = self.settings.threshold
        if self.chosen and threshold is not None and self.errors.sum() - totals[choice] < threshold * self.power:
            return None
        self._take(models, errors, choice)
        return int(models.candidate[choice])

    def _prune(self, before: Array) -> list[int]:
        """Take out terms that are idle, or without which the model simulates better than before; return them."""
        pruned: list[int] = []
        while len(self.chosen) > 1:
            models, errors = self._simulated(self.regression.smaller(self.chosen))
            new = np.array([frozenset(chosen.tolist()) not in self.seen for chosen in models.chosen], dtype=bool)
            idle = new & (models.f_ratio < self._critical(models)) & ~self._worse(errors, self.best)
            better = new & self._worse(before, errors)
            if idle.any():
                choice = int(np.argmin(np.where(idle, models.f_ratio, np.inf)))
            elif better.any():
                choice = int(np.argmin(np.where(better, errors.sum(axis=1), np.inf)))
            else:
                break
            pruned.append(int(models.candidate[choice]))
            self._take(models, errors, choice)
        return pruned

    def _take(self, models: Neighbours, errors: Array, choice: int) -> None:
        """Go on to one of the models."""
        self.chosen = models.chosen[choice].tolist()
        if len(self.best) != errors.shape[1] or errors[choice].sum() < self.best.sum():
            self.best = errors[choice]
        self.errors = errors[choice]

    def _simulated(self, models: Neighbours) -> tuple[Neighbours, Array]:
        """Run models free; return those that do not diverge, and their errors, shape (n_models, n_sections)."""
        errors = np.concatenate(
            [
                march.squared_errors(models.chosen, models.theta, limit=_DIVERGED, sections=sections)
                for march, sections in zip(self.marches, self.sections, strict=True)
            ],
            axis=1,
        )
        finite = np.isfinite(errors).all(axis=1)
        return models.only(finite), errors[finite]

    def _worse(self, errors: Array, than: Array) -> NDArray[np.bool_]:
        """Whether errors are larger, by a paired t test over the sections."""
        from scipy import stats

        difference = errors - than
        n = difference.shape[-1]
        spread = difference.std(axis=-1, ddof=1) / np.sqrt(n)
        worse: NDArray[np.bool_] = difference.mean(axis=-1) > stats.t.isf(self.settings.level, n - 1) * spread
        return worse

    def _critical(self, models: Neighbours) -> float:
        """Return the F ratio that the best of the false candidates exceeds with the given probability."""
        from scipy import stats

        if self.settings.significance is None:
            return 0.0
        competing = len(self.regression.rows) - (self.regression.n_samples - models.freedom - 1)
        return float(stats.f.isf(self.settings.significance / competing, 1, models.freedom))
