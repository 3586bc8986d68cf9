"""The search of `Grow` on one part of the recordings: a linear model, growth, and pruning."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.narx.criteria import split
from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.forward import forward_selection
from deatwin.ident.narx.identifier import Progress
from deatwin.ident.narx.joined import Joined
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.refine import extensions, prunings
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term, Variable
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_ORDER = 2  # order of the linear model at the start: one resonance, or two time constants
# Growth exceeds the allowed number of terms by half, so that pruning can exchange terms that were added too early: a
# choice of effort, which costs half as much time again.
_BEYOND = 1.5
_ROUNDING = 1e-12  # share of the output below which errors, of exact recordings, are equal, so that fewer terms decide


@dataclass(frozen=True, kw_only=True)
class GrowStep:
    """Model after one step of `Grow`, and the terms that this step added or removed.

    Parameters
    ----------
    added : tuple of Term
        Terms added in this step. In the first step, all terms of the linear model.
    pruned : tuple of Term
        Terms removed in this step.
    terms : tuple of Term
        Terms of the model after this step.
    error : float
        Rms free-run error on the samples that are not held out, in the output's unit; infinite if the run diverges.
    held_out_error : float
        Rms free-run error on the held-out samples, in the output's unit; infinite if the run diverges.
    """

    added: tuple[Term, ...]
    pruned: tuple[Term, ...]
    terms: tuple[Term, ...]
    error: float
    held_out_error: float


class GrowSearch:
    """The search on recordings of one output; after an interrupt, which the caller receives, its results are kept."""

    def __init__(self, data: Regression, *, max_terms: int, held_out: float) -> None:
        self.max_terms = max_terms
        beginnings, self.held_out = split(data.recordings, held_out, data.first)
        self.data = replace(data, recordings=beginnings)
        self.data.require_samples_for(self.max_terms + 1)
        self.models: list[NarxModel] = []
        self.path: list[GrowStep] = []

    def run(self, progress: Progress) -> None:
        """Grow a model beyond the terms allowed, and prune it again."""
        start, recordings = linear_start(self.data), self.data.recordings
        most = max(min(int(_BEYOND * self.max_terms), self.data.n_samples - 1), len(start.terms))
        for larger in extensions(start, recordings, self.data.table.terms, max_terms=most):
            share = (len(larger.terms) - len(start.terms)) / max(most - len(start.terms), 1)
            self._take(larger, 0.5 * share, progress)
        turn = self.models[-1]
        for smaller in prunings(turn, recordings, n_terms=1):
            if smaller.terms != turn.terms:
                self._take(smaller, 1.0 - 0.5 * len(smaller.terms) / len(turn.terms), progress)

    def best(self) -> NarxModel | None:
        """Return the model within the allowed number of terms that simulates held-out samples best; None if all fail."""
        allowed = [
            (max(step.held_out_error, _ROUNDING * self.data.output_scale), len(step.terms), number)
            for number, step in enumerate(self.path)
            if len(step.terms) <= self.max_terms and np.isfinite(step.held_out_error)
        ]
        return self.models[min(allowed)[2]] if allowed else None

    def _take(self, model: NarxModel, share: float, progress: Progress) -> None:
        """Add a model to the path."""
        before = self.path[-1].terms if self.path else ()
        self.models.append(model)
        self.path.append(
            GrowStep(
                added=tuple(term for term in model.terms if term not in before),
                pruned=tuple(term for term in before if term not in model.terms),
                terms=model.terms,
                error=run_error(model, self.data.recordings),
                held_out_error=run_error(model, self.held_out),
            )
        )
        progress(share, f"{len(model.terms)} terms, free-run error {self.path[-1].error:.4g} rms")


def run_error(model: NarxModel, recordings: tuple[Recording, ...]) -> float:
    """Return the root mean square of the free-run error over recordings; infinite if a run diverges."""
    joined = Joined.of(model, recordings)
    run, failed = joined.run(model)
    if failed is not None:
        return float("inf")
    return float(np.sqrt(np.mean((joined.outputs - run)[0, joined.samples(model.table.max_lag)] ** 2)))


def linear_start(data: Regression) -> NarxModel:
    """Return the linear model of second order by least squares, with poles inside the unit circle."""
    first: dict[tuple[str, int], int] = {}
    for variable in data.table.variables:
        first[variable.kind, variable.channel] = min(
            variable.lag, first.get((variable.kind, variable.channel), variable.lag)
        )

    def of_order(variable: Variable) -> bool:
        return variable.shape is None and variable.lag <= max(
            _ORDER, first[variable.kind, variable.channel] + _ORDER - 1
        )

    linear = [i for i, term in enumerate(data.table.terms) if term.degree <= 1 and all(map(of_order, term.expanded))]
    if not any(data.table.terms[i].degree for i in linear):
        raise ModelError(
            "Grow begins with a linear model, and the rule leaves no linear candidate; allow y(k-1) and u(k-1), which "
            "pruning can take out again"
        )
    regression = data.only(linear)
    chosen = sorted(step.candidate for step in forward_selection(*regression.matrix(), len(linear)))
    if not chosen:
        raise ModelError(
            "neither inputs nor outputs move in the part on which Grow learns, which is the first of each recording; cut "
            "the rest at its beginning"
        )
    regression = regression.only(chosen)
    found = least_squares(*regression.matrix())
    return regression.model(
        _stable(found.theta, regression), found.theta_cov, found.noise_variance, identifier="linear start"
    )


def _stable(theta: Array, data: Regression) -> Array:
    """Return parameters for which the slowest pole decays within the samples, by scaling all poles with one factor."""
    lags = np.array([sum(v.lag for v in term.expanded if v.kind == "y") for term in data.table.terms])
    polynomial = np.zeros(lags.max() + 1)
    polynomial[0] = 1.0
    np.subtract.at(polynomial, lags[lags > 0], theta[lags > 0])
    radius = np.abs(np.roots(polynomial)).max(initial=0.0)
    largest = np.exp(-1.0 / data.n_samples)
    return theta * (largest / radius) ** lags if radius > largest else theta
