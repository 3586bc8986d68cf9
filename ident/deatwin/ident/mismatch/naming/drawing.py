"""Draw the residuals of explanations and rig variants, compared with the sensor's noise."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from deatwin.ident.mismatch.naming.rows import Explanations, Forms, Row, in_words, row_of, variant_rows
from deatwin.plant.amplitudes import written_amplitude

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from deatwin.ident.mismatch.naming.candidate import Candidate


MOST = 12
"""Number of candidates that are drawn, unless more than this cannot be ruled out."""
WIDE = 20.0
"""Ratio of the largest to the smallest bar above which the axis is logarithmic, because small bars would look alike."""
THICK = 0.38
"""Height of a bar with its gap, if rows are 1 apart."""
WIDTH, HEIGHT, GAP, LINE = 6.8, 1.8, 0.06, 0.15
"""Size of a new figure in inches: its width, the height of everything but the rows, the gap between rows, and the
height of a line; each row has room for the lines of the longest name."""
LABEL, TITLE = 36, 66
"""Largest number of characters in a line of a row's name, and of the title."""
COLOURS = {
    "chosen": "C0",
    "other form": "0.7",
    "best explanation": "C0",
    "not ruled out": "C1",
    "base plant": "0.4",
    "other": "0.7",
}
"""Colour of each role, in the legend's order."""


@dataclass(frozen=True, kw_only=True)
class _Level:
    """Reference level that is drawn across all bars, SI."""

    name: str
    size: float
    style: str


def draw_base(base: Forms, ax: Axes | None = None) -> Axes:
    """Draw the residuals of each variant of the base plant."""
    chosen = base.chosen
    rig = chosen.calibration.plant.rig
    floor = _Level(name="noise and model error", size=float(np.hypot(base.noise, rig.model_error)), style="--")
    left = max(chosen.fitted_test.size, chosen.unseen_test.size)
    title = (
        f"left beyond the noise: {_amplitude(left, rig.output_unit)}; "
        f"the plant's own model error: {_amplitude(rig.model_error, rig.output_unit)}"
    )
    return _draw(variant_rows(base), [_noise(base.noise), floor], title, ax)


def draw_naming(naming: Explanations, ax: Axes | None = None) -> Axes:
    """Draw the residuals of each candidate."""
    rows = [row_of(candidate, naming) for candidate in _shown(naming)]
    return _draw(rows, [_noise(naming.noise)], _conclusion(naming, len(rows) - 1), ax)


def _shown(naming: Explanations) -> list[Candidate]:
    """Return the base plant, the answer, its alternatives and others, the best on held-out data first."""
    needed = [c for c in (naming.best, *naming.alternatives) if c is not None]
    others = sorted((c for c in naming.candidates[1:] if c not in needed), key=_unseen)
    room = max(MOST - 1 - len(needed), 0)
    return [naming.base, *sorted([*needed, *others[:room]], key=_unseen)]


def _unseen(candidate: Candidate) -> float:
    return candidate.unseen_test.rms


def _conclusion(naming: Explanations, shown: int) -> str:
    """Return what was found and, on a second line, what the bars do not show."""
    tried = len(dict.fromkeys((*naming.candidates[1:], *naming.alternatives)))
    if naming.best is not None:
        found = f"best explanation: {in_words(naming.best)}"
    else:
        found = "no effect explains the recordings" if tried else "no effect was tried"
    hidden = [f"{shown} of {tried} that were tried"] if shown < tried else []
    hidden += [f"{len(naming.failed)} could not be tried"] if naming.failed else []
    return "\n".join([found, *(["; ".join(hidden)] if hidden else [])])


def _draw(rows: Sequence[Row], levels: Sequence[_Level], title: str, ax: Axes | None) -> Axes:
    """Draw two bars per row: fitted data above held-out data."""
    names = [_wrapped(row.name, LABEL) for row in rows]
    axes = _new_axes(names) if ax is None else ax
    output_unit = rows[0].candidate.calibration.plant.rig.output_unit
    unit, size = written_amplitude(output_unit)
    sizes = np.array([row.sizes for row in rows]) / size
    places, colours = np.arange(len(rows)), [COLOURS[row.role] for row in rows]
    axes.barh(places - THICK / 2, sizes[:, 0], 0.85 * THICK, color="none", edgecolor=colours)
    axes.barh(places + THICK / 2, sizes[:, 1], 0.85 * THICK, color=colours, edgecolor=colours)
    for level in levels:
        name = f"{level.name}, {_amplitude(level.size, output_unit)}"
        axes.axvline(level.size / size, color="0.2", linestyle=level.style, linewidth=1.2, label=name)
    axes.set_yticks(places, names, fontsize="small")
    axes.set_ylim(len(rows) - 0.4, -0.6)
    _scale(axes, sizes, [level.size / size for level in levels])
    axes.set_xlabel(f"rms residual ({unit})" if unit else "rms residual")
    _explain(axes, rows, title)
    return axes


def _new_axes(names: Sequence[str]) -> Axes:
    from matplotlib import pyplot

    row = GAP + LINE * max(2, *(name.count("\n") + 1 for name in names))
    return pyplot.subplots(figsize=(WIDTH, HEIGHT + row * len(names)), layout="constrained")[1]


def _scale(axes: Axes, sizes: np.ndarray, levels: Sequence[float]) -> None:
    """Start the axis at 0, or make it logarithmic if the sizes differ widely."""
    seen = sizes[sizes > 0.0]
    if seen.size and seen.max() > WIDE * seen.min():
        axes.set_xscale("log")
        axes.set_xlim(left=0.5 * min([seen.min(), *(level for level in levels if level > 0.0)]))
    else:
        axes.set_xlim(left=0.0)


def _explain(axes: Axes, rows: Sequence[Row], title: str) -> None:
    """Place the legend above the bars, which it would hide, and the title above the legend."""
    from matplotlib.patches import Patch

    lines, _ = axes.get_legend_handles_labels()
    parts = [
        Patch(facecolor="none", edgecolor="0.2", label="fitted part"),
        Patch(facecolor="0.2", edgecolor="0.2", label="held-out part"),
    ]
    present = {row.role for row in rows}
    roles = [Patch(color=colour, label=role) for role, colour in COLOURS.items() if role in present]
    legend = axes.legend(
        handles=[*parts, *roles, *lines],
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.2,
        ncols=2,
        frameon=False,
        fontsize="small",
    )
    high = legend.get_window_extent().height / axes.figure.dpi
    written = "\n".join(_wrapped(line, TITLE) for line in title.split("\n"))
    axes.set_title(written, fontsize="small", loc="left", pad=72.0 * high + 6.0)


def _noise(size: float) -> _Level:
    return _Level(name="sensor noise", size=size, style=":")


def _amplitude(value: float, output_unit: str) -> str:
    unit, size = written_amplitude(output_unit)
    return f"{value / size:.3g} {unit}".rstrip()


def _wrapped(text: str, width: int) -> str:
    """Break text after a sign or before a bracket, so that no name is split."""
    whole = re.sub(r"(?<![+,;]) (?!\()", "\N{NO-BREAK SPACE}", text)
    return fill(whole, width, break_long_words=False, break_on_hyphens=False).replace("\N{NO-BREAK SPACE}", " ")
