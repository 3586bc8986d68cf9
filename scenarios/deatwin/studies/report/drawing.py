"""A figure of a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from deatwin.studies.report.svg import inline

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from deatwin.studies.folder import ResultFolder


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
