"""The figures of the story."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.scenarios.svb_benchmark.draws import Trial
from deatwin.scenarios.svb_benchmark.methods import METHODS, VARIATIONAL
from deatwin.scenarios.svb_benchmark.study import SWEPT, Study
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
SHARES = ("share_percent", "low_percent", "high_percent")
Cells = list[tuple[object, ...]]


def drawings(study: Study) -> list[Drawing]:
    """Draw all figures."""
    return [_rates(study), _outcomes(study), _sweep(study)]


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
