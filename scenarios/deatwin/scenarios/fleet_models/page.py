"""Goals, values reached, tables after 4.1 to 4.3, 6.4, B.1, D.1 and D.2 of the thesis, and figures after 4.7 to 4.9 and 6.11 and 6.12."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from deatwin.ident.frequency.dc import deviations, remove
from deatwin.ident.narx import (
    Fixed,
    Frols,
    Narmax,
    NarxModel,
    Ridge,
    SvbNarx,
    Term,
    ThetaPosterior,
    TotalLeastSquares,
    Validation,
    one_step_band,
    refine,
)
from deatwin.ident.narx.fleet import DEGREES, FILM, LAGS, RECORDED, STEADY, VARIANTS, Plan
from deatwin.ident.narx.posterior import regressors
from deatwin.plant import ModelError, Recording
from deatwin.plant.arrays import Array
from deatwin.plant.drawing import plain_numbers
from deatwin.scenarios.fleet_models import WORDS
from deatwin.scenarios.fleet_models.study import FROLS, LINEAR, SEMP, SHOWN, SVB, THRESHOLDS, Bench, Identified, Study
from deatwin.studies.report.drawing import Drawing, Hue, draw, legend_above, panels_of, titled
from deatwin.studies.report.quantities import quantity
from deatwin.studies.report.story import Measure, Table
from deatwin.studies.report.tables import parameters_by_term
from deatwin.studies.report.words import Each, Span

HALF = 0.5  # Share of the linear model's error that a nonlinear one must stay below
AS_GOOD = 1.1  # Error of SVB that is allowed, over that of SEMP
RISE = 1e-9  # Share of itself by which a lower bound may seem to fall, by rounding


def judge_semp(study: Study) -> list[Measure]:
    """Compare the models of SEMP with the goals."""
    runs = [[float(b.models[m].training.free_run.rms[0]) for m in (SEMP, FROLS)] for b in study.recorded]
    better = sum(own < other for own, other in runs)
    sound = [bench for bench in study.recorded if not bench.models[SEMP].held_out.diverged]
    worst = max((remove(bench.models[SEMP].model, bench.sections[1]).error for bench in sound), default=0.0)
    return [
        *_of_method(study, SEMP),
        WORDS.measure("fro", better > len(runs) / 2, pairs=Each((1e6 * a, 1e6 * b) for a, b in runs)),
        WORDS.measure("dc", worst < 1e-9, worst=worst),
    ]


def judge_svb(study: Study) -> list[Measure]:
    """Compare the models of SVB and their posteriors with the goals."""
    shares = [bench.models[SVB].error / bench.models[SEMP].error for bench in study.recorded]
    fall = max(
        float(np.max(-np.diff(step.bounds), initial=0.0)) / abs(step.lower_bound)
        for bench in study.recorded
        for step in bench.models[SVB].search.path_
    )
    bands = [one_step_band(bench.models[SVB].model, bench.sections[1]) for bench in study.benches[FILM]]
    within = [100 * float(band.coverage[0]) for band in bands]
    median, middle = float(np.median(shares)), float(np.median(within))
    return [
        *_of_method(study, SVB),
        WORDS.measure("semp", median <= AS_GOOD, AS_GOOD=AS_GOOD, shares=Each(shares), median=median),
        WORDS.measure("bounds", fall <= RISE, RISE=RISE, fall=fall),
        WORDS.measure("band", 90 <= middle <= 99, shares=Span(within), median=middle),
    ]


def _of_method(study: Study, method: str) -> Iterable[Measure]:
    """Return the goals for either method."""
    models = {variant: [bench.models[method] for bench in benches] for variant, benches in study.benches.items()}
    found = [bench.models[method] for bench in study.recorded]
    finite = [not one.held_out.diverged for one in found]
    yield WORDS.measure("sound", all(finite), method=method, count=sum(finite), total=len(finite))

    linear = [float(bench.models[LINEAR].held_out.free_run.nrmse[0]) for bench in study.recorded]
    shares = [float(one.held_out.free_run.nrmse[0]) / other for one, other in zip(found, linear, strict=True)]
    fits = Span(one.fit for one in found)
    yield WORDS.measure("linear", max(shares) < HALF, method=method, HALF=HALF, shares=Span(shares), fits=fits)

    whole = [one.passed == len(one.held_out.tests) for one in found]
    total, passed = sum(len(one.held_out.tests) for one in found), sum(one.passed for one in found)
    yield WORDS.measure("tests", all(whole), method=method, passed=passed, total=total, whole=sum(whole))

    gains = [without.fit - one.fit for one, without in zip(found, models[STEADY], strict=True)]
    drifting = float(np.median(gains[:5]))  # the sixth shifts before its sections and stands still in them
    yield WORDS.measure("history", drifting > 0, method=method, gains=Each(gains))

    losses = [one.error / film.error for one, film in zip(models[STEADY], models[FILM], strict=True)]
    median = float(np.median(losses))
    yield WORDS.measure("hysteresis", median > 1, method=method, losses=Span(losses), median=median)


TESTS = {"ee": "ee", "ue": "ue", "e(eu)": "e(eu)", "(u2)'e": "(u²)′e", "(u2)'e2": "(u²)′e²"}


def semp_tables(study: Study) -> list[Table]:
    """Make the tables of chapter 4."""
    return [
        WORDS.table("preprocessing", list(_preprocessing(study))),
        _validation(study.recorded, (SEMP, FROLS, LINEAR)),
        _physics(study),
        WORDS.table("semp", [[*row, f"{low} to {high}"] for *row, low, high in _parameters(study.recorded, SEMP)]),
        _estimators(study.shown),
        _dc(study.shown),
    ]


def svb_tables(study: Study) -> list[Table]:
    """Make the tables of chapter 6 and of appendix D."""
    others = [bench for bench in study.recorded if bench is not study.shown]
    groups = {
        f"model of {study.shown.name} with 95 % intervals (thesis table 6.4)": [study.shown],
        "models of the others with 95 % intervals, 1 (thesis table D.1)": others[:3],
        "models of the others with 95 % intervals, 2 (thesis table D.2)": others[3:],
    }
    return [
        _validation(study.recorded, (*study.methods, LINEAR)),
        _physics(study),
        *(WORDS.table("svb", list(_parameters(benches, SVB)), which=which) for which, benches in groups.items()),
    ]


def failures(study: Study) -> dict[str, Any]:
    """Return the plan, and passed tests and remaining errors with less and less physics, for the notes."""
    every, plan = [study.models(variant) for variant in VARIANTS], study.plan
    lags = ", ".join(f"u(k-{lag})" if lag else "u(k)" for lag in plan.input_lags)
    own = ", ".join(f"y(k-{lag})" for lag in range(1, plan.output_lags + 1))
    return {
        "step": quantity(plan.factor * study.sample_time, "s"),
        "candidates": f"products of {own} and {lags} up to degree {plan.degree}",
        "number": len(every[0]),
        "total": sum(len(one.held_out.tests) for one in every[0]),
        "passed": [sum(one.passed for one in found) for found in every],
        "one_step": [1e6 * median(float(one.held_out.one_step.rms[0]) for one in found) for found in every],
        "free_run": [1e6 * median(one.error for one in found) for found in every],
        "noise": 1e6 * study.prepared[0].actuator.plant.rig.noise,
        "test": every[0][0].held_out.tests[0],
    }


def _preprocessing(study: Study) -> Iterator[list[str]]:
    for one in study.prepared:
        training, held_out = one.split(RECORDED, study.plan.factor)
        sampling = one.sampling
        minimum = "none" if sampling.first_minimum is None else f"{sampling.first_minimum * sampling.sample_time:.2f} s"
        yield [
            one.name,
            *(f"{part.start:.0f} to {part.end:.0f} s, {part.n_samples}" for part in (training, held_out)),
            quantity(training.sample_time, "s"),
            f"{minimum}; {quantity(sampling.factor * sampling.sample_time, 's')}",
            "; ".join(finding.text for finding in one.findings) or "nothing",
        ]


def _validation(benches: Sequence[Bench], methods: Sequence[str]) -> Table:
    rows = []
    for bench in benches:
        for method in methods:
            one, held_out = bench.models[method], bench.models[method].held_out
            error = "–" if held_out.diverged else _micro(float(held_out.free_run.rms[0]))
            fits = [_one_step(held_out), _free_run(one.training), _free_run(held_out), error]
            tests = [_verdict(one, name) for name in TESTS]
            rows.append([bench.name, method, str(len(one.model.terms)), *fits, *tests])
    return WORDS.table("validation", rows, *(f"φ {text}" for text in TESTS.values()))


def _one_step(section: Validation) -> str:
    return _micro(float(section.one_step.rms[0]))


def _free_run(section: Validation) -> str:
    return "diverges" if section.diverged else f"{float(section.free_run.percent[0]):.1f} %"


def _micro(metres: float) -> str:
    return f"{1e6 * metres:.1f} µm"


def _verdict(one: Identified, name: str) -> str:
    """The verdict of a test; if it fails, with the largest correlation."""
    test = one.held_out.test(name)
    return "passes" if test not in one.held_out.failed else f"fails, {abs(test.largest) / test.band:.1f} bands"


def _physics(study: Study) -> Table:
    """Return fit and tests with less and less physics in the actuators."""
    rows = []
    for number, one in enumerate(study.prepared):
        for method in study.methods:
            found = [study.benches[variant][number].models[method] for variant in VARIANTS]
            cells = [f"{_free_run(it.held_out)}, {it.passed} of {len(it.held_out.tests)}" for it in found]
            rows.append([one.name, method, *cells, one.actuator.story])
    return WORDS.table("physics", rows, *(f"{variant}: fit, tests passed" for variant in VARIANTS), "history")


def _parameters(benches: Iterable[Bench], method: str) -> Iterator[list[str]]:
    """Actuator, term, parameter and the ends of its interval."""
    for bench in benches:
        model = bench.models[method].model
        ends = ThetaPosterior(model=model).interval().tolist()
        for number, (term, value, (low, high)) in enumerate(zip(model.terms, model.theta, ends, strict=True)):
            yield [bench.name if number == 0 else "", str(term), f"{value:.4g}", f"{low:.4g}", f"{high:.4g}"]


def _estimators(bench: Bench) -> Table:
    """One structure, estimated in several ways, with errors and tests."""
    terms = bench.models[SEMP].model.terms
    named = estimate_all(terms, bench.sections)
    estimated = named.values()
    noise = sorted({t for e in estimated for t in e.model.terms} - set(terms), key=str)
    rows = [[str(term), *(_estimate(e.model, str(term)) for e in estimated)] for term in (*terms, *noise)]
    for label, found in (("training", [e.training for e in estimated]), ("held out", [e.held_out for e in estimated])):
        rows.append([f"one-step error, {label}", *map(_one_step, found)])
        rows.append([f"free-run fit, {label}", *map(_free_run, found)])
    for name, text in TESTS.items():
        cells = ["passes" if e.held_out.test(name) not in e.held_out.failed else "fails" for e in estimated]
        rows.append([f"φ {text}, held out", *cells])
    return WORDS.table("estimators", rows, *named, name=bench.name)


def _estimate(model: NarxModel, term: str) -> str:
    found = [place for place, own in enumerate(model.terms) if str(own) == term]
    return "–" if not found else f"{model.theta[found[0]]:.4g} ± {model.theta_cov[found[0], found[0]] ** 0.5:.1g}"


def _dc(bench: Bench) -> Table:
    shifted = deviations(model := bench.models[SEMP].model)
    level, rest = float(shifted.point.operating_input[0]), 1e3 * shifted.point.output
    return WORDS.table("dc", parameters_by_term(model, shifted.model), name=bench.name, level=level, rest=rest)


Terms = Sequence[Term]
NOISE: dict[str, Any] = {"noise_lags": 2, "noise_degree": 1, "criterion": "none"}
ESTIMATORS: Mapping[str, Callable[[Terms, Recording], NarxModel]] = {
    "least squares": lambda terms, section: Fixed(terms=terms).fit(section).model_,
    "ridge": lambda terms, section: Fixed(terms=terms, estimator=Ridge()).fit(section).model_,
    "total least squares": lambda terms, section: Fixed(terms=terms, estimator=TotalLeastSquares()).fit(section).model_,
    "least prediction error": lambda terms, section: Narmax(Fixed(terms=terms), **NOISE).fit(section).model_,
    "least free-run error": lambda terms, section: refine(Fixed(terms=terms).fit(section).model_, section),
}
"""Estimators of the parameters of given terms; the fourth adds e(k-1) and e(k-2)."""


def estimate_all(terms: Terms, sections: tuple[Recording, Recording]) -> dict[str, Identified]:
    """Estimate a structure with each of `ESTIMATORS`; the terms of the noise come after its own."""
    found = {}
    for name, estimate in ESTIMATORS.items():
        try:
            model = estimate(terms, sections[0])
        except ModelError:
            continue
        found[name] = Identified.of(None, model, sections)
    return found


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
