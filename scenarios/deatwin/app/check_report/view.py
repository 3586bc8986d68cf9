"""Data for all parts of the report, and colours and line styles of each source in all figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import cycle, product

from deatwin.control import Check, Specification
from deatwin.control.checking.rows import MarginRow
from deatwin.ident.narx import NarxModel
from deatwin.plant.amplitudes import amplitude_unit, axis_label, written_amplitude
from deatwin.plant.arrays import Array
from deatwin.plant.model import Plant
from deatwin.plant.words import spaced
from deatwin.studies.report.drawing import Hue

_DRAWN = 1000  # most points of a line: a picture can show no more


@dataclass(frozen=True, kw_only=True)
class Look:
    """Label, colour and line style of a source."""

    label: str
    colour: str
    line: str = "-"


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A check with the model, plants and limits that its report shows."""

    check: Check
    model: NarxModel
    plants: Mapping[str, Plant]  # The plant model as ``plant``, and the others by their names
    specification: Specification  # Limits of the check

    @property
    def looks(self) -> dict[str, Look]:
        """Colour and line style of each source of margins and runs; variants of a source share its colour."""
        styles = cycle(product(("-", "--", "-."), (Hue.MARK, Hue.MEASURED, Hue.INK)))
        found = {"model": Look(label="model", colour=Hue.AFTER), "plant": Look(label="plant model", colour=Hue.BEFORE)}
        for name in self.plants:
            if name not in found:
                line, colour = next(styles)
                found[name] = Look(label=spaced(name), colour=colour, line=line)
        for source in dict.fromkeys(row.source for row in self.check.table):
            if source not in found:
                whose = max((name for name in found if source.startswith(f"{name} ")), key=len, default="model")
                label = f"{found[whose].label}{source.removeprefix(whose)}"
                found[source] = Look(label=label, colour=found[whose].colour, line=":")
        return found

    @property
    def unit(self) -> str:
        """Unit of outputs in columns, such as ``um``."""
        return amplitude_unit(self.check.operating.output_unit)[0]

    @property
    def shown_unit(self) -> str:
        """Unit of outputs for readers, such as ``µm``."""
        return written_amplitude(self.check.operating.output_unit)[0]

    @property
    def size(self) -> float:
        """SI size of that unit."""
        return amplitude_unit(self.check.operating.output_unit)[1]

    @property
    def reading(self) -> str:
        """Label of an axis of outputs."""
        return axis_label(spaced(self.model.output_names[0]), self.shown_unit)

    @property
    def command(self) -> str:
        """Label of an axis of commands."""
        return axis_label(spaced(self.model.input_names[0]), self.check.operating.input_unit)

    def rows(self, along_time: bool) -> dict[str, list[MarginRow]]:
        """Margins of each source over operating points or over time."""
        found: dict[str, list[MarginRow]] = {}
        for row in self.check.table:
            if (row.time is not None) is along_time:
                found.setdefault(row.source, []).append(row)
        return found


def header(name: str, unit: str) -> str:
    """Header of a column."""
    plain = "".join(mark if mark.isalnum() or mark in "+-." else "_" for mark in name)
    return plain if unit in ("", "1") else f"{plain}_{unit}"


def thinned(*series: Array) -> tuple[Array, ...]:
    """Keep every n-th sample of smooth series, as many as a picture can show. Shapes: `*series` (n,)."""
    stride = max(1, -(-series[0].size // _DRAWN))
    return tuple(values[::stride] for values in series)
