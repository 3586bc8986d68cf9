"""The figures of `semp-fleet`, after figures 4.7 to 4.9 of the thesis, and those that `svb-fleet` draws as well."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.fleet.orders import DEGREES, LAGS, Plan
from deatwin.ident.narx.fleet.records import RECORDED, STEADY
from deatwin.scenarios.fleet_models import WORDS
from deatwin.scenarios.fleet_models.study import SEMP, SHOWN, SVB, THRESHOLDS, Bench, Study
from deatwin.scenarios.fleet_models.tables import TESTS
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue, filled, key_of, panels_of, plain_numbers, titled
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Each

Array = NDArray[np.float64]
OF_METHOD = {SEMP: Hue.BEFORE, SVB: Hue.AFTER}
STEADIEST = 6
"""Number of the actuator that does not drift within its sections."""


def semp_drawings(study: Study) -> list[Drawing]:
    """Draw the figures of chapter 4."""
    return [_orders(study.plan), _semp(study.recorded), *correlation_tests(study, "thesis figure 4.9")]


def _orders(plan: Plan) -> Drawing:
    """Free-run error by lags and degree at the chosen sampling time."""
    errors, chosen = 100 * plan.orders[plan.chosen].means, plan.orders[plan.chosen].best
    own, of_input = {1: "y(k−1)", 2: "y(k−1), y(k−2)"}, ("u(k)", "u(k), u(k−1)", "u(k) to u(k−2)")
    names = [f"{own[output]}, {of_input[largest]}" for output, largest in LAGS]
    lags = np.repeat(np.array(LAGS, dtype=np.float64), len(DEGREES), axis=0)
    columns = {
        "output_lags": lags[:, 0],
        "largest_input_lag": lags[:, 1],
        "degree": np.tile(np.array(DEGREES, dtype=np.float64), len(LAGS)),
        "error_percent": errors.ravel(),
    }
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
        return WORDS.drawing(figure, "orders", columns, factor=plan.factor)


def _semp(benches: Iterable[Bench]) -> Drawing:
    """The path of each search: what every addition brought, and the free-run error after it."""
    columns: dict[str, Array] = {}
    with draw((9.6, 7.0)) as figure:
        panels = panels_of(figure, 3, 2, "step", "share of mean y²", sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            search, key, found = bench.models[SEMP].search, key_of(bench.name), bench.models[SEMP].model
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
            columns |= {
                f"{key}_step": number,
                f"{key}_reduction": search.srr_,
                f"{key}_error": left,
                f"{key}_terms": np.array([len(step.terms) for step in search.path_], dtype=np.float64),
            }
        panels[0, 0].set(yscale="log", ylim=(3e-6, 2.0))
        legend_above(figure, panels[0, 0], 4)
        return WORDS.drawing(figure, "semp", filled(columns), thresholds=Each(THRESHOLDS[1:]))


def correlation_tests(study: Study, counterpart: str) -> list[Drawing]:
    """Draw the five tests of two actuators, one method beside the other, and of the same without their history."""
    return [_tests(study, number, counterpart) for number in (SHOWN, STEADIEST)]


def _tests(study: Study, number: int, counterpart: str) -> Drawing:
    bench, steady = study.recorded[number - 1], study.benches[STEADY][number - 1]
    columns: dict[str, Array] = {}
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
                key = f"{method}_{name}".translate(str.maketrans("", "", "()'"))
                columns |= {
                    f"{key}_lag": test.lags.astype(np.float64),
                    key: test.values,
                    f"{key}_without_history": without.values,
                }
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=2, markerscale=3)
        words = {"name": bench.name, "methods": " beside ".join(study.methods), "counterpart": counterpart}
        return WORDS.drawing(figure, "tests", filled(columns), f"tests_dea{number}", **words)
