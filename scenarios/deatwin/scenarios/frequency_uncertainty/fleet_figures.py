"""Figures of the fleet: its responses (after figure 7.6 of the thesis), and where they differ."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.comparison.compare import Agreement, Comparison
from deatwin.scenarios.frequency_uncertainty.consistency import Consistency
from deatwin.scenarios.frequency_uncertainty.words import band_of, column_of
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import COLOURS, draw, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
Columns = Mapping[str, Array]
INK, GREY, BEFORE, AFTER, MARK = (COLOURS[role][0] for role in ("ink", "measured", "before", "after", "mark"))
STYLES = ((AFTER, "-"), (BEFORE, "-"), (MARK, "-"), (GREY, "-"), (INK, "-"), (AFTER, "--"))
"""Of the six."""
FILLS = {Agreement.DIFFERENT: (BEFORE, 0.55), Agreement.DRIFT: (MARK, 0.3), Agreement.ALIKE: (GREY, 0.08)}
NAMES = {
    Agreement.DIFFERENT: "differ by more than drift explains",
    Agreement.DRIFT: "differ, and drift within the records reaches that far",
    Agreement.ALIKE: "no significant difference",
}
MILLI = 1e3
"""Millimetres to the metre."""


def fleet_drawings(found: Consistency) -> list[tuple[Drawing, Columns]]:
    """Draw what is said of the fleet."""
    return [_responses(found), _pairs(found), _spread(found), _truth(found), _p_values(found)]


def _responses(found: Consistency) -> tuple[Drawing, Columns]:
    """Gain of each order of each actuator, and how far it lies from the mean of the six."""
    columns: dict[str, Array] = {}
    count = len(next(iter(found.responses.values())))
    with draw((9.6, 6.2)) as figure:
        panels = figure.subplots(2, count, sharex=True)
        for place, (above, below) in enumerate(panels.T):
            of = {name: each[place] for name, each in found.responses.items()}
            mean = np.mean([one.gain for one in of.values()], axis=0)
            for (name, one), (colour, line) in zip(of.items(), STYLES, strict=False):
                frequency = one.frequency_Hz.reshape(one.gain.size, -1).sum(axis=1)
                band = one.gain_band()
                for axes, scaled in ((above, lambda v: MILLI * v), (below, lambda v, m=mean: 100 * (v / m - 1))):
                    low, middle, high = (scaled(v) for v in (band.low, one.gain, band.high))
                    axes.fill_between(frequency, low, high, color=colour, alpha=0.15, linewidth=0)
                    axes.plot(frequency, middle, line, color=colour, linewidth=1.1, label=name)
                key = f"H{place + 1}_{name.replace(' ', '').lower()}"
                columns |= {
                    "frequency_Hz": frequency,
                    f"{key}_mm": MILLI * one.gain,
                    f"{key}_low_mm": MILLI * band.low,
                    f"{key}_high_mm": MILLI * band.high,
                }
            power = "" if place == 0 else f"{'⁰¹²³'[place + 1]}"
            above.set_title(f"H{'₁₂₃'[place]} (mm/V{power})", loc="left", fontsize="medium")
            below.set_xlabel("output frequency (Hz)")
            for axes in (above, below):
                axes.set_xlim(0, None)
            above.set_ylim(0, None)
        panels[0, 0].set_ylabel("gain")
        panels[1, 0].set_ylabel("gain, from the mean of the six (%)")
        legend_above(figure, panels[0, 0], 6)
        drawing = Drawing.of(
            figure,
            "fleet",
            "Responses of the six actuators with their bands (thesis figure 7.6)",
            "As recorded, about 2.4 V; H₂ and H₃ with equal tones, over the sum of their frequencies. Bands: 95 % at "
            "each frequency, from the scatter of the parameters that each record shows.",
        )
    return drawing, columns


def _pairs(found: Consistency) -> tuple[Drawing, Columns]:
    """All pairs by order and band, as recorded and without histories."""
    tables = {"as recorded": found.tables["fleet"], "without their histories": found.tables["steady"]}
    columns: dict[str, Array] = {}
    with draw((9.6, 6.4)) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        for axes, (title, table) in zip(panels, tables.items(), strict=True):
            _table(axes, table)
            axes.set_title(title, loc="left", fontsize="medium")
            key = title.replace(" ", "_")
            columns |= {
                "order": np.array([float(d.order) for d in table.differences]),
                "from_Hz": np.array([d.from_Hz for d in table.differences]),
                f"{key}_size": np.array([d.size for d in table.differences]),
                f"{key}_adjusted_p": np.array([d.adjusted for d in table.differences]),
                f"{key}_class": np.array([float(list(Agreement).index(d.agreement)) for d in table.differences]),
            }
        figure.legend(handles=_patches(), loc="outside upper left", ncols=3, fontsize="small")
        drawing = Drawing.of(
            figure,
            "pairs",
            "Where the actuators differ, by order and band",
            "Numbers: size of the difference, in % of the gain. Level 5 %, corrected for all tests of a panel (Holm). "
            "Left: the recordings as they are. Right: the same actuators, commands and noise without what happens to "
            "them while they are recorded, which only a simulation can show: what fabrication alone makes.",
        )
    return drawing, columns


def _table(axes: Axes, table: Comparison) -> None:
    from matplotlib.patches import Rectangle

    width = len(table.columns)
    for number, difference in enumerate(table.differences):
        row, column = divmod(number, width)
        colour, alpha = FILLS[difference.agreement]
        axes.add_patch(Rectangle((column, row), 1, 1, facecolor=colour, alpha=alpha, linewidth=0))
        axes.text(column + 0.5, row + 0.5, f"{100 * difference.size:.0f}", ha="center", va="center", fontsize=7)
    axes.set(xlim=(0, width), ylim=(len(table.pairs), 0))
    names = [f"{one.removeprefix('DEA ')} – {other.removeprefix('DEA ')}" for one, other in table.pairs]
    axes.set_yticks(np.arange(len(names)) + 0.5, names, fontsize="small")
    columns = [column_of(column) for column in table.columns]
    axes.set_xticks(np.arange(width) + 0.5, columns, rotation=60, ha="right", fontsize="small")
    axes.grid(False)


def _patches() -> list[object]:
    from matplotlib.patches import Patch

    return [Patch(facecolor=FILLS[kind][0], alpha=FILLS[kind][1], label=NAMES[kind]) for kind in FILLS]


def _spread(found: Consistency) -> tuple[Drawing, Columns]:
    """Standard deviation over the six, beside what the tolerances predict."""
    of = {
        "predicted from the tolerances": 100 * found.predicted,
        "without histories, all under the same commands": 100 * found.spread("level"),
        "without histories, each under its own": 100 * found.spread("steady"),
        "as recorded": 100 * found.spread("fleet"),
    }
    places = np.arange(len(found.columns))
    with draw((9.6, 4.0)) as figure:
        axes = figure.add_subplot()
        for number, ((label, values), colour) in enumerate(zip(of.items(), (INK, GREY, AFTER, BEFORE), strict=True)):
            axes.bar(places + 0.2 * (number - 1.5), values, width=0.19, color=colour, alpha=0.75, label=label)
        axes.set_xticks(places, [f"H{'₁₂₃'[order - 1]}\n{band_of(low, high)}" for order, low, high in found.columns])
        axes.set_ylabel("standard deviation (% of the gain)")
        axes.grid(axis="x", visible=False)
        axes.set_axisbelow(True)
        legend_above(figure, axes, 2)
        drawing = Drawing.of(
            figure,
            "spread",
            "How consistent fabrication is, by order and band",
            "Standard deviation of the six about their mean, less the scatter of the estimates. The prediction is "
            "to first order, from the specification with one quantity after the other at the end of its tolerance; "
            "six actuators may by chance (95 %) have 0.4 to 1.6 times the standard deviation that they are drawn "
            "from.",
        )
    keys = ("predicted", "same_commands", "without_histories", "as_recorded")
    orders, low, high = (np.array(column, dtype=np.float64) for column in zip(*found.columns, strict=True))
    return drawing, {"order": orders, "from_Hz": low, "to_Hz": high} | {
        f"{key}_percent": values for key, values in zip(keys, of.values(), strict=True)
    }


def _truth(found: Consistency) -> tuple[Drawing, Columns]:
    """Measured differences over true ones."""
    every, width = found.contrasts, len(found.columns)
    orders = np.array([order for order, _, _ in found.columns])
    measured, true, error = (100 * np.array([getattr(c, n) for c in every]) for n in ("measured", "true", "error"))
    with draw((9.6, 3.8)) as figure:
        panels = figure.subplots(1, len(set(orders.tolist())))
        for axes, order in zip(panels, sorted(set(orders.tolist())), strict=True):
            chosen = np.tile(orders == order, len(every) // width)
            axes.errorbar(
                true[chosen],
                measured[chosen],
                2 * error[chosen],
                fmt=".",
                color=AFTER,
                ecolor=GREY,
                elinewidth=0.8,
                markersize=4,
                label="pair of actuators in a band, ± two standard errors",
            )
            ends = np.array([0.0, true[chosen].max()])
            axes.plot(ends, ends, color=INK, linewidth=0.8, label="equal")
            axes.set_title(f"H{'₁₂₃'[order - 1]}", loc="left", fontsize="medium")
            axes.set_xlabel("true difference (% of the gain)")
        panels[0].set_ylabel("measured difference (%)")
        legend_above(figure, panels[0], 2)
        drawing = Drawing.of(
            figure,
            "truth",
            "Differences as measured and as they are",
            "Without histories. Measured: each actuator under commands of its own. True: the same actuators under one "
            "command, with one sensor's noise, so that nothing differs but the actuators. Along the direction of the "
            "true difference in the complex plane.",
        )
    pair = np.repeat(np.arange(1.0, len(every) // width + 1), width)
    return drawing, {
        "pair": pair,
        "order": np.tile(orders.astype(np.float64), len(every) // width),
        "true_percent": true,
        "measured_percent": measured,
        "standard_error_percent": error,
    }


def _p_values(found: Consistency) -> tuple[Drawing, Columns]:
    """How the p-values are distributed where nothing differs, and where actuators do."""
    groups = {
        "repeats of one stationary actuator": ("repeats", GREY),
        "six without histories": ("steady", AFTER),
        "six as recorded": ("fleet", BEFORE),
    }
    columns: dict[str, Array] = {}
    axis = np.linspace(0, 1, 201)
    with draw((9.6, 3.8)) as figure:
        left, right = figure.subplots(1, 2)
        for label, (group, colour) in groups.items():
            table = found.tables[group]
            tests = {
                "differences": (left, [d.p_value for d in table.differences]),
                "drifts": (right, [d.p_value for d in table.drifts]),
            }
            for name, (axes, p_values) in tests.items():
                values = np.sort(p_values)
                share = np.searchsorted(values, axis, side="right") / values.size
                axes.plot(axis, 100 * share, color=colour, label=label)
                columns |= {"p_value": axis, f"{name}_{group}_share": share}
        for axes, title in ((left, "differences between records"), (right, "drifts within a record")):
            axes.plot([0, 1], [0, 100], ":", color=INK, label="where nothing differs")
            axes.set_title(title, loc="left", fontsize="medium")
            axes.set(xlabel="p-value of a single test", xlim=(-0.01, 1), ylim=(0, 101))
        left.set_ylabel("tests with a smaller one (%)")
        legend_above(figure, left, 4)
        drawing = Drawing.of(
            figure,
            "p_values",
            "What the tests say where nothing differs",
            f"Before any correction. Repeats: {len(found.tables['repeats'].pairs)} pairs of records of one actuator "
            "without its history, each under commands of its own. A curve below the diagonal means that the tests are "
            "cautious, one above it that they find too much where nothing is.",
        )
    return drawing, columns
