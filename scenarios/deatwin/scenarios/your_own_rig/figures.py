"""The figure that holds both integrators against each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.panels import Hue
from deatwin.studies.report.svg import draw

Array = NDArray[np.float64]


def agreement(timepts: Array, road: Array, here: Array, elsewhere: Array, noise: float) -> Drawing:
    """Draw the bumps, the travel as both compute it, and their difference. Shapes: (n,)."""
    difference = 1e6 * (here - elsewhere)
    with draw((9.6, 5.8)) as figure:
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2, 3, 2))
        top.fill_between(timepts, 1e3 * road, -60.0, color=Hue.MEASURED, alpha=0.5, linewidth=0, step="post")
        top.set(ylabel="road (mm)")
        middle.plot(timepts, 1e3 * elsewhere, color=Hue.INK, linewidth=2.4, label="scipy, its own equations")
        middle.plot(timepts, 1e3 * here, color=Hue.AFTER, linewidth=1.0, label="deatwin, the user's file and the drag")
        middle.set(ylabel="travel (mm)")
        bottom.plot(timepts, difference, color=Hue.AFTER)
        bottom.set(ylabel="difference (µm)", xlabel="time (s)")
        figure.legend(*middle.get_legend_handles_labels(), loc="outside upper left", ncols=2)
        return Drawing.of(
            figure,
            "agreement",
            "One car, computed twice",
            f"Bumps and a pothole, without sensor noise. Both simulations include the drag, which the diagnosis does "
            f"not know. Their difference is far below the sensor noise of {1e6 * noise:.0f} µm rms.",
            {
                "time_s": timepts,
                "road_mm": 1e3 * road,
                "deatwin_mm": 1e3 * here,
                "scipy_mm": 1e3 * elsewhere,
                "difference_um": difference,
            },
        )
