"""A figure of a page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from deatwin.studies.report.svg import inline

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawing:
    """A figure of the report."""

    name: str  # What it is called and what it shows
    title: str
    caption: str
    svg: str  # The picture
    data: str = ""  # Name of the CSV file with its data; empty without one
    further: tuple[str, ...] = ()  # Names of further such files

    @property
    def files(self) -> tuple[str, ...]:
        """All files with its data."""
        return (self.data, *self.further) if self.data else self.further

    @classmethod
    def of(cls, figure: Figure, name: str, title: str, caption: str) -> Drawing:
        """Return a drawn figure with its data in ``figures/NAME.csv``."""
        return cls(name=name, title=title, caption=caption, svg=inline(figure, name, title), data=f"figures/{name}.csv")
