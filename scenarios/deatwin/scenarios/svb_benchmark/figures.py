"""The figures of the story."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.scenarios.svb_benchmark.draws import Trial, system_of
from deatwin.scenarios.svb_benchmark.methods import ESTIMATORS, METHODS, VARIATIONAL
from deatwin.scenarios.svb_benchmark.study import SWEPT, WHITE, Study
from deatwin.scenarios.svb_benchmark.tables import COVERAGE, exact, kept, oracles
from deatwin.studies.rates import Rate
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue
from deatwin.studies.report.svg import COLOURS, draw
from deatwin.studies.report.tables import csv_text
from deatwin.studies.report.words import Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WORDS = Words(__package__)
STYLES = {
    "fro": (Hue.MEASURED, "v"),
    "fro-told": (Hue.MEASURED, "^"),
    "lasso": (Hue.MARK, "D"),
    "semp": (Hue.BEFORE, "s"),
    "svb": (Hue.AFTER, "o"),
    "svb-clean": (Hue.AFTER, "*"),
}
COVER_STYLES = ((Hue.MEASURED, "v"), (Hue.AFTER, "o"), (Hue.BEFORE, "s"), (Hue.MARK, "D"))
"""Colours and markers of the estimators, in their order."""
COLOURED = ["S5"]
MOST_SHOWN = 12
"""Terms of the sampler that are drawn."""
SHARES = ("share_percent", "low_percent", "high_percent")
Cells = list[tuple[object, ...]]


def drawings(study: Study) -> list[Drawing]:
    """Draw all figures."""
    made = [_rates(study), _outcomes(study), _coverage(study), _sweep(study)]
    return [*made, _sampler(study)] if study.comparisons else made


def _percent(rate: Rate) -> tuple[float, ...]:
    """Share and ends of its interval."""
    return tuple(100 * share for share in (rate.share, *rate.interval))


def _dot(axes: Axes, rate: Rate, place: float, colour: str, marker: str) -> None:
    """Draw a rate and its interval beside a place on the vertical axis."""
    share, *ends = _percent(rate)
    axes.plot(ends, [place, place], color=colour, linewidth=1.0, alpha=0.6)
    axes.plot(share, place, marker, color=colour, markersize=_size(marker))


def _size(marker: str) -> int:
    return 9 if marker == "*" else 5


def _names(axes: Axes, names: Sequence[str], **style: Any) -> None:
    """Name the rows of a panel, from above."""
    axes.set_yticks(range(len(names)), names, **style)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)


def _rates(study: Study) -> Drawing:
    plan, rows = study.plan, []
    step = 0.8 / len(plan.methods)
    with draw((9.6, 1.2 + 0.75 * len(plan.systems))) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        for axes, what, words in zip(panels, (kept, exact), ("every true term kept", "exact structure"), strict=True):
            for number, system in enumerate(plan.systems):
                for place, method in enumerate(plan.methods):
                    rate = what(study, system, method)
                    _dot(axes, rate, number - 0.4 + step * (place + 0.5), *STYLES[method])
                    rows.append((system, method, words, *_percent(rate)))
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
        return WORDS.drawing(figure, "rates", csv_text(("system", "method", "what", *SHARES), rows), draws=plan.draws)


def _outcomes(study: Study) -> Drawing:
    """Draw what became of the draws of E1, or of the last system where E1 is not among them."""
    system = SWEPT if SWEPT in study.plan.systems else study.plan.systems[-1]
    outcomes: dict[str, tuple[str, Callable[[Trial], bool]]] = {
        "exact": (Hue.AFTER, lambda t: t.exact),
        "one false term": (Hue.MARK, lambda t: t.kept and t.false == 1),
        "more false terms": (Hue.MEASURED, lambda t: t.kept and t.false > 1),
        "a true term missed": (Hue.BEFORE, lambda t: not t.kept),
    }
    methods, rows = study.plan.methods, []
    with draw((8.0, 1.0 + 0.5 * len(methods))) as figure:
        axes = figure.add_subplot()
        for place, method in enumerate(methods):
            left = 0.0
            for words, (colour, which) in outcomes.items():
                share = 100 * Rate.of(which(trial) for trial in study.of(system, method)).share
                axes.barh(place, share, left=left, color=colour, label=words if not place else None, height=0.65)
                left += share
                rows.append((method, words, share))
        axes.set_axisbelow(True)
        axes.set(xlabel="share of the draws (%)", xlim=(0, 100))
        _names(axes, [METHODS[method].label for method in methods])
        figure.legend(loc="outside upper left", ncols=4)
        return WORDS.drawing(
            figure,
            "outcomes",
            csv_text(("method", "outcome", "share_percent"), rows),
            system=system,
            draws=study.plan.draws,
        )


def _coverage(study: Study) -> Drawing:
    rows: Cells = []
    white = [system for system in WHITE if (system, VARIATIONAL) in study.covered]
    with draw((9.6, 5.0)) as figure:
        panels = figure.subplots(1, 2, sharex=True)
        for axes, systems in zip(panels, (white, COLOURED), strict=True):
            estimators = [VARIATIONAL] if systems is white else list(ESTIMATORS)
            labels = [f"{system} {term}" for system in systems for term in system_of(system).terms]
            for place, estimator in enumerate(estimators):
                colour, marker = (Hue.AFTER, "o") if systems is white else COVER_STYLES[place]
                flags = [f for system in systems for f in study.covered.get((system, estimator), np.zeros((0, 0))).T]
                offset = (place + 0.5) / len(estimators) - 0.5
                for number, (label, inside) in enumerate(zip(labels, flags, strict=False)):
                    rate = Rate.of(inside.tolist())
                    _dot(axes, rate, number + 0.8 * offset, colour, marker)
                    rows.append((label, estimator, *_percent(rate)))
                axes.plot([], [], marker, color=colour, label=estimator, markersize=5)
            axes.axvspan(*(100 * end for end in COVERAGE), color=Hue.MARK, alpha=0.25, linewidth=0)
            axes.axvline(95, color=Hue.INK, linestyle=":", linewidth=0.9)
            axes.set_yticks(range(len(labels)), labels, fontsize="small")
            axes.set(xlabel="intervals that hold the true parameter (%)", ylim=(len(labels) - 0.4, -0.6))
            axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), markerscale=1, fontsize="small")
        return WORDS.drawing(
            figure,
            "coverage",
            csv_text(("system and term", "estimator", *SHARES), rows),
            draws=study.plan.draws,
            low=100 * COVERAGE[0],
            high=100 * COVERAGE[1],
        )


def _sweep(study: Study) -> Drawing:
    rows: Cells = []
    variances = [level.variance for level in study.levels]

    def rates(method: str, flag: Callable[[Trial], bool]) -> list[Rate]:
        return [Rate.of(flag(t) for t in level.trials if t.method == method) for level in study.levels]

    def note(what: str, several: Sequence[Rate]) -> None:
        rows.extend((variance, what, *_percent(rate)) for variance, rate in zip(variances, several, strict=True))

    with draw((9.6, 3.6)) as figure:
        left, right = figure.subplots(1, 2)
        for place, method in enumerate(study.plan.bayesian):
            found = rates(method, lambda t: t.exact)
            _line(left, [1.06**place * v for v in variances], found, METHODS[method].label, *STYLES[method])
            note(f"{method} exact structure", found)
            note(f"{method} every true term kept", rates(method, lambda t: t.kept))
        covers = [Rate.of(level.covered.ravel().tolist()) for level in study.levels]
        _line(right, variances, covers, VARIATIONAL, Hue.AFTER, "o")
        note("intervals that cover", covers)
        right.axhspan(*(100 * end for end in COVERAGE), color=Hue.MARK, alpha=0.25, linewidth=0)
        left.set(ylabel="exact structure (% of draws)", ylim=(-3, 103))
        right.set(ylabel="intervals that cover (%)", ylim=(85, 100.5))
        for axes in (left, right):
            axes.set(xscale="log", xlabel="variance of the noise")
            axes.set_xticks(variances, [f"{v:g}" for v in variances])
            axes.minorticks_off()
        left.legend(loc="lower left", markerscale=1)
        return WORDS.drawing(
            figure, "sweep", csv_text(("variance", "what", *SHARES), rows), swept=SWEPT, draws=study.plan.swept_draws
        )


def _line(axes: Axes, places: Sequence[float], rates: Sequence[Rate], label: str, colour: str, marker: str) -> None:
    """Draw rates and their intervals over the levels."""
    shares, *ends = np.array([_percent(rate) for rate in rates]).T
    style: dict[str, Any] = {"color": colour, "label": label, "fmt": f"{marker}-", "capsize": 2, "elinewidth": 0.9}
    axes.errorbar(places, shares, np.abs(np.array(ends) - shares), markersize=_size(marker), **style)


def _sampler(study: Study) -> Drawing:
    first = study.comparisons[0]
    shown = np.argsort(-first.inclusion)[:MOST_SHOWN]
    true = dict(zip(map(str, system_of("S4").terms), system_of("S4").theta, strict=True))
    with draw((9.6, 4.0)) as figure:
        left, right = figure.subplots(1, 2)
        for place, i in enumerate(shown):
            colour, marker = (Hue.AFTER, "o") if first.terms[i] in first.chosen else (Hue.MEASURED, "D")
            left.plot(first.inclusion[i], place, marker, color=colour, markersize=6)
        left.axvline(0.5, color=Hue.INK, linestyle=":", linewidth=0.9)
        left.set(xlabel="probability that the term is in", xscale="log", xlim=(None, 1.5))
        _names(left, [first.terms[i] for i in shown], fontsize="small")
        ends = {
            "SVB": (-0.13, Hue.AFTER, first.low, first.high),
            "sampler, over all structures": (0.13, Hue.BEFORE, first.sampled_low, first.sampled_high),
        }
        for place, term in enumerate(first.common):
            for label, (offset, colour, low, high) in ends.items():
                shift = np.array((low[place], high[place])) - true.get(term, 0.0)
                right.plot(shift, [place + offset] * 2, color=colour, linewidth=3, label=None if place else label)
        right.axvline(0, color=Hue.INK, linestyle=":", linewidth=0.9)
        right.set_xlabel("95 % interval less the true parameter")
        _names(right, first.common, fontsize="small")
        figure.legend(*right.get_legend_handles_labels(), loc="outside upper right", ncols=2)
        rows = [(first.terms[i], first.inclusion[i], int(first.terms[i] in first.chosen)) for i in shown]
        return WORDS.drawing(
            figure,
            "sampler",
            csv_text(("term", "probability", "kept_by_svb"), rows),
            shown=len(shown),
            terms=len(first.terms),
        )
