"""Figures of the fleet: its responses (after figure 7.6 of the thesis), and where they differ."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.comparison.compare import Agreement, Comparison
from deatwin.scenarios.frequency_uncertainty.fleet import Consistency
from deatwin.scenarios.frequency_uncertainty.measures import column_of
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import SUBSCRIPTS, Hue, draw_between, key_of, panels_of, titled
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
WORDS = Words(__package__)
STYLES = ((Hue.AFTER, "-"), (Hue.BEFORE, "-"), (Hue.MARK, "-"), (Hue.MEASURED, "-"), (Hue.INK, "-"), (Hue.AFTER, "--"))
"""Colour and line of each of the six."""
KINDS = {
    Agreement.DIFFERENT: (Hue.BEFORE, 0.55, "differ by more than drift explains"),
    Agreement.DRIFT: (Hue.MARK, 0.3, "differ by no more than drift within the recordings"),
    Agreement.ALIKE: (Hue.MEASURED, 0.08, "no significant difference"),
}
MILLI = 1e3
"""Millimetres to the metre."""


def fleet_drawings(found: Consistency) -> list[Drawing]:
    """Draw the figures of the six actuators."""
    return [_responses(found), _pairs(found), _spread(found), _truth(found), _p_values(found)]


def _responses(found: Consistency) -> Drawing:
    """Gain of each order of each actuator, and how far it lies from the mean of the six."""
    columns: dict[str, Array] = {}
    count = len(next(iter(found.responses.values())))
    with draw((9.6, 6.2)) as figure:
        panels = panels_of(figure, 2, count, "output frequency (Hz)", sharex=True)
        for place, (above, below) in enumerate(panels.T):
            each = {name: responses[place] for name, responses in found.responses.items()}
            mean = MILLI * np.mean([one.gain for one in each.values()], axis=0)
            for (name, one), (colour, line) in zip(each.items(), STYLES, strict=False):
                frequency = one.frequency_Hz.reshape(one.gain.size, -1).sum(axis=1)
                band, key = one.gain_band(), f"H{place + 1}_{key_of(name).lower()}"
                gains = [MILLI * values for values in (band.low, one.gain, band.high)]
                from_mean = [100 * (values / mean - 1) for values in gains]
                for axes, (low, middle, high) in ((above, gains), (below, from_mean)):
                    draw_between(axes, frequency, low, high, colour, alpha=0.15)
                    axes.plot(frequency, middle, line, color=colour, linewidth=1.1, label=name)
                low, middle, high = gains
                columns |= {
                    "frequency_Hz": frequency,
                    f"{key}_mm": middle,
                    f"{key}_low_mm": low,
                    f"{key}_high_mm": high,
                }
            titled(above, f"H{SUBSCRIPTS[place + 1]} (mm/V{('', '²', '³')[place]})")
            above.set(xlim=(0, None), ylim=(0, None))
        panels[0, 0].set_ylabel("gain")
        panels[1, 0].set_ylabel("gain, from the mean of the six (%)")
        legend_above(figure, panels[0, 0], 6)
        return WORDS.drawing(figure, "fleet", columns)


def _pairs(found: Consistency) -> Drawing:
    """All pairs by order and band, as recorded and without histories."""
    from matplotlib.patches import Patch

    tables = {"as recorded": found.tables["fleet"], "without their histories": found.tables["steady"]}
    columns: dict[str, Array] = {}
    with draw((9.6, 6.4)) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        for axes, (title, table) in zip(panels, tables.items(), strict=True):
            _table(axes, table)
            titled(axes, title)
            each, key = table.differences, title.replace(" ", "_")
            columns |= {
                "order": np.array([float(d.order) for d in each]),
                "from_Hz": np.array([d.from_Hz for d in each]),
                f"{key}_size": np.array([d.size for d in each]),
                f"{key}_adjusted_p": np.array([d.adjusted for d in each]),
                f"{key}_class": np.array([float(list(Agreement).index(d.agreement)) for d in each]),
            }
        handles = [Patch(facecolor=colour, alpha=alpha, label=label) for colour, alpha, label in KINDS.values()]
        figure.legend(handles=handles, loc="outside upper left", ncols=3, fontsize="small")
        return WORDS.drawing(figure, "pairs", columns)


def _table(axes: Axes, table: Comparison) -> None:
    """Draw a field for each pair, order and band."""
    from matplotlib.patches import Rectangle

    width = len(table.columns)
    for number, difference in enumerate(table.differences):
        row, column = divmod(number, width)
        colour, alpha, _ = KINDS[difference.agreement]
        axes.add_patch(Rectangle((column, row), 1, 1, facecolor=colour, alpha=alpha, linewidth=0))
        axes.text(column + 0.5, row + 0.5, f"{100 * difference.size:.0f}", ha="center", va="center", fontsize=7)
    axes.set(xlim=(0, width), ylim=(len(table.pairs), 0))
    names = [" – ".join(name.removeprefix("DEA ") for name in pair) for pair in table.pairs]
    axes.set_yticks(np.arange(len(names)) + 0.5, names, fontsize="small")
    columns = [column_of(column) for column in table.columns]
    axes.set_xticks(np.arange(width) + 0.5, columns, rotation=60, ha="right", fontsize="small")
    axes.grid(False)


def _spread(found: Consistency) -> Drawing:
    """Standard deviation over the six, beside what the tolerances predict."""
    bars = {
        "predicted": (found.predicted, Hue.INK, "predicted from the tolerances"),
        "same_commands": (found.spread("level"), Hue.MEASURED, "without histories, all under the same commands"),
        "without_histories": (found.spread("steady"), Hue.AFTER, "without histories, each under its own"),
        "as_recorded": (found.spread("fleet"), Hue.BEFORE, "as recorded"),
    }
    orders, low, high = (np.array(column, dtype=np.float64) for column in zip(*found.columns, strict=True))
    columns: dict[str, Array] = {"order": orders, "from_Hz": low, "to_Hz": high}
    places = np.arange(len(found.columns))
    with draw((9.6, 4.0)) as figure:
        axes = figure.add_subplot()
        for number, (key, (values, colour, label)) in enumerate(bars.items()):
            columns[f"{key}_percent"] = 100 * values
            axes.bar(places + 0.2 * (number - 1.5), 100 * values, width=0.19, color=colour, alpha=0.75, label=label)
        axes.set_xticks(places, [column_of(column, "\n") for column in found.columns])
        axes.set_ylabel("standard deviation (% of the gain)")
        axes.grid(axis="x", visible=False)
        axes.set_axisbelow(True)
        legend_above(figure, axes, 2)
        return WORDS.drawing(figure, "spread", columns)


def _truth(found: Consistency) -> Drawing:
    """Measured differences over true ones."""
    every, width = found.contrasts, len(found.columns)
    orders = np.tile([float(order) for order, _, _ in found.columns], len(every) // width)
    measured, true, error = (100 * np.array([getattr(c, n) for c in every]) for n in ("measured", "true", "error"))
    style = {"fmt": ".", "color": Hue.AFTER, "ecolor": Hue.MEASURED, "elinewidth": 0.8, "markersize": 4}
    with draw((9.6, 3.8)) as figure:
        panels = panels_of(figure, 1, len(set(orders)), "true difference (% of the gain)")[0]
        for axes, order in zip(panels, sorted(set(orders)), strict=True):
            chosen, label = orders == order, "pair of actuators in a band, ± two standard errors"
            axes.errorbar(true[chosen], measured[chosen], 2 * error[chosen], label=label, **style)
            ends = np.array([0.0, true[chosen].max()])
            axes.plot(ends, ends, color=Hue.INK, linewidth=0.8, label="equal")
            titled(axes, f"H{SUBSCRIPTS[int(order)]}")
        panels[0].set_ylabel("measured difference (%)")
        legend_above(figure, panels[0], 2)
        columns = {
            "pair": np.repeat(np.arange(1.0, len(every) // width + 1), width),
            "order": orders,
            "true_percent": true,
            "measured_percent": measured,
            "standard_error_percent": error,
        }
        return WORDS.drawing(figure, "truth", columns)


def _p_values(found: Consistency) -> Drawing:
    """How the p-values are distributed where nothing differs, and where actuators do."""
    groups = {
        "repeats": ("repeats of one stationary actuator", Hue.MEASURED),
        "steady": ("six without histories", Hue.AFTER),
        "fleet": ("six as recorded", Hue.BEFORE),
    }
    axis = np.linspace(0, 1, 201)
    columns: dict[str, Array] = {"p_value": axis}
    with draw((9.6, 3.8)) as figure:
        panels = panels_of(figure, 1, 2, "p-value of a single test")[0]
        for group, (label, colour) in groups.items():
            for axes, name in zip(panels, ("differences", "drifts"), strict=True):
                values = np.sort([test.p_value for test in getattr(found.tables[group], name)])
                share = np.searchsorted(values, axis, side="right") / values.size
                axes.plot(axis, 100 * share, color=colour, label=label)
                columns[f"{name}_{group}_share"] = share
        for axes, title in zip(panels, ("differences between records", "drifts within a record"), strict=True):
            axes.plot([0, 1], [0, 100], ":", color=Hue.INK, label="where nothing differs")
            titled(axes, title)
            axes.set(xlim=(-0.01, 1), ylim=(0, 101))
        panels[0].set_ylabel("tests with a smaller one (%)")
        legend_above(figure, panels[0], 4)
        return WORDS.drawing(figure, "p_values", columns, pairs=len(found.tables["repeats"].pairs))
