"""All installed scenarios: the project's own, and those of other packages by entry points."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points

from deatwin.studies.stories import Story

GROUP = "deatwin.scenarios"  # Each entry point of this group is a sequence of stories


def stories() -> Mapping[str, Story]:
    """Return every story by its name, in the order in which its package lists it."""
    return {story.name: story for point in entry_points(group=GROUP) for story in point.load()}


def story(name: str) -> Story:
    """Return the story of that name."""
    from deatwin.plant.errors import DataError, nearest

    known = stories()
    if name not in known:
        raise DataError(f"there is no scenario {name!r}{nearest(name, known)} (known: {', '.join(known)})")
    return known[name]
