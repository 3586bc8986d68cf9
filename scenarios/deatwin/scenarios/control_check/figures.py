"""The figures: closed loops, numbers of five models, and verdicts on random rigs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deatwin.scenarios.control_check.concealed import Concealed
from deatwin.scenarios.control_check.study import Study
from deatwin.scenarios.control_check.tables import MICRO
from deatwin.scenarios.control_check.tracking import SETTLED, Tracking
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue, filled, titled
from deatwin.studies.report.svg import draw, legend_above
from deatwin.studies.report.words import Words

if TYPE_CHECKING:
    pass

WORDS = Words(__package__)
Array = NDArray[np.float64]
STRETCH = 10.0
"""Length of the tones that is drawn, s."""
SHOWN = {
    "PI": (Hue.BEFORE, "-", "PI alone"),
    "inverse": (Hue.AFTER, "-", "PI behind the inverse"),
    "inverse with dynamics": (Hue.MARK, "-", "the same, with dynamics"),
    "oracle: inverse with dynamics": (Hue.INK, ":", "oracle, with dynamics"),
}


def drawings(study: Study) -> list[Drawing]:
    """Draw all figures."""
    return [_tracking(study.tracking), _concealed(study.concealed)]


# --- closed loops ---------------------------------------------------------------------------------------------------


def _tracking(every: Sequence[Tracking]) -> Drawing:
    """Errors on the tones over a stretch of time, all of them and the small ones."""
    nominal = every[0]
    with draw((9.6, 5.2)) as figure:
        above, below = figure.subplots(2, 1, sharex=True)
        for axes, hidden in ((above, ()), (below, ("PI", "inverse"))):
            for name, (colour, line, label) in SHOWN.items():
                if name not in hidden:
                    run = nominal.tracked[name].run
                    part = slice(*np.searchsorted(run.timepts, (SETTLED, SETTLED + STRETCH)))
                    axes.plot(run.timepts[part], MICRO * run.error[part], line, color=colour, label=label)
            axes.set_ylabel("error (µm)")
        titled(above, f"{nominal.name}: all")
        titled(below, "the two smallest, enlarged")
        below.set_xlabel("time (s)")
        legend_above(figure, above, 4)
        columns: dict[str, Array] = {}
        for tracking in every:
            longest = max((one.run for one in tracking.tracked.values()), key=lambda run: run.timepts.size)
            where = tracking.name.replace(" ", "_")
            columns |= {"time_s": longest.timepts, f"{where}_reference_um": MICRO * longest.reference}
            for name, one in tracking.tracked.items():
                key = name.replace(": ", "_").replace(" ", "_")
                columns[f"{where}_{key}_error_um"] = MICRO * one.run.error
        return WORDS.drawing(figure, "tracking", filled(columns), settled=SETTLED)


def _concealed(every: Sequence[Concealed]) -> Drawing:
    """Steps of both designs on the true plant, an effect a panel."""
    columns: dict[str, Array] = {}
    with draw((9.6, 2.0 + 2.0 * len(every))) as figure:
        panels = figure.subplots(len(every), 1, squeeze=False)[:, 0]
        for axes, one in zip(panels, every, strict=True):
            longest = max((d.runs.steps for d in one.designs), key=lambda run: run.timepts.size)
            reference = MICRO * longest.reference
            axes.plot(longest.timepts, reference, color=Hue.INK, linewidth=2.4, alpha=0.3, label="reference")
            columns |= {
                f"{one.effect}_time_s": longest.timepts,
                f"{one.effect}_reference_um": reference,
            }
            for designed, colour in zip(one.designs, (Hue.BEFORE, Hue.AFTER), strict=True):
                run, label = designed.runs.steps, f"design from the {designed.source} model"
                axes.plot(run.timepts, MICRO * run.output, color=colour, label=label)
                columns[f"{one.effect}_{designed.source}_output_um"] = MICRO * run.output
            said, was = (
                ", ".join(f"{d.source} {getattr(d, kind).verdict.value}" for d in one.designs)
                for kind in ("check", "truth")
            )
            title = f"{one.effect.replace('_', ' ')} concealed. Check: {said}. True rig: {was}"
            titled(axes, title)
            axes.set_ylabel("displacement (µm)")
        panels[-1].set_xlabel("time (s)")
        legend_above(figure, panels[0], 3)
        return WORDS.drawing(figure, "concealed", filled(columns))


# --- predictions ----------------------------------------------------------------------------------------------------
