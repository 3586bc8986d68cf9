"""Grow a model from a linear one by the free-run error: add terms, remove some again, judge on held-out samples."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.arguments import probability, whole_number
from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.forward import forward_selection, split
from deatwin.ident.narx.identifier import CandidateSearch, FitStatus, Progress
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.notes import late_inputs, noisy_products
from deatwin.ident.narx.refine import Joined, at_least_error, extensions, least_error, prunings, with_correlated_error
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term, TermTable, Variable
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_SEARCH = 0.9  # share of the progress for the search; the rest is for the refinement on all recordings
_ORDER = 2  # order of the linear model at the start: one resonance, or two time constants
_BEYOND = 1.5  # terms to grow to, relative to those allowed, so that pruning can exchange terms added too early
_ROUNDING = 1e-12  # share of the output below which errors, of exact recordings, are equal, so that fewer terms decide


@dataclass(kw_only=True, eq=False, repr=False)
class Grow(CandidateSearch):
    """Choose the terms of a NARX model by its free-run error: grow a linear model term by term, then prune it.

    The search starts from a linear model of second order. In each step, it adds the term that lowers the free-run error
    most, to first order, and then minimises this error over all parameters. It continues until the model has 1.5 times
    ``max_terms`` terms. Terms are then removed one by one, always the one whose removal raises the error least. Of all
    models on this path with at most ``max_terms`` terms, the one with the smallest free-run error on the held-out
    samples is chosen. Its parameters are then estimated on all samples.

    The parameters are unbiased if the noise is added to the readings, as in an output-error model. If the noise acts on
    the plant itself, methods that minimise the one-step error (`Frols`, `SvbNarx`) have a smaller variance.

    The confidence intervals of the parameters do not include the uncertainty of the choice of terms. In 100
    simulations of systems with ``|u|`` and with a saturation, the 95 % intervals contained 96 % of the true values if
    exactly the true terms were found, and 86 % otherwise.

    Parameters
    ----------
    output_lags, input_lags, degree, functions, rule
        Candidate terms, as in `Frols`.
    max_terms : int
        Largest number of terms.
    held_out : float
        Share of each recording, at its end, on which the models are compared.
    parts : int
        Number of parts into which each recording is cut. A model is grown on each part, and its parameters are then
        estimated on all recordings. The model with the smallest free-run error on all recordings is kept. Because the
        parts are shorter, this takes no longer than growing one model on the whole recordings.

    Attributes
    ----------
    model_ : NarxModel
        The identified model, in physical units. ``theta_cov`` is ``(S'S)^-1 S'RS (S'S)^-1`` with the sensitivities S of
        the free run to the parameters and the covariance R of the free-run error. An autoregressive model of this error
        gives R. After Ctrl-C, R is that of white noise.
    terms_ : tuple of Term
        Terms of the model.
    status_ : FitStatus
        Outcome of the search; ``NOT_CONVERGED`` if the gradient of the free-run error is not small at its end.
    path_ : tuple of GrowStep
        Steps of the growth and of the pruning, for the part whose model was kept.

    Notes
    -----
    With several outputs, the model of each output is found separately, with the measured values of the other outputs as
    its inputs.

    References
    ----------
    Ljung, "System Identification: Theory for the User", 2nd ed. (1999), sections 4.2, 9.4 and 10.3: output-error
    models, the covariance of their parameters, and the search.
    den Haan, Levin, "A practitioner's guide to robust covariance matrix estimation", Handbook of Statistics 15 (1997)
    299-342: the autoregressive model of the error.
    """

    max_terms: int = 15
    held_out: float = 1 / 3
    parts: int = 1

    def _check(self) -> None:
        for name in ("max_terms", "parts"):
            whole_number(getattr(self, name), name)
        probability(self.held_out, "held_out")

    def _learn(self, data: Regression, progress: Progress) -> NarxModel:
        single = single_output(data)
        found: list[tuple[NarxModel, GrowSearch]] = []
        search = None
        with self._keeping():
            for number, part in enumerate(self._parts(single)):
                search = GrowSearch(part, max_terms=self.max_terms, held_out=self.held_out)
                search.run(_part_of(progress, number, self.parts))
                if (grown := _refined(search.best(), part, single)) is not None:
                    found.append((grown, search))
                progress((number + 1) / self.parts, "refined on all samples")
        if not self.status_.ok and not found and search is not None and (grown := search.best()) is not None:
            found.append((grown, search))
        if not found and not self.status_.ok:
            raise KeyboardInterrupt
        if not found:
            raise ModelError(
                "no model was found whose free run stays finite on all samples; allow a lower degree or other lags"
            )
        model, search = min(found, key=lambda one: run_error(one[0], single.recordings))
        if self.status_.ok:
            with self._keeping():
                model = with_correlated_error(model, single.recordings)
                if not at_least_error(model, single.recordings):
                    self.status_ = FitStatus.NOT_CONVERGED
        named = dict(zip(single.table.terms, data.table.terms, strict=True))
        self.path_ = tuple(_renamed(step, named) for step in search.path)
        kept = data.only([single.table.terms.index(term) for term in model.terms])
        self.terms_, scale = kept.table.terms, kept.term_scales
        return kept.model(
            model.theta / scale,
            model.theta_cov / np.outer(scale, scale),
            float(model.noise_variance) / kept.output_scale**2,
            identifier=self,
        )

    def _resting(self, data: list[Regression], model: NarxModel) -> list[Regression]:
        return data  # the linear start has a constant in any case

    def _notes(self, recordings: tuple[Recording, ...]) -> tuple[str, ...]:
        """Return only the note on late inputs; a one-step error above that of least squares is intended here."""
        return noisy_products(self.model_, recordings) + late_inputs(self.model_, recordings)

    def _parts(self, data: Regression) -> list[Regression]:
        """Cut every recording into parts; the first parts form the first regression, and so on."""
        shortest = min(record.n_samples for record in data.recordings) // self.parts
        if self.parts > 1 and shortest * min(self.held_out, 1 - self.held_out) <= data.first + 1:
            raise ModelError(
                f"parts = {self.parts}: parts of {shortest} samples are too short for lags up to {data.first} with "
                f"held_out = {self.held_out:g}; take fewer parts"
            )
        lengths = [record.n_samples // self.parts for record in data.recordings]
        pairs = list(zip(data.recordings, lengths, strict=True))
        return [
            replace(data, recordings=tuple(record.section(i * n, (i + 1) * n) for record, n in pairs))
            for i in range(self.parts)
        ]


def _renamed(step: GrowStep, named: Mapping[Term, Term]) -> GrowStep:
    """Return a step with its terms replaced by others."""
    added, pruned, terms = (tuple(named[term] for term in each) for each in (step.added, step.pruned, step.terms))
    return replace(step, added=added, pruned=pruned, terms=terms)


def _part_of(progress: Progress, part: int, parts: int) -> Progress:
    """Return a progress function for one of several parts."""
    return lambda share, doing: progress((part + _SEARCH * share) / parts, doing)


def _refined(best: NarxModel | None, part: Regression, whole: Regression) -> NarxModel | None:
    """Refine a model on its part and then on all recordings; return None if there is none, or it diverges there."""
    if best is None:
        return None
    with suppress(ModelError):
        return least_error(least_error(best, part.recordings), whole.recordings)
    return None


def single_output(data: Regression) -> Regression:
    """Return the same regression, term by term, for a single output, which can be simulated alone."""
    if len(data.recordings[0].outputs) == 1:
        return data
    n_inputs, own = len(data.recordings[0].inputs), data.output

    def renamed(variable: Variable) -> Variable:
        if variable.kind == "u":
            return replace(variable, channel=variable.index + 1)
        if variable.index == own:
            return replace(variable, channel=0)
        return replace(variable, kind="u", channel=n_inputs + 1 + variable.index - (variable.index > own))

    terms = tuple(Term.product(map(renamed, term.expanded)) for term in data.table.terms)
    regression = replace(
        data, table=TermTable(terms), recordings=tuple(_apart(record, own) for record in data.recordings), output=0
    )
    if data.input_origin is None or data.output_origin is None:
        return regression
    others = np.delete(data.output_origin, own)
    return replace(
        regression,
        input_origin=np.concatenate([data.input_origin, others]),
        output_origin=data.output_origin[own : own + 1],
    )


def _apart(record: Recording, own: int) -> Recording:
    """Return a recording of one output, with the other outputs after its inputs."""
    return Recording.from_arrays(
        np.concatenate([record.inputs, np.delete(record.outputs, own, axis=0)]),
        record.outputs[own],
        record.sample_time,
        start=record.start,
        provenance=record.provenance,
    )


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
    for v in data.table.variables:
        first[v.kind, v.channel] = min(v.lag, first.get((v.kind, v.channel), v.lag))

    def of_order(v: Variable) -> bool:
        return v.shape is None and v.lag <= max(_ORDER, first[v.kind, v.channel] + _ORDER - 1)

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
