"""SVG figures whose colours are CSS variables, so that one drawing works in light and dark mode."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    """Return the figure as SVG for a page that defines the CSS variables."""
    text = _source(figure)
    for role, (written, _, _) in COLOURS.items():
        text = text.replace(written, f"var(--{role})")
    text = _GREY.sub(_adaptive, text)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'(url\(|href=")#', rf"\g<1>#{name}-", text)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    opening = rf'<svg \1 role="img" aria-label="{_escaped(title)}">'
    return re.sub(r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', opening, text, count=1)


def _escaped(title: str) -> str:
    """Escape text for an attribute and for a regular-expression replacement."""
    from html import escape

    return escape(title).replace("\\", r"\\")


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
    return text[text.index("<svg") :]
