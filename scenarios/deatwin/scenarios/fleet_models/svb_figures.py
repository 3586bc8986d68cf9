"""The figures of `svb-fleet`, after figures 6.11 and 6.12 and tables 6.4, D.1 and D.2 of the thesis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.posterior import ThetaPosterior, regressors
from deatwin.ident.narx.predictive import free_run_band
from deatwin.scenarios.fleet_models.choice import THRESHOLDS, Choice
from deatwin.scenarios.fleet_models.figures import (
    STEADIEST,
    Columns,
    correlation_tests,
    filled,
    free_runs,
    key_of,
    plain_numbers,
)
from deatwin.scenarios.fleet_models.study import SEMP, SVB, Bench, Study
from deatwin.scenarios.fleet_models.tables import SHOWN
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import COLOURS, draw, legend_above

Array = NDArray[np.float64]
INK, MEASURED, BEFORE, AFTER = (COLOURS[role][0] for role in ("ink", "measured", "before", "after"))
DRAWS = 200
"""Of the posterior, for the band of free runs."""


def svb_drawings(study: Study, choice: Choice, seed: int) -> tuple[list[Drawing], dict[str, Columns]]:
    """Draw the figures of chapter 6."""
    rng = np.random.default_rng(seed)
    bands = {
        bench.name: free_run_band(bench.models[SVB].model, bench.sections[1], rng, n_draws=DRAWS)
        for bench in study.recorded
    }
    made = [
        _pruning(study.recorded),
        _posterior(study.recorded[SHOWN - 1]),
        free_runs(study.recorded, study.methods, bands),
        *(correlation_tests(study, number, "thesis figure 6.11") for number in (SHOWN, STEADIEST)),
        _choice(choice, study.recorded[SHOWN - 1].name),
    ]
    return [drawing for drawing, _ in made], {drawing.data: columns for drawing, columns in made}


def _pruning(benches: tuple[Bench, ...]) -> tuple[Drawing, Columns]:
    """The lower bound of every step down to one term."""
    columns: dict[str, Array] = {}
    with draw((9.6, 6.4)) as figure:
        panels = figure.subplots(3, 2, sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            path = bench.models[SVB].search.path_
            terms = np.array([len(step.terms) for step in path], dtype=np.float64)
            bounds = np.array([step.lower_bound for step in path])
            best = int(np.argmax(bounds))
            axes.plot(terms, bounds - bounds[best], "o-", color=AFTER, markersize=3)
            axes.plot(terms[best], 0.0, "o", markersize=11, fillstyle="none", color=INK)
            axes.set_title(f"{bench.name}: {terms[best]:.0f} of {terms[0]:.0f} terms", loc="left", fontsize="medium")
            columns |= {f"{key_of(bench)}_terms": terms, f"{key_of(bench)}_bound_nats": bounds}
        panels[0, 0].set(xscale="log", yscale="symlog", ylim=(None, 1.0))
        for axes in panels[-1]:
            axes.set_xlabel("terms")
        figure.supylabel("lower bound less the largest (nats)", fontsize="medium")
        drawing = Drawing.of(
            figure,
            "pruning",
            "How many terms the lower bound keeps",
            "Read from the right: all candidates are fitted, those of the least relevance are pruned, down to one "
            "term. The step of the largest bound is taken (circle). No section that is held out has a say.",
        )
    return drawing, filled(columns)


def _posterior(bench: Bench) -> tuple[Drawing, Columns]:
    """What each term adds to the next reading, with its interval, beside the same of SEMP."""
    models = {method: bench.models[method].model for method in (SVB, SEMP)}
    terms = sorted({t for model in models.values() for t in model.terms}, key=lambda term: (term.degree, term.factors))
    place = {term: row for row, term in enumerate(terms)}
    columns: dict[str, Array] = {}
    with draw((9.6, 1.4 + 0.24 * len(terms))) as figure:
        axes = figure.add_subplot()
        for (method, model), colour, shift in zip(models.items(), (AFTER, BEFORE), (-0.15, 0.15), strict=True):
            middle, low, high = 1e6 * shares(model, bench)
            rows = np.array([place[term] for term in model.terms])
            interval = "95 % interval of the posterior" if method == SVB else "95 % interval of least squares"
            axes.errorbar(
                middle,
                rows + shift,
                xerr=(middle - low, high - middle),
                fmt="o",
                color=colour,
                markersize=4,
                elinewidth=2.0,
                label=f"{method}, {interval}",
            )
            columns |= {
                f"{method}_row": rows.astype(np.float64),
                f"{method}_um": middle,
                f"{method}_low_um": low,
                f"{method}_high_um": high,
            }
        axes.axvline(0.0, color=INK, linewidth=0.8)
        axes.set_yticks(range(len(terms)), [str(term) for term in terms], fontsize="small")
        axes.set(xlabel="share in the next reading (µm rms, sign of the parameter)", ylim=(len(terms) - 0.5, -0.5))
        axes.set_xscale("symlog", linthresh=10.0)
        legend_above(figure, axes, 2)
        drawing = Drawing.of(
            figure,
            "posterior",
            f"{bench.name}: what SVB and SEMP keep, and how well they know it",
            "Each parameter times the root mean square of its term over the training section. Terms are products of "
            "the same few signals, so that large shares of either sign cancel. Both intervals take the structure for "
            "true and the residual for white. A row without a point is a term that the other method kept.",
        )
    return drawing, filled(columns)


def shares(model: NarxModel, bench: Bench) -> Array:
    """What each term adds to the next reading over the training section. Shapes: returns (3, n_terms)."""
    size = np.sqrt(np.mean(regressors(model, bench.sections[0]) ** 2, axis=1))
    low, high = ThetaPosterior(model=model).interval().T
    return np.stack([model.theta, low, high]) * size


def _choice(choice: Choice, name: str) -> tuple[Drawing, Columns]:
    with draw((9.6, 5.4)) as figure:
        (left, right), (below_left, below_right) = figure.subplots(2, 2, sharex="col")
        order = np.argsort(choice.terms)
        terms, bounds = choice.terms[order], choice.bounds[order]
        left.plot(terms, bounds - bounds.max(), "o-", color=AFTER, markersize=3)
        left.plot(choice.by_bound, 0.0, "o", markersize=12, fillstyle="none", color=INK)
        left.set(ylabel="bound less the largest (nats)", yscale="symlog", title=f"SVB: {choice.by_bound} terms")
        below_left.plot(terms, 1e6 * choice.bound_errors[order], "o", color=AFTER, markersize=3)
        number = np.arange(1, choice.err.size + 1)
        right.plot(number, choice.err, "o-", color=BEFORE, markersize=3)
        for threshold in THRESHOLDS:
            right.axhline(threshold, color=INK, linewidth=0.7, linestyle=":")
        counts = ", ".join(str(choice.by_threshold(t)) for t in THRESHOLDS)
        right.set(ylabel="error reduction ratio", yscale="log", title=f"FRO: {counts} terms")
        below_right.plot(number, 1e6 * choice.err_errors, "o", color=BEFORE, markersize=3)
        finite = 1e6 * np.concatenate([choice.bound_errors, choice.err_errors])
        finite = finite[np.isfinite(finite)]
        for axes in (below_left, below_right):
            axes.set(xlabel="terms", yscale="log", ylim=(0.8 * finite.min(), 1.2 * np.quantile(finite, 0.9)))
            plain_numbers(axes)
        below_left.set_ylabel("free-run error, held out (µm)")
        drawing = Drawing.of(
            figure,
            "choice",
            "The lower bound against the error reduction ratio as the choice (thesis figure 6.12)",
            f"{name}. Left: the bound has a largest value (circle). Right: the ratio has none, and the number of terms "
            f"is that of the threshold: {counts} for {', '.join(f'{t:g}' for t in THRESHOLDS)} (dotted). Below: what "
            "the free run makes of each number, which neither looks at; a point is missing where it diverges.",
        )
    columns = {
        "svb_terms": terms,
        "svb_bound_nats": bounds,
        "svb_free_run_um": 1e6 * choice.bound_errors[order],
        "fro_terms": number.astype(np.float64),
        "fro_err": choice.err,
        "fro_free_run_um": 1e6 * choice.err_errors,
    }
    return drawing, filled(columns)
