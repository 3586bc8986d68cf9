"""The page of the prestretch sweep."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.origin import Origin
from deatwin.studies.report.rendering import write_page
from deatwin.studies.report.svg import draw, inline, standalone

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Columns = Mapping[str, np.ndarray]


def write_sweep(
    folder: ResultFolder, result: Mapping[str, Any], columns: Columns, ratios: Columns, record: RunRecord
) -> None:
    """Write ``report.html`` and ``prestretch.svg``."""
    title = "What changes with the prestretch"
    with draw((9.6, 6.0)) as figure:
        _panels(figure, columns, ratios)
        folder.text("prestretch.svg", standalone(figure))
        drawing = Drawing(
            name="prestretch",
            title=title,
            svg=inline(figure, "prestretch", title),
            data="prestretch.csv",
            further=("unequal.csv",),
            caption="A square film of VHB 4905 under equal dead loads. Below, in the middle: under unequal loads, at "
            "equal thickness. Below, on the right: the ball of the thesis' rig.",
        )
    write_page(folder, "prestretch.html.j2", [drawing], Origin.of(record), __package__, result=result, figure=drawing)


def _panels(figure: Figure, columns: Columns, ratios: Columns) -> None:
    stretch = columns["prestretch"]
    axes = figure.subplots(2, 3)
    strain, volts, limits, prompt, directed, ball = axes.flat
    strain.plot(stretch, 100 * columns["strain_at_1kV"])
    strain.set(title="strain at 1 kV (%)")
    volts.semilogy(stretch, columns["voltage_for_5_percent_V"], label="for 5 % strain")
    volts.semilogy(stretch, columns["pull_in_V"], label="pull-in")
    volts.semilogy(stretch, columns["breakdown_V"], label="breakdown")
    volts.semilogy(stretch, np.where(columns["slack_V"] > 0, columns["slack_V"], np.nan), label="slack in a frame")
    volts.set(title="voltages (V)", ylim=(500, 4e4))
    volts.legend(fontsize="x-small", ncols=2)
    limits.plot(stretch, 100 * columns["largest_strain"])
    limits.set(title="largest strain (%)")
    prompt.plot(stretch, 100 * columns["prompt_share"], label="of a step's strain within 20 ms")
    prompt.plot(stretch, 100 * columns["tension_lost"], label="of the tension lost after mounting")
    prompt.set(title="shares (%)", ylim=(0, 100))
    prompt.legend(fontsize="x-small")
    directed.plot(ratios["ratio"], 100 * ratios["strain_along"], label="along")
    directed.plot(ratios["ratio"], 100 * ratios["strain_across"], label="across")
    directed.set(title="strain at 1 kV, unequal (%)")
    directed.legend(fontsize="x-small")
    ball.plot(stretch, columns["ball_at_2kV_mm"])
    ball.set(title="ball at 2 kV (mm)")
    for panel in axes.flat:
        panel.set_xlabel("prestretch")
        panel.title.set_fontsize("medium")
    directed.set_xlabel("prestretch across / along")
