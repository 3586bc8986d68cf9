"""Figures of a page: SVG whose colours are CSS variables, so that one drawing works in light and dark mode, and their data."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.arrays import Array
from deatwin.plant.drawing import Axes, Figure
from deatwin.studies.folder import ResultFolder

COLOURS = {
    "ink": ("#010a01", "#181b20", "#d7dae0"),
    "grid": ("#010a02", "#d9dce1", "#3a3f47"),
    "measured": ("#010a03", "#6b7280", "#9aa3b0"),
    "before": ("#010a04", "#c2410c", "#fb923c"),
    "after": ("#010a05", "#1d5fbf", "#7db4ff"),
    "mark": ("#010a06", "#a17700", "#d9b44a"),
    "fifth": ("#010a07", "#7c3aed", "#c4a7ff"),
    "sixth": ("#010a08", "#0f766e", "#5eead4"),
}
"""Colours by role: the one given to matplotlib, and what replaces it in light and in dark mode."""

BROAD = 540.0
"""Width in points beyond which a figure gets a row of its own, because its letters are too small in half a row."""
MINUS = re.compile(r"(?<![^\s(±=])-(?=\d)")
"""A hyphen that stands for a minus sign."""
_GREY = re.compile(r"(stroke: )?#([0-9a-f]{2})\2\2\b")
_FAINTEST, _GUIDE = 50, 20
"""_FAINTEST: least per cent of ink in a grey line that must be visible. _GUIDE: per cent of ink up to which a line is a
guide and stays faint."""
_SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",  # keeps text as text: small, selectable, in the page's own font
    "svg.hashsalt": "deatwin",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial", "Helvetica"],
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": COLOURS["grid"][0],
    "grid.linewidth": 0.6,
    "axes.edgecolor": COLOURS["ink"][0],
    "axes.labelcolor": COLOURS["ink"][0],
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "text.color": COLOURS["ink"][0],
    "xtick.color": COLOURS["ink"][0],
    "ytick.color": COLOURS["ink"][0],
    "boxplot.boxprops.color": COLOURS["ink"][0],
    "boxplot.whiskerprops.color": COLOURS["ink"][0],
    "boxplot.capprops.color": COLOURS["ink"][0],
    "boxplot.flierprops.markeredgecolor": COLOURS["ink"][0],
    "legend.frameon": False,
    "legend.markerscale": 2.5,
    "lines.linewidth": 1.1,
    "path.simplify": True,
}


@contextmanager
def draw(size: tuple[float, float]) -> Iterator[Figure]:
    """Provide a figure to draw into, in the report's style."""
    from cycler import cycler
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    cycle = cycler(color=[COLOURS[role][0] for role in ("after", "before", "measured", "mark", "fifth", "sixth")])
    with rc_context({**_SETTINGS, "axes.prop_cycle": cycle}):
        yield Figure(figsize=size, layout="constrained")


def inline(figure: Figure, name: str, title: str) -> str:
    """Return the figure as SVG for a page that defines the CSS variables; its own variable --pt is its width in points."""
    text = _source(figure)
    for role, (written, _, _) in COLOURS.items():
        text = text.replace(written, f"var(--{role})")
    text = _GREY.sub(_adaptive, text)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'(url\(|href=")#', rf"\g<1>#{name}-", text)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    label = escape(title).replace("\\", r"\\")  # of an attribute, in the replacement of a regular expression
    width = 72 * figure.get_figwidth()
    broad = ' class="broad"' if width > BROAD else ""
    opening = rf'<svg \1{broad} style="--pt: {width:.0f}" role="img" aria-label="{label}">'
    return re.sub(r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', opening, text, count=1)


def _adaptive(grey: re.Match[str]) -> str:
    """Return a grey as a mixture of ink and page colour, so that it is equally faint in light and dark mode."""
    stroke, level = grey.group(1) or "", int(grey.group(2), 16)
    ink = round(100 * (1 - level / 255))
    if stroke and ink > _GUIDE:
        ink = max(ink, _FAINTEST)
    return f"{stroke}color-mix(in srgb, var(--ink) {ink}%, var(--page))"


def standalone(figure: Figure) -> str:
    """Return the figure as an SVG file that follows the viewer's light or dark mode."""
    text = _source(figure)
    for role, (written, _, _) in COLOURS.items():
        text = text.replace(written, f"var(--{role})")
    light = ";".join(f"--{role}:{shade}" for role, (_, shade, _) in COLOURS.items())
    dark = ";".join(f"--{role}:{shade}" for role, (_, _, shade) in COLOURS.items())
    dark = f"@media(prefers-color-scheme:dark){{svg{{{dark};background:#16181d}}}}"
    style = f"<style>svg{{{light};background:#fff}}{dark}</style>"
    return re.sub(r"(<svg [^>]*>)", rf"\1{style}", text, count=1)


def legend_above(figure: Figure, axes: Axes, columns: int) -> None:
    """Put the legend of one panel above the whole figure."""
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=columns, markerscale=1)


def _source(figure: Figure) -> str:
    buffer = io.StringIO()
    with warnings.catch_warnings():  # text stays text, and the viewer's fonts have the glyphs
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return re.sub(r"(?<=>)[^<]+(?=</t)", lambda found: MINUS.sub("−", found[0]), text[text.index("<svg") :])


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawing:
    """A figure of a page, and the data behind it."""

    name: str
    title: str
    caption: str
    svg: str  # The picture
    data: str = ""  # Name of the CSV file with its data; empty if there is none
    further: tuple[str, ...] = ()  # Names of further such files
    columns: Mapping[str, ArrayLike] | str | None = None  # Content of `data`: columns, or the text of the file

    @property
    def files(self) -> tuple[str, ...]:
        """All files with its data."""
        return (self.data, *self.further) if self.data else self.further

    @classmethod
    def of(
        cls, figure: Figure, name: str, title: str, caption: str, columns: Mapping[str, ArrayLike] | str | None = None
    ) -> Drawing:
        """Return a drawn figure whose data go to ``figures/NAME.csv``; must be called before `draw` ends."""
        svg = inline(figure, name, title)
        return cls(name=name, title=title, caption=caption, svg=svg, data=f"figures/{name}.csv", columns=columns)

    def save_data(self, folder: ResultFolder) -> None:
        """Write the CSV file with its data, if the drawing holds them."""
        if isinstance(self.columns, str):
            folder.text(self.data, self.columns)
        elif self.columns is not None:
            folder.csv(self.data, self.columns)


Columns = Mapping[str, Array]


class Hue:
    """Colours by role."""

    INK, MEASURED, BEFORE, AFTER, MARK = (COLOURS[r][0] for r in ("ink", "measured", "before", "after", "mark"))


STYLES = tuple((colour, line) for line in ("-", "--") for colour in (Hue.AFTER, Hue.BEFORE, Hue.MARK))
"""Colour and line style of each of six curves."""
SUBSCRIPTS = "₀₁₂₃₄₅₆₇₈"


def panels_of(figure: Figure, rows: int, columns: int, x: str = "", y: str = "", **how: Any) -> NDArray[np.object_]:
    """Make the panels of a figure, shape (rows, columns): `x` labels the last row, `y` all panels."""
    panels: NDArray[np.object_] = figure.subplots(rows, columns, squeeze=False, **how)
    for axes in panels[-1]:
        axes.set_xlabel(x)
    if y:
        figure.supylabel(y, fontsize="medium")
    return panels


def titled(axes: Axes, text: str, size: str = "medium") -> None:
    """Write a title at the left."""
    axes.set_title(text, loc="left", fontsize=size)


def draw_runs(
    figure: Figure, timepts: Array, measured: Array, runs: Columns, unit: str, time: str = "time (s)"
) -> None:
    """Draw a measured output and the runs of models above, and what each run leaves of it below. Shapes: all (n,)."""
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    top.plot(timepts, measured, color=Hue.MEASURED, linewidth=1.8, label="measured")
    colours = (Hue.BEFORE, Hue.MARK, Hue.AFTER)[-len(runs) :]
    for (name, outputs), colour in zip(runs.items(), colours, strict=False):
        top.plot(timepts, outputs, color=colour, label=name)
        bottom.plot(timepts, measured - outputs, color=colour)
    top.set(ylabel=f"output ({unit})")
    bottom.set(ylabel=f"error ({unit})", xlabel=time)
    legend_above(figure, top, 4)


def draw_between(
    axes: Axes, x: Array, low: Array, high: Array, colour: str, label: str = "", alpha: float = 0.25
) -> None:
    """Draw a band. Shapes: `x, low, high` (n,)."""
    axes.fill_between(x, low, high, color=colour, alpha=alpha, linewidth=0, label=label or None)


def draw_map(axes: Axes, x: Array, y: Array, values: Array, **how: Any) -> Any:
    """Draw values over two axes as coloured cells. Shapes: `x` (n,); `y` (m,); `values` (n, m)."""
    axes.grid(False)
    return axes.pcolormesh(x, y, values.T, shading="nearest", rasterized=True, **how)


def share_bar(figure: Figure, mesh: Any, panels: Sequence[Axes], label: str) -> None:
    """Put one colour bar beside several panels."""
    bar = figure.colorbar(mesh, ax=list(panels), pad=0.01, aspect=12 * len(panels))
    bar.set_label(label, fontsize="small")
    if bar.solids is not None:
        bar.solids.set_rasterized(True)


def ink_on(mesh: Any, value: float) -> str:
    """Return black or white, whichever is more visible on a cell of a map."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in mesh.to_rgba(value)[:3]]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]  # as defined by WCAG 2
    return "#000001" if (luminance + 0.05) ** 2 > 1.05 * 0.05 else "#fffffe"


def key_of(name: str) -> str:
    """Return an actuator's name as a prefix for names of columns and files."""
    return name.replace(" ", "")


def filled(columns: Columns) -> Columns:
    """Extend columns to one length; shorter ones end in gaps."""
    longest = max(column.size for column in columns.values())
    return {name: np.concatenate([column, np.full(longest - column.size, np.nan)]) for name, column in columns.items()}
