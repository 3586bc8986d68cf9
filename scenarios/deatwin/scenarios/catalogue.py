"""List of the scenarios that deatwin offers by its entry point in the group ``deatwin.scenarios``: ``catalogue.toml``."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from typing import Any

from deatwin.studies.stories import Story


def _story(entry: dict[str, Any]) -> Story:
    """Make an entry of the list; arrays become tuples."""
    fields: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in entry.items()}
    return Story(**fields)


_FILE = tomllib.loads(files(__package__).joinpath("catalogue.toml").read_text(encoding="utf-8"))
STORIES = tuple(map(_story, _FILE["story"]))
