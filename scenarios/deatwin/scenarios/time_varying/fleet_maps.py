"""Maps of the actuators over time and frequency: TV-GFRFs, TV-NOFRFs, and short-time spectra."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.wander import VARYING
from deatwin.scenarios.time_varying.benchmark import LINES, ORDERS
from deatwin.scenarios.time_varying.benchmark_figures import plain_name, symbol_of
from deatwin.scenarios.time_varying.figure_parts import Columns, draw_map, filled, map_columns, share_bar
from deatwin.scenarios.time_varying.fleet_figures import key_of
from deatwin.scenarios.time_varying.study import LEVEL, Driven
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.svg import draw

Array = NDArray[np.float64]
DYNAMIC_DB = 60.0
CLEAR = 0.95
"""Share of a map within its colours: beside a notch that moves changes have no bound."""
HIGHEST_HZ = 3.0
"""Of the spectra that are drawn."""


def map_drawings(shown: Sequence[Driven]) -> list[tuple[Drawing, Columns]]:
    """Draw the maps of some actuators."""
    return [
        _changes(
            shown,
            list(LINES),
            "tv_gfrf",
            "TV-GFRFs of two actuators that drift differently",
            "Change of the gain, over its mean along time at each frequency, about the equilibrium of each time at "
            "2.4 V; above each map the range of the gain itself. Sharp lines: a gain passes near zero.",
        ),
        _changes(
            shown,
            [f"G{n}" for n in ORDERS],
            "tv_nofrf",
            "TV-NOFRFs of the same two",
            f"Likewise, for a test signal with equal lines from 0.05 to 1 Hz and a peak of {LEVEL:g} V. Gₙ reaches as "
            "far as the n-th power of the signal.",
        ),
        _spectra(shown),
    ]


def _changes(
    shown: Sequence[Driven], names: Sequence[str], key: str, title: str, caption: str
) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    with draw((9.6, 2.4 * len(names))) as figure:
        panels = figure.subplots(len(names), len(shown), sharex=True, sharey="row", squeeze=False)
        for row, name in zip(panels, names, strict=True):
            largest = max(float(np.quantile(np.abs(one.maps[name].change_dB), CLEAR)) for one in shown)
            for axes, one in zip(row, shown, strict=True):
                found = one.maps[name]
                mesh = draw_map(
                    axes, found.timepts, found.frequencies, found.change_dB, vmin=-largest, vmax=largest, cmap="RdBu_r"
                )
                low, high = 1e6 * found.gain.min(), 1e6 * found.gain.max()
                order = int(name[1])
                unit = "µm/V" if order == 1 else f"µm/V{'²³'[order - 2]}"
                axes.set_title(
                    f"{one.name}, {symbol_of(name)}: {low:.3g} to {high:.3g} {unit}", loc="left", fontsize="small"
                )
                columns |= map_columns(
                    f"{key_of(one)}_{plain_name(name)}",
                    found.timepts,
                    found.frequencies,
                    gain_um=1e6 * found.gain,
                    change_dB=found.change_dB,
                )
            row[0].set_ylabel("f₁ (Hz)" if "," in name else "frequency (Hz)")
            share_bar(figure, mesh, row, "change (dB)")
        for axes in panels[-1]:
            axes.set_xlabel("time (s)")
        drawing = Drawing.of(figure, key, title, caption)
    return drawing, filled(columns)


def _spectra(shown: Sequence[Driven]) -> tuple[Drawing, Columns]:
    columns: dict[str, Array] = {}
    spectra = [(one, one.whole) for one in shown if one.whole is not None]
    with draw((9.6, 7.0)) as figure:
        panels = figure.subplots(3, len(spectra), sharex=True, sharey=True, squeeze=False)
        for column, (one, found) in zip(panels.T, spectra, strict=True):
            inside = found.frequencies <= HIGHEST_HZ
            sides = (found.recorded, found.predicted[VARYING])
            recorded, predicted = (20 * np.log10(np.abs(side[:, inside]) + 1e-12) + 120 for side in sides)
            frequencies, top = found.frequencies[inside], float(recorded.max())
            for axes, values, word in zip(column, (recorded, predicted), ("recorded", "from TV-NOFRFs"), strict=False):
                level = draw_map(axes, found.timepts, frequencies, values, vmin=top - DYNAMIC_DB, vmax=top)
                axes.set_title(f"{one.name}, {word}", loc="left", fontsize="small")
            change = draw_map(
                column[2], found.timepts, frequencies, predicted - recorded, vmin=-6.0, vmax=6.0, cmap="RdBu_r"
            )
            column[2].set_title(f"{one.name}, predicted over recorded", loc="left", fontsize="small")
            column[2].set_xlabel("time (s)")
            columns |= map_columns(
                key_of(one), found.timepts, frequencies, recorded_dB_um=recorded, predicted_dB_um=predicted
            )
        for axes in panels[:, 0]:
            axes.set_ylabel("frequency (Hz)")
        share_bar(figure, level, panels[:2].ravel().tolist(), "amplitude (dB over 1 µm)")
        share_bar(figure, change, panels[2].tolist(), "difference (dB)")
        drawing = Drawing.of(
            figure,
            "short_time",
            "Short-time spectrum of the reading, recorded and from the TV-NOFRFs",
            "Hann windows of 20 s, overlapping by half. In each the command is taken for one period, and "
            "Y = G₁U₁ + … + G₅U₅ with the parameters of the window's middle; the parameters are those of the whole "
            "record. Single lines differ where the spectrum happens to be low.",
        )
    return drawing, filled(columns)
