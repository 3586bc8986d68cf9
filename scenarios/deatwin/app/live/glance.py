"""A first look at a recording: the interpretation of its columns, its content, and a picture."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path

from deatwin.app.live.desk import inside
from deatwin.plant.errors import DeatwinError
from deatwin.plant.files.understood import Column, Understood, understand
from deatwin.plant.readings import Reading
from deatwin.plant.readoptions import ReadOptions

SIZE = (5.4, 6.4)
DRAWING = threading.Lock()  # One drawing at a time, because matplotlib's style is global


@dataclass(frozen=True, kw_only=True)
class Glance:
    """Content of one file, read as requested or with further options."""

    name: str
    columns: tuple[Column, ...]
    lines: tuple[str, ...]  # Content of the file, one fact per line
    picture: str  # SVG in the report's colours; empty if nothing could be read
    refused: str  # Reason why it cannot be read as requested; empty if it can
    further: ReadOptions  # Options with which it can be read
    needs_sample_time: bool  # True if only the sample time is missing

    def html(self) -> str:
        """Return the columns, the facts and the picture, for a page that defines the report's colours."""
        from deatwin.studies.report.rendering import templates

        return templates("deatwin.app.live").get_template("glance.html.j2").render(glance=self)


def glance(root: Path, name: str, asked: ReadOptions, rig: str = "") -> Glance:
    """Describe a file of the folder, read with the requested options and the further readings of a rig."""
    file = understand(inside(root, name), asked, _further(root, rig))
    fault = file.refused
    try:
        lines, picture = _looked(name, file) if file.recordings else ((), "")
    except DeatwinError as error:  # for example, a record of three samples
        lines, picture, fault = (), "", fault or str(error)
    return Glance(
        name=name,
        columns=file.columns,
        lines=lines,
        picture=picture,
        refused=fault.replace(f"{root.resolve()}/", ""),
        further=file.further,
        needs_sample_time=bool(file.placeholders),
    )


def _further(root: Path, rig: str) -> tuple[Reading, ...]:
    """Return the further readings of a rig file or a model; none if it is faulty, which a job would report."""
    from deatwin.plant import load_plant

    try:
        return load_plant(inside(root, rig)).plant.rig.further if rig else ()
    except DeatwinError:
        return ()


def _looked(name: str, file: Understood) -> tuple[tuple[str, ...], str]:
    """Return facts and picture of the recordings."""
    from deatwin.ident.look import look_at
    from deatwin.studies.report.drawing import draw, inline

    found = look_at(file.recordings)
    with DRAWING, draw(SIZE) as figure:
        found.plot(list(figure.subplots(3, 1)))
        figure.align_ylabels()
        return found.lines, inline(figure, "glance", f"Input, output and coherence of {name}")
