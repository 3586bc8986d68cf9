"""Draw each kind of rig with its dimensions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import RigError
from deatwin.plant.material import material
from deatwin.plant.prefixes import with_unit
from deatwin.plant.rigs.base import Rig

FILM, ELECTRODE, BODY = "C2", "C0", "C1"  # Colours of the film, of its electrode, and of parts that hold or move it
Point = tuple[float, float]


@dataclass(frozen=True)
class _Pen:
    """Draws in units of half the drawing's height."""

    ax: Axes

    def line(self, *points: Point, colour: str = FILM, width: float = 1.6, style: str = "-") -> None:
        self.ax.plot(*zip(*points, strict=True), style, color=colour, linewidth=width, solid_capstyle="butt")

    def area(self, *points: Point, colour: str = FILM, alpha: float = 0.25) -> None:
        self.ax.fill(*zip(*points, strict=True), color=colour, alpha=alpha, linewidth=0)

    def box(self, left: float, low: float, right: float, high: float, colour: str = BODY, alpha: float = 0.8) -> None:
        self.area((left, low), (right, low), (right, high), (left, high), colour=colour, alpha=alpha)

    def disc(self, centre: Point, radius: float, colour: str, alpha: float = 0.25) -> None:
        turned = np.linspace(0.0, 2 * np.pi, 121)
        x, y = centre[0] + radius * np.cos(turned), centre[1] + radius * np.sin(turned)
        ring = list(zip(x, y, strict=True))
        self.area(*ring, colour=colour, alpha=alpha)
        self.line(*ring, colour=colour, width=1.2)

    def arrow(self, start: Point, end: Point, text: str = "", both: bool = False) -> None:
        style = {"arrowstyle": "<->" if both else "->", "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
        style["color"] = self.ink
        self.ax.update_datalim([start, end])
        self.ax.annotate("", xy=end, xytext=start, arrowprops=style)
        if text:
            middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
            upright = abs(end[0] - start[0]) < abs(end[1] - start[1])
            self.text(
                middle[0] + 0.06 * upright, middle[1] + 0.05 * (not upright), text, "left" if upright else "center"
            )

    def text(self, x: float, y: float, text: str, side: str = "center") -> None:
        reach = 0.045 * len(text)  # estimated width of the text, so that it stays inside
        left = x - (0.0 if side == "left" else reach / 2)
        self.ax.update_datalim([(left, y), (left + reach, y + 0.12)])
        self.ax.text(x, y, text, ha=side, va="center" if side == "left" else "bottom")

    @property
    def ink(self) -> Any:
        """Colour of texts."""
        from matplotlib import rcParams

        return rcParams["text.color"]


def draw_rig(rig: Rig, ax: Axes | None = None) -> Axes:
    """Draw a rig with its dimensions.

    A round rig is drawn from above and from the side, any other rig from one side. Lengths in the plane of the film are
    to scale; thickness and deflection are not.

    Parameters
    ----------
    rig : Rig
        Rig of one of the kinds that a rig file can describe.
    ax : matplotlib Axes, optional
        Axes to draw on; new ones by default.

    Raises
    ------
    RigError
        If there is no drawing for rigs of this kind.
    """
    if not isinstance(rig, Rig):
        raise RigError(f"a {type(rig).__name__} is not a rig: give the rig of a plant")
    sketch = _SKETCHES.get(rig.kind)
    if sketch is None:
        raise RigError(f"there is no drawing of a rig of the kind {rig.kind} (there are: {', '.join(_SKETCHES)})")
    ax = axes_or_new(ax)
    ax.set_aspect("equal")
    ax.axis("off")
    film: Any = rig  # all of these kinds have one
    said = [f"film: {material(film.material).name}, {with_unit(film.thickness, 'm')} thick before stretching"]
    said += sketch(_Pen(ax), rig)
    ax.set_title("\n".join(said), loc="left", fontsize="medium")
    ax.set_anchor("W")
    ax.margins(0.02)
    ax.autoscale_view()
    return ax


def _length(value: float) -> str:
    return with_unit(value, "m")


def _stretched(rig: Any) -> str:
    return f"stretched to {rig.prestretch:g} both ways"


def _round(pen: _Pen, rig: Any, inner: tuple[str, float], colour: str = ELECTRODE) -> tuple[float, float]:
    """Draw a ring from above, and its frame from the side; return radius and height of the inner part."""
    name, radius = inner
    share, place = radius / rig.frame_radius, 2.7
    pen.disc((0.0, 0.0), 1.0, FILM)
    pen.disc((0.0, 0.0), share, colour, 0.5)
    pen.arrow((-1.0, -1.2), (1.0, -1.2), f"frame ⌀ {_length(2 * rig.frame_radius)}", both=True)
    pen.line((-1.0, 0.0), (-1.0, -1.25), colour=pen.ink, width=0.5)
    pen.line((1.0, 0.0), (1.0, -1.25), colour=pen.ink, width=0.5)
    if name:
        pen.arrow((-share, 1.15), (share, 1.15), f"{name} ⌀ {_length(2 * radius)}", both=True)
        pen.line((-share, 0.0), (-share, 1.2), colour=pen.ink, width=0.5)
        pen.line((share, 0.0), (share, 1.2), colour=pen.ink, width=0.5)
    for side in (-1.0, 1.0):
        pen.box(place + side - 0.06 + 0.06 * side, -0.12, place + side + 0.06 + 0.06 * side, 0.12)
    return share, place


def _profile(pen: _Pen, place: float, height: Callable[[np.ndarray], np.ndarray], share: float) -> None:
    """Draw a film from the side, with its electrode up to a share of the radius. Shapes: (n,) to (n,)."""
    across = np.linspace(-1.0, 1.0, 201)
    points = list(zip(place + across, height(np.abs(across)), strict=True))
    pen.line(*points)
    covered = [point for point, at in zip(points, across, strict=True) if abs(at) <= share]
    if len(covered) > 1:
        pen.line(*covered, colour=ELECTRODE, width=4.0)


def _diaphragm(pen: _Pen, rig: Any) -> list[str]:
    share, place = _round(pen, rig, ("electrode", rig.electrode_radius))
    contact = rig.contact_radius / rig.frame_radius
    pen.disc((0.0, 0.0), contact, BODY, 0.8)
    _profile(pen, place, lambda at: -0.4 * np.log(1 / np.maximum(at, contact)) / np.log(1 / contact), share)
    ball = max(1.3 * contact, 0.08)
    pen.disc((place, ball - 0.4), ball, BODY, 0.8)
    pen.arrow((place, -0.45), (place, -0.95), "is read")
    return [f"{_stretched(rig)}; ball {with_unit(1e3 * rig.mass, 'g')}, contact ⌀ {_length(2 * rig.contact_radius)}"]


def _disc(pen: _Pen, rig: Any) -> list[str]:
    share, place = _round(pen, rig, ("electrode", rig.electrode_radius))
    _profile(pen, place, np.zeros_like, share)
    pen.arrow((place + share, -0.12), (place + min(share + 0.35, 0.95), -0.12))
    pen.text(place + share, -0.4, "is read: the edge's radius")
    return [_stretched(rig), *([f"the edge carries {with_unit(1e3 * rig.mass, 'g')}"] if rig.mass else [])]


def _cone(pen: _Pen, rig: Any) -> list[str]:
    share, place = _round(pen, rig, ("rigid disc", rig.disc_radius), BODY)
    _profile(pen, place, lambda at: -0.5 * (1 - np.maximum(at - share, 0.0) / (1 - share)), 1.0)
    pen.box(place - share, -0.56, place + share, -0.44)
    pen.arrow((place, -0.6), (place, -1.05), "is read")
    loads = [with_unit(1e3 * rig.mass, "g")]
    loads += [f"spring {rig.spring_rate:g} N/m"] if rig.spring_rate else []
    loads += [f"bistable spring {rig.snap_force:g} N"] if rig.snap_force else []
    return [f"{_stretched(rig)}; on the disc: {', '.join(loads)}"]


def _pressure(pen: _Pen, rig: Any) -> list[str]:
    _, place = _round(pen, rig, ("", rig.frame_radius))
    _profile(pen, place, lambda at: 0.5 * (1 - at**2), 1.0)
    for at in (-0.5, 0.0, 0.5):
        pen.arrow((place + at, -0.4), (place + at, -0.02))
    pen.text(place, -0.62, f"pressure {with_unit(rig.pressure, 'Pa')}")
    pen.arrow((place, 0.55), (place, 1.0), "is read")
    return [f"{_stretched(rig)}; electrodes all over"]


def _strip(pen: _Pen, length: float, widths: tuple[float, float], names: tuple[str, str], film: str, read: str) -> None:
    """Draw a film between two bars, with its widths at the middle and the bars, and what is read at the right one."""
    size = max(length, *widths) / 1.6
    right, middle, end = length / size, widths[0] / size, widths[1] / size
    upper = [(0.0, end / 2), (right / 2, middle / 2), (right, end / 2)]
    shape = [*upper, *((x, -y) for x, y in reversed(upper))]
    pen.area(*shape, colour=film, alpha=0.35)
    pen.line(*shape, shape[0], colour=film)
    low = -max(end, middle) / 2
    for at in (0.0, right):
        pen.box(at - 0.04, -end / 2 - 0.05, at + 0.04, end / 2 + 0.05)
    pen.arrow((0.0, low - 0.25), (right, low - 0.25), f"length {_length(length)}", both=True)
    pen.arrow((right + 0.5, -end / 2), (right + 0.5, end / 2), f"{names[1]} {_length(widths[1])}", both=True)
    if middle != end:
        pen.arrow((right / 2, -middle / 2), (right / 2, middle / 2), both=True)
        pen.text(right / 2, -middle / 2 - 0.2, f"{names[0]} {_length(widths[0])}")
    pen.arrow((right + 0.04, 0.0), (right + 0.39, 0.0), read)


def _planar(pen: _Pen, rig: Any) -> list[str]:
    _strip(pen, rig.length, (rig.width, rig.width), ("width", "width"), ELECTRODE, "read")
    return _held_by_bars(rig)


def _bow_tie(pen: _Pen, rig: Any) -> list[str]:
    _strip(pen, rig.length, (rig.waist_width, rig.bar_width), ("waist", "bar"), ELECTRODE, "read")
    return _held_by_bars(rig)


def _held_by_bars(rig: Any) -> list[str]:
    across = "" if rig.side_prestretch is None else f", {rig.side_prestretch:g} across"
    return [
        f"lengths before stretching; stretched to {rig.prestretch:g} along{across}",
        f"sides {rig.sides}; moved mass {with_unit(1e3 * rig.mass, 'g')}",
    ]


def _coupon(pen: _Pen, rig: Any) -> list[str]:
    _strip(pen, rig.length, (rig.width, rig.width), ("width", "width"), FILM, "force")
    return ["the stretch is given, the force is read; no electrodes"]


def _stack(pen: _Pen, rig: Any) -> list[str]:
    count, side = min(rig.layers, 12), 0.5
    for k in range(count + 1):
        pen.line((-side, k / count), (side, k / count), colour=ELECTRODE if 0 < k < count else BODY, width=1.2)
    pen.box(-side, 0.0, side, 1.0, FILM, 0.25)
    pen.box(-side - 0.05, -0.1, side + 0.05, 0.0)
    pen.box(-side - 0.05, 1.0, side + 0.05, 1.1)
    pen.arrow(
        (side + 0.2, 0.0), (side + 0.2, 1.0), f"{rig.layers} films, {_length(rig.layers * rig.thickness)}", both=True
    )
    pen.arrow((0.0, -0.5), (0.0, -0.14), "is read")
    pen.text(0.0, 1.14, f"area of an electrode {1e6 * rig.area:g} mm²")
    return [f"load {rig.load:g} N, moved mass {with_unit(1e3 * rig.mass, 'g')}"]


def _roll(pen: _Pen, rig: Any) -> list[str]:
    pen.box(0.0, -0.3, 1.6, 0.3, ELECTRODE, 0.35)
    pen.line((0.0, 0.3), (1.6, 0.3), colour=ELECTRODE)
    pen.line((0.0, -0.3), (1.6, -0.3), colour=ELECTRODE)
    turns = [(0.04 + 1.52 * k / 24, 0.15 * (-1) ** k) for k in range(25)]
    pen.line(*turns, colour=BODY, width=1.2)
    for at in (0.0, 1.6):
        pen.box(at - 0.04, -0.36, at + 0.04, 0.36)
    pen.arrow((0.0, -0.5), (1.6, -0.5), f"film {_length(rig.length)} before stretching", both=True)
    pen.arrow((1.66, 0.0), (2.05, 0.0), "is read")
    return [
        f"{_length(rig.width)} wound; stretched to {rig.prestretch:g} along, {rig.hoop_prestretch:g} around",
        f"spring {rig.spring_rate:g} N/m, load {rig.load:g} N, moved mass {with_unit(1e3 * rig.mass, 'g')}",
    ]


_SKETCHES: Mapping[str, Callable[[_Pen, Any], list[str]]] = MappingProxyType(
    {
        "diaphragm": _diaphragm,
        "disc": _disc,
        "cone": _cone,
        "pressure": _pressure,
        "planar": _planar,
        "bow_tie": _bow_tie,
        "coupon": _coupon,
        "stack": _stack,
        "roll": _roll,
    }
)
