"""The figures of `svb-fleet`, after figures 6.11 and 6.12 and tables 6.4, D.1 and D.2 of the thesis."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Frols, NarxModel, SvbNarx
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.posterior import ThetaPosterior, regressors
from deatwin.ident.narx.terms import Term
from deatwin.plant.recording import Recording
from deatwin.scenarios.fleet_models import WORDS
from deatwin.scenarios.fleet_models.figures import correlation_tests
from deatwin.scenarios.fleet_models.study import SEMP, SVB, THRESHOLDS, Bench, Study
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue, filled, key_of, panels_of, plain_numbers, titled
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Each

Array = NDArray[np.float64]


def svb_drawings(study: Study, choice: Choice) -> list[Drawing]:
    """Draw the figures of chapter 6."""
    return [
        _pruning(study.recorded),
        _posterior(study.shown),
        *correlation_tests(study, "thesis figure 6.11"),
        _choice(choice, study.shown.name),
    ]


def _pruning(benches: Iterable[Bench]) -> Drawing:
    """The lower bound of every step down to one term."""
    columns: dict[str, Array] = {}
    with draw((9.6, 6.4)) as figure:
        panels = panels_of(figure, 3, 2, "terms", "lower bound less the largest (nats)", sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            path, key = bench.models[SVB].search.path_, key_of(bench.name)
            terms = np.array([len(step.terms) for step in path], dtype=np.float64)
            bounds = np.array([step.lower_bound for step in path])
            best = int(np.argmax(bounds))
            axes.plot(terms, bounds - bounds[best], "o-", color=Hue.AFTER, markersize=3)
            axes.plot(terms[best], 0.0, "o", markersize=11, fillstyle="none", color=Hue.INK)
            titled(axes, f"{bench.name}: {terms[best]:.0f} of {terms[0]:.0f} terms")
            columns |= {f"{key}_terms": terms, f"{key}_bound_nats": bounds}
        panels[0, 0].set(xscale="log", yscale="symlog", ylim=(None, 1.0))
        return WORDS.drawing(figure, "pruning", filled(columns))


def _posterior(bench: Bench) -> Drawing:
    """Share of each term in the next reading, with its interval, for SVB and SEMP."""
    models = {method: bench.models[method].model for method in (SVB, SEMP)}
    terms = sorted({t for model in models.values() for t in model.terms}, key=lambda term: (term.degree, term.factors))
    kinds = {SVB: (Hue.AFTER, -0.15, "the posterior"), SEMP: (Hue.BEFORE, 0.15, "least squares")}
    columns: dict[str, Array] = {}
    with draw((9.6, 1.4 + 0.24 * len(terms))) as figure:
        axes = figure.add_subplot()
        for method, model in models.items():
            colour, shift, source = kinds[method]
            middle, low, high = 1e6 * shares(model, bench)
            rows = np.array([terms.index(term) for term in model.terms], dtype=np.float64)
            ends = (middle - low, high - middle)
            label = f"{method}, 95 % interval of {source}"
            axes.errorbar(
                middle, rows + shift, xerr=ends, fmt="o", color=colour, markersize=4, elinewidth=2.0, label=label
            )
            columns |= {
                f"{method}_row": rows,
                f"{method}_um": middle,
                f"{method}_low_um": low,
                f"{method}_high_um": high,
            }
        axes.axvline(0.0, color=Hue.INK, linewidth=0.8)
        axes.set_yticks(range(len(terms)), [str(term) for term in terms], fontsize="small")
        axes.set(xlabel="share in the next reading (µm rms, sign of the parameter)", ylim=(len(terms) - 0.5, -0.5))
        axes.set_xscale("symlog", linthresh=10.0)
        legend_above(figure, axes, 2)
        return WORDS.drawing(figure, "posterior", filled(columns), name=bench.name)


def shares(model: NarxModel, bench: Bench) -> Array:
    """Mean and interval of each parameter times the rms of its term over the training section. Shapes: returns (3,
    n_terms).
    """
    size = np.sqrt(np.mean(regressors(model, bench.sections[0]) ** 2, axis=1))
    low, high = ThetaPosterior(model=model).interval().T
    return np.stack([model.theta, low, high]) * size


def _choice(choice: Choice, name: str) -> Drawing:
    order = np.argsort(choice.terms)
    terms, bounds, bound_errors = choice.terms[order], choice.bounds[order], 1e6 * choice.bound_errors[order]
    number, err_errors = np.arange(1, choice.err.size + 1), 1e6 * choice.err_errors
    counts = Each(choice.by_threshold(threshold) for threshold in THRESHOLDS)
    columns = {
        "svb_terms": terms,
        "svb_bound_nats": bounds,
        "svb_free_run_um": bound_errors,
        "fro_terms": number.astype(np.float64),
        "fro_err": choice.err,
        "fro_free_run_um": err_errors,
    }
    with draw((9.6, 5.4)) as figure:
        (left, right), below = figure.subplots(2, 2, sharex="col")
        left.plot(terms, bounds - bounds.max(), "o-", color=Hue.AFTER, markersize=3)
        left.plot(choice.by_bound, 0.0, "o", markersize=12, fillstyle="none", color=Hue.INK)
        left.set(ylabel="bound less the largest (nats)", yscale="symlog", title=f"SVB: {choice.by_bound} terms")
        right.plot(number, choice.err, "o-", color=Hue.BEFORE, markersize=3)
        for threshold in THRESHOLDS:
            right.axhline(threshold, color=Hue.INK, linewidth=0.7, linestyle=":")
        right.set(ylabel="error reduction ratio", yscale="log", title=f"FRO: {counts:d} terms")
        finite = np.concatenate([bound_errors, err_errors])
        finite = finite[np.isfinite(finite)]
        for axes, x, errors, colour in zip(
            below, (terms, number), (bound_errors, err_errors), (Hue.AFTER, Hue.BEFORE), strict=True
        ):
            axes.plot(x, errors, "o", color=colour, markersize=3)
            axes.set(xlabel="terms", yscale="log", ylim=(0.8 * finite.min(), 1.2 * np.quantile(finite, 0.9)))
            plain_numbers(axes.yaxis, 1.0, 2.0, 5.0)
        below[0].set_ylabel("free-run error, held out (µm)")
        return WORDS.drawing(figure, "choice", filled(columns), name=name, counts=counts, thresholds=Each(THRESHOLDS))


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """Structures of all sizes along the two paths."""

    terms: Array  # shape (n_steps,): number of terms of each step of SVB
    bounds: Array  # shape (n_steps,): lower bound, nats
    bound_errors: Array  # shape (n_steps,): free-run error over the held-out section, m
    err: Array  # shape (n_path,): error reduction ratio of the 1st, 2nd, ... term of FRO
    err_errors: Array  # shape (n_path,): free-run error of the first 1, 2, ... terms, m

    @property
    def by_bound(self) -> int:
        """Number of terms that the largest bound takes."""
        return int(self.terms[np.argmax(self.bounds)])

    def by_threshold(self, threshold: float) -> int:
        """Number of terms that a threshold of the error reduction ratio takes."""
        below = np.flatnonzero(self.err < threshold)
        return max(int(below[0]) if below.size else self.err.size, 1)


def compare(svb: SvbNarx, fro: Frols, training: Recording, held_out: Recording) -> Choice:
    """Follow both paths."""
    return Choice(
        terms=np.array([len(step.terms) for step in svb.path_], dtype=np.float64),
        bounds=np.array([step.lower_bound for step in svb.path_]),
        bound_errors=np.array([_error(step.terms, training, held_out) for step in svb.path_]),
        err=fro.path_err_,
        err_errors=np.array([_error(fro.path_[:k], training, held_out) for k in range(1, len(fro.path_) + 1)]),
    )


def _error(terms: tuple[Term, ...], training: Recording, held_out: Recording) -> float:
    run = Fixed(terms=terms).fit(training).model_.simulate(held_out)
    return run.rms_error if run.status.ok else np.inf
