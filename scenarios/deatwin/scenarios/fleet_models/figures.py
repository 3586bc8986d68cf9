"""The figures of `semp-fleet`, after figures 4.7 to 4.9 of the thesis, and those that `svb-fleet` draws as well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.drifts import moving_mean
from deatwin.ident.narx.fleet.orders import DEGREES, LAGS, Plan
from deatwin.ident.narx.fleet.records import RECORDED, STEADY, thinned
from deatwin.ident.narx.predictive import PredictiveBand
from deatwin.scenarios.fleet_models.choice import THRESHOLDS
from deatwin.scenarios.fleet_models.study import SEMP, SVB, Bench, Study
from deatwin.scenarios.fleet_models.tables import TESTS
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import COLOURS, draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
OF_METHOD = {SEMP: BEFORE, SVB: AFTER}
ZOOM, WINDOW = 20.0, 20.0
"""Length of the free runs that are drawn, and of the moving means, s."""
STEADIEST = 6
"""Of the actuators, the one that does not drift within its sections."""


def semp_drawings(study: Study, shown: int) -> tuple[list[Drawing], dict[str, Columns]]:
    """Draw the figures of chapter 4."""
    made = [
        _orders(study.plan),
        _semp(study.recorded),
        free_runs(study.recorded, (SEMP,)),
        _drift(study),
        *(correlation_tests(study, number, "thesis figure 4.9") for number in (shown, STEADIEST)),
    ]
    return [drawing for drawing, _ in made], {drawing.data: columns for drawing, columns in made}


def _orders(plan: Plan) -> tuple[Drawing, Columns]:
    """Free-run error by lags and degree at the chosen sampling time."""
    errors = 100 * plan.orders[plan.chosen].means
    chosen = plan.orders[plan.chosen].best
    own, of_input = {1: "y(k−1)", 2: "y(k−1), y(k−2)"}, ("u(k)", "u(k), u(k−1)", "u(k) to u(k−2)")
    names = [f"{own[output]}, {of_input[largest]}" for output, largest in LAGS]
    with draw((9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(2, 3))
        places = np.arange(len(LAGS))
        left.plot(places, errors[:, 0], "o", color=MEASURED, markersize=6)
        left.set_xticks(places, names, rotation=50, ha="right", fontsize="small")
        left.set(ylabel="mean free-run error (%)", ylim=(0, None))
        left.set_title("linear", loc="left", fontsize="medium")
        for i, name in enumerate(names):
            colour = (AFTER, BEFORE, MARK)[LAGS[i][1]]
            style = "o-" if LAGS[i][0] == 1 else "s--"
            right.plot(DEGREES[1:], errors[i, 1:], style, color=colour, markersize=4, label=name)
        right.plot(DEGREES[chosen[1]], errors[chosen], "o", markersize=13, fillstyle="none", color=INK, label="taken")
        right.set(xlabel="degree", yscale="log", xticks=DEGREES[1:])
        right.set_title("nonlinear", loc="left", fontsize="medium")
        plain_numbers(right)
        figure.legend(loc="outside upper left", ncols=4, fontsize="small", markerscale=1)
        drawing = Drawing.of(
            figure,
            "orders",
            "Free-run error by lags and degree (thesis figure 4.7)",
            "Root mean square error of free runs over that of the reading about its mean, mean of the six, on the end "
            "of the training sections; terms are selected on their beginning. Where a point lies far up, one of the "
            f"six runs goes astray; where it is missing, one diverges. Every {plan.factor}th sample is kept.",
        )
    lags = np.repeat(np.array(LAGS, dtype=np.float64), len(DEGREES), axis=0)
    return drawing, {
        "output_lags": lags[:, 0],
        "largest_input_lag": lags[:, 1],
        "degree": np.tile(np.array(DEGREES, dtype=np.float64), len(LAGS)),
        "error_percent": errors.ravel(),
    }


def _semp(benches: tuple[Bench, ...]) -> tuple[Drawing, Columns]:
    """The path of each search: what every addition brought, and the free-run error after it."""
    columns: dict[str, Array] = {}
    with draw((9.6, 7.0)) as figure:
        panels = figure.subplots(3, 2, sharex=True, sharey=True)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            search, key, found = bench.models[SEMP].search, key_of(bench), bench.models[SEMP].model
            power = float(np.mean(bench.sections[0].outputs ** 2))
            number = np.arange(1.0, search.srr_.size + 1)
            left = search.msse_ / power
            axes.plot(number, left, color=MEASURED, linewidth=1.2, label="free-run error after it, over mean y²")
            gains = np.where(search.srr_ > 0, search.srr_, np.nan)
            axes.plot(number, gains, "o", color=BEFORE, markersize=4, label="error reduction of an addition")
            pruned = np.array([bool(step.pruned) for step in search.path_])
            axes.plot(number[pruned], left[pruned], "v", color=INK, markersize=5, label="then terms were pruned")
            best = int(np.argmin(search.msse_))
            axes.plot(number[best], left[best], "o", markersize=11, fillstyle="none", color=INK, label="taken")
            for threshold in THRESHOLDS[1:]:
                axes.axhline(threshold, color=INK, linewidth=0.7, linestyle=":")
            axes.set_title(f"{bench.name}: {len(found.terms)} terms", loc="left", fontsize="medium")
            columns |= {
                f"{key}_step": number,
                f"{key}_reduction": search.srr_,
                f"{key}_error": left,
                f"{key}_terms": np.array([len(step.terms) for step in search.path_], dtype=np.float64),
            }
        panels[0, 0].set(yscale="log", ylim=(3e-6, 2.0))
        for axes in panels[-1]:
            axes.set_xlabel("step")
        figure.supylabel("share of mean y²", fontsize="medium")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=4, markerscale=1)
        drawing = Drawing.of(
            figure,
            "semp",
            "Simulation error reduction along the search of SEMP (thesis figure 4.8)",
            "What an addition takes off the squared error of the free run, over the mean square of the reading. Where "
            "a point is missing, the addition was made for the one-step error, and the free run is as good. Dotted: "
            f"thresholds of {', '.join(f'{t:g}' for t in THRESHOLDS[1:])}. The search here has none: its own tests end "
            "it, and of its steps the one with the least error is taken.",
        )
    return drawing, filled(columns)


def free_runs(
    benches: Sequence[Bench], methods: Sequence[str], bands: Mapping[str, PredictiveBand] | None = None
) -> tuple[Drawing, Columns]:
    """Draw around the largest reading of each held-out section."""
    columns: dict[str, Array] = {}
    with draw((9.6, 7.0)) as figure:
        panels = figure.subplots(3, 2)
        for axes, bench in zip(panels.T.ravel(), benches, strict=True):
            section = bench.sections[1]
            part = _around(section.outputs[0], round(ZOOM / section.sample_time))
            timepts, measured = section.timepts[part], 1e3 * section.outputs[0, part]
            key = key_of(bench)
            columns |= {f"{key}_time_s": timepts, f"{key}_mm": measured}
            if bands is not None:
                low, high = (1e3 * end[0, part] for end in (bands[bench.name].lower, bands[bench.name].upper))
                axes.fill_between(timepts, low, high, color=AFTER, alpha=0.25, linewidth=0, label="95 % band of SVB")
                columns |= {f"{key}_low_mm": low, f"{key}_high_mm": high}
            axes.plot(timepts, measured, ".", color=MEASURED, markersize=5, label="measured")
            for method in methods:
                run = 1e3 * bench.models[method].model.simulate(section).outputs[0, part]
                axes.plot(timepts, run, color=OF_METHOD[method], linewidth=1.0, label=method)
                columns[f"{key}_{method}_mm"] = run
            axes.set_title(bench.name, loc="left", fontsize="medium")
            axes.set_ylim(0.0, 1.1 * measured.max())
        for axes in panels[-1]:
            axes.set_xlabel("time (s)")
        figure.supylabel("displacement (mm)", fontsize="medium")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=4, markerscale=1)
        also = "" if bands is None else " Band: free runs of draws from the posterior, with noise drawn anew."
        drawing = Drawing.of(
            figure,
            "free_runs",
            "Free runs over the held-out sections",
            f"The {ZOOM:.0f} s around the largest reading. The models are given the command, and the first sample of "
            f"the section.{also}",
        )
    return drawing, columns


def _drift(study: Study) -> tuple[Drawing, Columns]:
    """Where the free run of a model goes astray, over the whole recording."""
    columns: dict[str, Array] = {}
    with draw((9.6, 7.0)) as figure:
        panels = figure.subplots(3, 2, sharex=True, sharey=True)
        for number, axes in enumerate(panels.T.ravel()):
            bench = study.recorded[number]
            training, held_out = bench.sections
            axes.axvspan(training.start, training.end, color=MARK, alpha=0.15, linewidth=0, label="training")
            axes.axvspan(held_out.start, held_out.end, color=MARK, alpha=0.4, linewidth=0, label="held out")
            for variant, colour in ((STEADY, MEASURED), (RECORDED, BEFORE)):
                record = thinned(study.prepared[number].recordings[variant], study.plan.factor)
                model = study.benches[variant][number].models[SEMP].model
                error = 1e6 * (record.outputs - model.simulate(record).outputs)[0]
                mean = moving_mean(error, round(WINDOW / record.sample_time))[::20]
                axes.plot(record.timepts[::20], mean, color=colour, linewidth=1.2, label=variant)
                columns |= {"time_s": record.timepts[::20], f"{key_of(bench)}_{variant.replace(' ', '_')}_um": mean}
            axes.set_title(bench.name, loc="left", fontsize="medium")
        for axes in panels[-1]:
            axes.set_xlabel("time (s)")
        figure.supylabel(f"free-run error of SEMP, mean over {WINDOW:.0f} s (µm)", fontsize="medium")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
        stories = " ".join(f"{one.name}: {one.actuator.story}" for one in study.prepared)
        drawing = Drawing.of(figure, "drift", "What the histories do to a model that does not change", stories)
    return drawing, _complete(columns)


def correlation_tests(study: Study, number: int, counterpart: str) -> tuple[Drawing, Columns]:
    """Draw the five tests of an actuator, one method beside the other, and those of the same without its history."""
    bench, steady = study.recorded[number - 1], study.benches[STEADY][number - 1]
    columns: dict[str, Array] = {}
    with draw((9.6, 8.4)) as figure:
        panels = figure.subplots(len(TESTS), len(study.methods), sharey="row", squeeze=False)
        for axes, text in zip(panels[:, 0], TESTS.values(), strict=True):
            axes.set_ylabel(f"φ {text}")
        for column, method in zip(panels.T, study.methods, strict=True):
            found, other = bench.models[method].held_out, steady.models[method].held_out
            for axes, name in zip(column, TESTS, strict=True):
                test, without = found.test(name), other.test(name)
                axes.axhspan(-test.band, test.band, color=MEASURED, alpha=0.2, linewidth=0)
                axes.vlines(test.lags, 0, test.values, color=OF_METHOD[method], linewidth=1.6, label=RECORDED)
                axes.plot(without.lags, without.values, ".", color=INK, markersize=3, label=STEADY)
                verdict = "fails" if test in found.failed else "passes"
                axes.set_title(f"{method}: {verdict}", loc="left", fontsize="small")
                key = f"{method}_{name}".replace("(", "").replace(")", "").replace("'", "")
                columns |= {
                    f"{key}_lag": test.lags.astype(np.float64),
                    key: test.values,
                    f"{key}_without_history": without.values,
                }
            column[-1].set_xlabel("lag (samples)")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=2, markerscale=3)
        drawing = Drawing.of(
            figure,
            f"tests_dea{number}",
            f"Correlation tests of {bench.name}, {' beside '.join(study.methods)} ({counterpart})",
            "Of the one-step residual over the held-out section. Grey: the band that 19 of 20 correlations lie in when "
            "one of the signals is white. The verdict looks at all lags, and allows for the colour of both signals. "
            "Dots: the same actuator without its history.",
        )
    return drawing, filled(columns)


def _around(values: Array, length: int) -> slice:
    first = int(np.clip(np.argmax(values) - length // 2, 0, max(values.size - length, 0)))
    return slice(first, first + length)


def plain_numbers(axes: Axes) -> None:
    """Write 1, 2, 5 and 10 instead of powers."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def key_of(bench: Bench) -> str:
    """The name of an actuator as it begins the names of columns."""
    return bench.name.replace(" ", "")


def _complete(columns: Columns) -> Columns:
    """The rows without a gap."""
    complete = np.all([np.isfinite(c) for c in columns.values()], axis=0)
    return {name: column[complete] for name, column in columns.items()}


def filled(columns: Columns) -> Columns:
    """Columns of one length: the shorter ones end in gaps."""
    longest = max(column.size for column in columns.values())
    return {name: np.concatenate([column, np.full(longest - column.size, np.nan)]) for name, column in columns.items()}
