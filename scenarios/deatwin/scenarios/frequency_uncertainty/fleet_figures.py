"""Figures of the fleet: its responses (after figure 7.6 of the thesis), and where they differ."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.scenarios.frequency_uncertainty.fleet import Consistency
from deatwin.scenarios.frequency_uncertainty.measures import column_of
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import SUBSCRIPTS, Hue, draw_between, key_of, panels_of, titled
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words

if TYPE_CHECKING:
    pass

Array = NDArray[np.float64]
WORDS = Words(__package__)
STYLES = ((Hue.AFTER, "-"), (Hue.BEFORE, "-"), (Hue.MARK, "-"), (Hue.MEASURED, "-"), (Hue.INK, "-"), (Hue.AFTER, "--"))
"""Colour and line of each of the six."""
MILLI = 1e3
"""Millimetres to the metre."""


def fleet_drawings(found: Consistency) -> list[Drawing]:
    """Draw what is said of the fleet."""
    return [_responses(found), _spread(found)]


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
