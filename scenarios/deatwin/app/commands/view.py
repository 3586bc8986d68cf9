"""``deatwin view``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from deatwin.app.options import Json, Quiet
from deatwin.studies.voice import Voice

MOST_MEGABYTES = 2000.0

Folder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder with recordings, rig files and results; nothing else is shown.")
]
Port = Annotated[int, typer.Option(min=0, max=65535, help="Port on this machine; 0 takes any free port.")]
NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Print the address without opening a browser.")]


def _size(value: float) -> float:
    if not (0.0 < value <= MOST_MEGABYTES and math.isfinite(value)):
        raise typer.BadParameter(f"{value:g} is out of range; give a size above 0 and up to {MOST_MEGABYTES:g} MB")
    return value


UploadLimit = Annotated[
    float, typer.Option(metavar="MB", callback=_size, help="Largest file that can be dropped on the page.")
]


def view(
    folder: Folder,
    port: Port = 0,
    upload_limit: UploadLimit = 50.0,
    no_browser: NoBrowser = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Show a folder in the browser: choose recordings, diagnose them, watch, compare verdicts. Ctrl-C ends it.

    The page is served to this machine only. Ctrl-C also stops running diagnoses; finished results stay.

    Example: deatwin view measurements --port 8080
    """
    from deatwin.app.live.desk import require_folder
    from deatwin.app.live.serve import serve

    voice = Voice(as_json=as_json, quiet=quiet)
    root = require_folder(folder)

    def started(address: str) -> None:
        voice.say(f"{folder} is shown at {address}\nCtrl-C ends it")
        voice.result({"folder": str(folder), "address": address})

    serve(root, port=port, upload_limit=upload_limit, open_browser=not no_browser, started=started)
    voice.say("ended")
