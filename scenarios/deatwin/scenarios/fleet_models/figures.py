"""The figures of `semp-fleet`, after figures 4.7 to 4.9 of the thesis, and of `svb-fleet`, after 6.11, 6.12 and its tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Fixed, Frols, NarxModel, SvbNarx, Term, ThetaPosterior
from deatwin.ident.narx.fleet.orders import DEGREES, LAGS, Plan
from deatwin.ident.narx.fleet.records import RECORDED, STEADY
from deatwin.ident.narx.posterior import regressors
from deatwin.plant import Recording
from deatwin.scenarios.fleet_models import WORDS
from deatwin.scenarios.fleet_models.results import TESTS
from deatwin.scenarios.fleet_models.study import SEMP, SHOWN, SVB, THRESHOLDS, Bench, Study
from deatwin.studies.report.drawing import Drawing, Hue, draw, legend_above, panels_of, plain_numbers, titled
from deatwin.studies.report.words import Each

Array = NDArray[np.float64]
OF_METHOD = {SEMP: Hue.BEFORE, SVB: Hue.AFTER}
STEADIEST = 6  # Number of the actuator that does not drift within its sections


def semp_drawings(study: Study) -> list[Drawing]:
    """Draw the figures of chapter 4."""
    return [_orders(study.plan), _semp(study.recorded), *correlation_tests(study, "thesis figure 4.9")]


def _orders(plan: Plan) -> Drawing:
    """Free-run error by lags and degree at the chosen sampling time."""
    errors, chosen = 100 * plan.orders[plan.chosen].means, plan.orders[plan.chosen].best
    own, of_input = {1: "y(k−1)", 2: "y(k−1), y(k−2)"}, ("u(k)", "u(k), u(k−1)", "u(k) to u(k−2)")
    names = [f"{own[output]}, {of_input[largest]}" for output, largest in LAGS]
    with draw((9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(2, 3))
        places = np.arange(len(LAGS))
        left.plot(places, errors[:, 0], "o", color=Hue.MEASURED, markersize=6)
        left.set_xticks(places, names, rotation=50, ha="right", fontsize="small")
        left.set(ylabel="mean free-run error (%)", ylim=(0, None))
        titled(left, "linear")
        for i, name in enumerate(names):
            colour, style = (Hue.AFTER, Hue.BEFORE, Hue.MARK)[LAGS[i][1]], "o-" if LAGS[i][0] == 1 else "s--"
            right.plot(DEGREES[1:], errors[i, 1:], style, color=colour, markersize=4, label=name)
        right.plot(
            DEGREES[chosen[1]], errors[chosen], "o", markersize=13, fillstyle="none", color=Hue.INK, label="taken"
        )
        right.set(xlabel="degree", yscale="log", xticks=DEGREES[1:])
        titled(right, "nonlinear")
        plain_numbers(right.yaxis, 1.0, 2.0, 5.0)
        figure.legend(loc="outside upper left", ncols=4, fontsize="small", markerscale=1)
        return WORDS.drawing(figure, "orders", factor=plan.factor)


def _semp(benches: Iterable[Bench]) -> Drawing:
    """Draw the path of each search: the effect of each added term, and the free-run error after it."""
    with draw((9.6, 7.0)) as figure:
        panels = panels_of(figure, 3, 2, "step", "share of mean y²", sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            search, found = bench.models[SEMP].search, bench.models[SEMP].model
            number, left = np.arange(1.0, search.srr_.size + 1), search.msse_ / np.mean(bench.sections[0].outputs ** 2)
            axes.plot(number, left, color=Hue.MEASURED, linewidth=1.2, label="free-run error after it, over mean y²")
            gains = np.where(search.srr_ > 0, search.srr_, np.nan)
            axes.plot(number, gains, "o", color=Hue.BEFORE, markersize=4, label="error reduction of an addition")
            pruned = np.array([bool(step.pruned) for step in search.path_])
            axes.plot(number[pruned], left[pruned], "v", color=Hue.INK, markersize=5, label="then terms were pruned")
            best = int(np.argmin(search.msse_))
            axes.plot(number[best], left[best], "o", markersize=11, fillstyle="none", color=Hue.INK, label="taken")
            for threshold in THRESHOLDS[1:]:
                axes.axhline(threshold, color=Hue.INK, linewidth=0.7, linestyle=":")
            titled(axes, f"{bench.name}: {len(found.terms)} terms")
        panels[0, 0].set(yscale="log", ylim=(3e-6, 2.0))
        legend_above(figure, panels[0, 0], 4)
        return WORDS.drawing(figure, "semp", thresholds=Each(THRESHOLDS[1:]))


def correlation_tests(study: Study, counterpart: str) -> list[Drawing]:
    """Draw the five tests of two actuators, one method beside the other, and of the same without their history."""
    return [_tests(study, number, counterpart) for number in (SHOWN, STEADIEST)]


def _tests(study: Study, number: int, counterpart: str) -> Drawing:
    bench, steady = study.recorded[number - 1], study.benches[STEADY][number - 1]
    with draw((9.6, 8.4)) as figure:
        panels = panels_of(figure, len(TESTS), len(study.methods), "lag (samples)", sharey="row")
        for axes, text in zip(panels[:, 0], TESTS.values(), strict=True):
            axes.set_ylabel(f"φ {text}")
        for column, method in zip(panels.T, study.methods, strict=True):
            found, other = bench.models[method].held_out, steady.models[method].held_out
            for axes, name in zip(column, TESTS, strict=True):
                test, without = found.test(name), other.test(name)
                axes.axhspan(-test.band, test.band, color=Hue.MEASURED, alpha=0.2, linewidth=0)
                axes.vlines(test.lags, 0, test.values, color=OF_METHOD[method], linewidth=1.6, label=RECORDED)
                axes.plot(without.lags, without.values, ".", color=Hue.INK, markersize=3, label=STEADY)
                titled(axes, f"{method}: {'fails' if test in found.failed else 'passes'}", "small")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=2, markerscale=3)
        words = {"name": bench.name, "methods": " beside ".join(study.methods), "counterpart": counterpart}
        return WORDS.drawing(figure, "tests", None, f"tests_dea{number}", **words)


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
    with draw((9.6, 6.4)) as figure:
        panels = panels_of(figure, 3, 2, "terms", "lower bound minus its maximum (nats)", sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            path = bench.models[SVB].search.path_
            terms = np.array([len(step.terms) for step in path], dtype=np.float64)
            bounds = np.array([step.lower_bound for step in path])
            best = int(np.argmax(bounds))
            axes.plot(terms, bounds - bounds[best], "o-", color=Hue.AFTER, markersize=3)
            axes.plot(terms[best], 0.0, "o", markersize=11, fillstyle="none", color=Hue.INK)
            titled(axes, f"{bench.name}: {terms[best]:.0f} of {terms[0]:.0f} terms")
        panels[0, 0].set(xscale="log", yscale="symlog", ylim=(None, 1.0))
        return WORDS.drawing(figure, "pruning")


def _posterior(bench: Bench) -> Drawing:
    """Share of each term in the next reading, with its interval, for SVB and SEMP."""
    models = {method: bench.models[method].model for method in (SVB, SEMP)}
    terms = sorted({t for model in models.values() for t in model.terms}, key=lambda term: (term.degree, term.factors))
    kinds = {SVB: (Hue.AFTER, -0.15, "the posterior"), SEMP: (Hue.BEFORE, 0.15, "least squares")}
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
        axes.axvline(0.0, color=Hue.INK, linewidth=0.8)
        axes.set_yticks(range(len(terms)), [str(term) for term in terms], fontsize="small")
        axes.set(xlabel="contribution to the reading (µm rms, sign of the parameter)", ylim=(len(terms) - 0.5, -0.5))
        axes.set_xscale("symlog", linthresh=10.0)
        legend_above(figure, axes, 2)
        return WORDS.drawing(figure, "posterior", name=bench.name)


def shares(model: NarxModel, bench: Bench) -> Array:
    """Mean and interval of each parameter times the rms of its term over the training section, (3, n_terms)."""
    size = np.sqrt(np.mean(regressors(model, bench.sections[0]) ** 2, axis=1))
    low, high = ThetaPosterior(model=model).interval().T
    return np.stack([model.theta, low, high]) * size


def _choice(choice: Choice, name: str) -> Drawing:
    order = np.argsort(choice.terms)
    terms, bounds, bound_errors = choice.terms[order], choice.bounds[order], 1e6 * choice.bound_errors[order]
    number, err_errors = np.arange(1, choice.err.size + 1), 1e6 * choice.err_errors
    counts = Each(choice.by_threshold(threshold) for threshold in THRESHOLDS)
    with draw((9.6, 5.4)) as figure:
        (left, right), below = figure.subplots(2, 2, sharex="col")
        left.plot(terms, bounds - bounds.max(), "o-", color=Hue.AFTER, markersize=3)
        left.plot(choice.by_bound, 0.0, "o", markersize=12, fillstyle="none", color=Hue.INK)
        left.set(ylabel="bound less the largest (nats)", yscale="symlog", title=f"SVB: {choice.by_bound} terms")
        right.plot(number, choice.err, "o-", color=Hue.BEFORE, markersize=3)
        for threshold in THRESHOLDS:
            right.axhline(threshold, color=Hue.INK, linewidth=0.7, linestyle=":")
        right.set(ylabel="error reduction ratio", yscale="log", title=f"FROLS: {counts:d} terms")
        finite = np.concatenate([bound_errors, err_errors])
        finite = finite[np.isfinite(finite)]
        for axes, x, errors, colour in zip(
            below, (terms, number), (bound_errors, err_errors), (Hue.AFTER, Hue.BEFORE), strict=True
        ):
            axes.plot(x, errors, "o", color=colour, markersize=3)
            axes.set(xlabel="terms", yscale="log", ylim=(0.8 * finite.min(), 1.2 * np.quantile(finite, 0.9)))
            plain_numbers(axes.yaxis, 1.0, 2.0, 5.0)
        below[0].set_ylabel("free-run error, held out (µm)")
        return WORDS.drawing(figure, "choice", name=name, counts=counts, thresholds=Each(THRESHOLDS))


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """Structures of all sizes along the two paths."""

    terms: Array  # shape (n_steps,): number of terms of each step of SVB
    bounds: Array  # shape (n_steps,): lower bound, nats
    bound_errors: Array  # shape (n_steps,): free-run error over the held-out section, m
    err: Array  # shape (n_path,): error reduction ratio of the 1st, 2nd, ... term of FROLS
    err_errors: Array  # shape (n_path,): free-run error of the first 1, 2, ... terms, m

    @property
    def by_bound(self) -> int:
        """Number of terms with the largest lower bound."""
        return int(self.terms[np.argmax(self.bounds)])

    def by_threshold(self, threshold: float) -> int:
        """Number of terms above a threshold of the error reduction ratio."""
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
