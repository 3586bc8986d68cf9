"""Goals, results, tables and figures of the page."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from deatwin.plant.drawing import Axes
from deatwin.scenarios.svb_benchmark.draws import METHODS, VARIATIONAL, Oracle, Trial, consult, system_of
from deatwin.scenarios.svb_benchmark.study import SWEPT, WHITE, Study
from deatwin.studies.rates import Rate
from deatwin.studies.report.drawing import COLOURS, Drawing, Hue, draw
from deatwin.studies.report.quantities import three_digits
from deatwin.studies.report.story import Measure, Table
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
COVERAGE = (0.92, 0.98)
LEAST_PARAMETERS = 500
WEAK = "S6"  # System whose smallest term is so weak that no method can find it in all draws
CLEAN = "svb-clean"


def exact(study: Study, system: str, method: str) -> Rate:
    """Count the draws for which a method finds exactly the true structure."""
    return Rate.of(trial.exact for trial in study.of(system, method))


def kept(study: Study, system: str, method: str) -> Rate:
    """Count the draws for which a method keeps every true term."""
    return Rate.of(trial.kept for trial in study.of(system, method))


def oracles(study: Study, system: str) -> tuple[Oracle, Oracle]:
    """Evaluate the two oracles, which know the truth: on all candidates, and from the true terms."""
    draws = study.contrasts[system]
    return consult([draw.full for draw in draws]), consult([draw.near for draw in draws])


def judge(study: Study) -> list[Measure]:
    """Compare the study with its goals."""
    rows: list[Measure] = []
    if "semp" in study.plan.methods:
        rows += _shares(study, "semp", "exact structure", ("S2", "S3", "S4"), 0.95)
        rows += _beside_oracles(study, "semp", "exact structure", 0.97)
    if CLEAN in study.plan.methods:
        strong = ("S1", "S2", "S3", "S4", "E1")
        rows += _shares(study, CLEAN, "every true term kept", strong, 1.0)
        rows += _beside_oracles(study, CLEAN, "every true term kept", 1.0)
        rows += _shares(study, CLEAN, "exact structure", strong, 0.9)
        rows += _beside_oracles(study, CLEAN, "exact structure", 0.95)
    return [*rows, *_covers(study), *_sampler_agrees(study)]


def _rate(study: Study, system: str, method: str, what: str) -> Rate:
    return (exact if what.startswith("exact") else kept)(study, system, method)


def _shares(study: Study, method: str, what: str, systems: Iterable[str], least: float) -> Iterator[Measure]:
    demanded = f"at least {100 * least:g} %" if least < 1 else "in all draws"
    for system in systems:
        if system in study.plan.systems:
            rate = _rate(study, system, method, what)
            yield Measure(f"{METHODS[method].label}, {system}: {what}", demanded, str(rate), rate.share >= least)


def _beside_oracles(study: Study, method: str, what: str, share: float) -> Iterator[Measure]:
    if WEAK not in study.plan.systems:
        return
    rate = _rate(study, WEAK, method, what)
    of, label = f"{share:g} of " if share < 1 else "", METHODS[method].label
    names = ("an oracle on all candidates", "a stricter oracle that starts from the true terms")
    for name, oracle in zip(names, oracles(study, WEAK), strict=True):
        reference = (oracle.exact if what.startswith("exact") else oracle.kept).share
        measure, demanded = f"{label}, {WEAK}: {what}, relative to {name}", f"at least {of}{100 * reference:g} %"
        yield Measure(measure, demanded, str(rate), rate.share >= share * reference)


def _covers(study: Study) -> Iterator[Measure]:
    for estimator in sorted({estimator for _, estimator in study.covered}):
        sets = [study.covered[system, estimator] for system in WHITE if (system, estimator) in study.covered]
        if sets:
            rate = Rate.of(np.concatenate([flags.ravel() for flags in sets]).tolist())
            enough, systems = rate.count >= LEAST_PARAMETERS, ", ".join(WHITE)
            numbers = {"band": _band(), "least": LEAST_PARAMETERS, "rate": str(rate), "count": rate.count}
            passed = _within(rate.share) and enough
            yield WORDS.measure("covers", passed, estimator=estimator, systems=systems, **numbers)


def _sampler_agrees(study: Study) -> Iterator[Measure]:
    if not study.comparisons:
        return
    same = Rate.of(draw.agrees for draw in study.comparisons)
    apart = max(draw.unsettled for draw in study.comparisons)
    yield WORDS.measure("sampler", same.hits == same.count, same=same, apart=apart)
    for name, which in (("mass_given", "of the same structure"), ("mass", "averaged over structures")):
        mass = float(np.mean(np.concatenate([getattr(draw, name) for draw in study.comparisons])))
        yield WORDS.measure("mass", _within(mass), which=which, band=_band(), mass=100 * mass)


def _band() -> str:
    return f"{100 * COVERAGE[0]:g} to {100 * COVERAGE[1]:g} %"


def _within(share: float) -> bool:
    return COVERAGE[0] <= share <= COVERAGE[1]


def tables(study: Study) -> list[Table]:
    """Make all tables."""
    made = [_method(study, method) for method in study.plan.methods]
    made.append(_oracles(study))
    if SWEPT in study.plan.systems:
        made += [_chosen(study), _intervals(study)]
    return [*made, _coverage(study), _systems(study)]


def _method(study: Study, method: str) -> Table:
    rows = []
    for system in study.plan.systems:
        trials = study.of(system, method)
        means = [f"{np.mean([getattr(trial, kind) for trial in trials]):.2f}" for kind in ("missed", "false")]
        time = three_digits(float(np.median([trial.seconds for trial in trials])))
        rows.append([system, str(kept(study, system, method)), str(exact(study, system, method)), *means, time])
    return WORDS.table("method", rows, label=METHODS[method].label, line=WORDS.text(f"method.{method}"))


def _oracles(study: Study) -> Table:
    rows = []
    for system in study.plan.systems:
        several = [[str(o.kept), str(o.exact), three_digits(o.threshold)] for o in oracles(study, system)]
        rows.append([system, *several[0], *several[1]])
    return WORDS.table("oracles", rows)


def _chosen(study: Study) -> Table:
    """Terms of the first draw of E1, and how often each true one is kept over all."""
    system = system_of(SWEPT)
    true = dict(zip(map(str, system.terms), system.theta, strict=True))
    first = {method: study.of(SWEPT, method)[0] for method in study.plan.methods}

    def cell(term: str, method: str) -> str:
        trial = first[method]
        shown = f"{trial.theta[trial.terms.index(term)]:.3f}" if term in trial.terms else "–"
        if term in true:
            share = Rate.of(term in other.terms for other in study.of(SWEPT, method)).share
            shown += f" ({100 * share:.0f} %)"
        return shown

    terms = dict.fromkeys([*true, *(term for trial in first.values() for term in trial.terms)])
    known = {term: f"{true[term]:g}" if term in true else "–" for term in terms}
    rows = [[term, value, *(cell(term, method) for method in first)] for term, value in known.items()]
    return WORDS.table("chosen", rows, *(METHODS[method].label for method in first), swept=SWEPT)


def _intervals(study: Study) -> Table:
    """Intervals of the first draw of E1 whose structure is right, as far as there is one."""
    system, rows = system_of(SWEPT), []
    for method in study.plan.bayesian:
        right = [trial for trial in study.of(SWEPT, method) if trial.exact]
        for term, value in zip(map(str, system.terms), system.theta, strict=True) if right else ():
            at = right[0].terms.index(term)
            low, high = right[0].low[at], right[0].high[at]
            inside = Rate.of(_holds(other, term, value) for other in right)
            holds, mean = "yes" if low <= value <= high else "no", f"{right[0].theta[at]:.4f}"
            ends = f"{low:.4f} to {high:.4f}"
            rows.append([METHODS[method].label, term, f"{value:g}", mean, ends, holds, str(inside)])
    return WORDS.table("intervals", rows, swept=SWEPT)


def _holds(trial: Trial, term: str, value: float) -> bool:
    at = trial.terms.index(term)
    return trial.low[at] <= value <= trial.high[at]


def _coverage(study: Study) -> Table:
    rates = [(*key, Rate.of(flags.ravel().tolist())) for key, flags in study.covered.items()]
    rows = [[system, estimator, str(rate.count), str(rate)] for system, estimator, rate in rates]
    return WORDS.table("coverage", rows)


def _systems(study: Study) -> Table:
    rows = []
    for name in study.plan.systems:
        system, draws = system_of(name), study.contrasts[name]
        redraws = sum(draw.redraws for draw in draws)
        snr_db, condition = (np.median([getattr(draw, what) for draw in draws]) for what in ("snr_db", "condition"))
        found = [f"{snr_db:.1f} dB", f"{redraws} of {redraws + len(draws)}", f"{condition:.1e}"]
        rows.append([name, str(system.model), str(system.n_samples), *found, system.source])
    return WORDS.table("systems", rows)


STYLES = {
    "fro": (Hue.MEASURED, "v"),
    "fro-told": (Hue.MEASURED, "^"),
    "lasso": (Hue.MARK, "D"),
    "semp": (Hue.BEFORE, "s"),
    "svb": (Hue.AFTER, "o"),
    "svb-clean": (Hue.AFTER, "*"),
}


def drawings(study: Study) -> list[Drawing]:
    """Draw all figures."""
    return [_rates(study), _outcomes(study), _sweep(study)]


def _percent(rate: Rate) -> tuple[float, ...]:
    """Share and ends of its interval."""
    return tuple(100 * share for share in (rate.share, *rate.interval))


def _dot(axes: Axes, rate: Rate, place: float, colour: str, marker: str, label: str) -> None:
    """Draw a rate and its interval beside a place on the vertical axis."""
    share, *ends = _percent(rate)
    axes.plot(ends, [place, place], color=colour, linewidth=1.0, alpha=0.6, label=f"_{label}, 95 % interval")
    axes.plot(share, place, marker, color=colour, markersize=_size(marker), label=f"_{label}")


def _size(marker: str) -> int:
    return 9 if marker == "*" else 5


def _names(axes: Axes, names: Sequence[str], **style: Any) -> None:
    """Name the rows of a panel, from above."""
    axes.set_yticks(range(len(names)), names, **style)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)


def _rates(study: Study) -> Drawing:
    plan = study.plan
    step = 0.8 / len(plan.methods)
    with draw((9.6, 1.2 + 0.75 * len(plan.systems))) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        for axes, what, words in zip(panels, (kept, exact), ("every true term kept", "exact structure"), strict=True):
            for number, system in enumerate(plan.systems):
                for place, method in enumerate(plan.methods):
                    rate = what(study, system, method)
                    _dot(axes, rate, number - 0.4 + step * (place + 0.5), *STYLES[method], f"{system}, {method}")
                near = oracles(study, system)[1]
                limit = 100 * (near.exact if what is exact else near.kept).share
                axes.plot([limit, limit], [number - 0.4, number + 0.4], color=Hue.INK, linewidth=1.1, linestyle=":")
                axes.axhline(number + 0.5, color=COLOURS["grid"][0], linewidth=0.6)
            _names(axes, plan.systems)
            axes.set(xlabel=f"{words} (% of draws)", xlim=(-4, 104), ylim=(len(plan.systems) - 0.5, -0.5))
        for method in plan.methods:
            colour, marker = STYLES[method]
            panels[0].plot([], [], marker, color=colour, label=METHODS[method].label, markersize=5)
        panels[0].plot([], [], color=Hue.INK, linestyle=":", label="oracle from the true terms")
        figure.legend(loc="outside upper left", ncols=4, markerscale=1)
        return WORDS.drawing(figure, "rates", draws=plan.draws)


def _outcomes(study: Study) -> Drawing:
    """Draw what became of the draws of E1, or of the last system where E1 is not among them."""
    system = SWEPT if SWEPT in study.plan.systems else study.plan.systems[-1]
    outcomes: dict[str, tuple[str, Callable[[Trial], bool]]] = {
        "exact": (Hue.AFTER, lambda t: t.exact),
        "one false term": (Hue.MARK, lambda t: t.kept and t.false == 1),
        "more false terms": (Hue.MEASURED, lambda t: t.kept and t.false > 1),
        "a true term missed": (Hue.BEFORE, lambda t: not t.kept),
    }
    methods = study.plan.methods
    with draw((8.0, 1.0 + 0.5 * len(methods))) as figure:
        axes = figure.add_subplot()
        for place, method in enumerate(methods):
            left = 0.0
            for words, (colour, which) in outcomes.items():
                share = 100 * Rate.of(which(trial) for trial in study.of(system, method)).share
                axes.barh(place, share, left=left, color=colour, label="_" * bool(place) + words, height=0.65)
                left += share
        axes.set_axisbelow(True)
        axes.set(xlabel="share of the draws (%)", xlim=(0, 100))
        _names(axes, [METHODS[method].label for method in methods])
        figure.legend(loc="outside upper left", ncols=4)
        return WORDS.drawing(figure, "outcomes", system=system, draws=study.plan.draws)


def _sweep(study: Study) -> Drawing:
    variances = [level.variance for level in study.levels]

    def rates(method: str) -> list[Rate]:
        return [Rate.of(t.exact for t in level.trials if t.method == method) for level in study.levels]

    with draw((9.6, 3.6)) as figure:
        left, right = figure.subplots(1, 2)
        for place, method in enumerate(study.plan.bayesian):
            found = rates(method)
            _line(left, [1.06**place * v for v in variances], found, METHODS[method].label, *STYLES[method])
        covers = [Rate.of(level.covered.ravel().tolist()) for level in study.levels]
        _line(right, variances, covers, VARIATIONAL, Hue.AFTER, "o")
        right.axhspan(*(100 * end for end in COVERAGE), color=Hue.MARK, alpha=0.25, linewidth=0)
        left.set(ylabel="exact structure (% of draws)", ylim=(-3, 103))
        right.set(ylabel="intervals that cover (%)", ylim=(85, 100.5))
        for axes in (left, right):
            axes.set(xscale="log", xlabel="variance of the noise")
            axes.set_xticks(variances, [f"{v:g}" for v in variances])
            axes.minorticks_off()
        left.legend(loc="lower left", markerscale=1)
        return WORDS.drawing(figure, "sweep", swept=SWEPT, draws=study.plan.swept_draws)


def _line(axes: Axes, places: Sequence[float], rates: Sequence[Rate], label: str, colour: str, marker: str) -> None:
    """Draw rates and their intervals over the levels."""
    shares, *ends = np.array([_percent(rate) for rate in rates]).T
    style: dict[str, Any] = {"color": colour, "label": label, "fmt": f"{marker}-", "capsize": 2, "elinewidth": 0.9}
    drawn = axes.errorbar(places, shares, np.abs(np.array(ends) - shares), markersize=_size(marker), **style)
    drawn.lines[0].set_label(f"_{label}")
