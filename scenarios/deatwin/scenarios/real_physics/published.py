"""What others reached on the standard tasks, from `published.toml`: each figure with its source, and with where it was read."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files

from deatwin.studies.report.story import Table


@dataclass(frozen=True, kw_only=True)
class Published:
    """An error that others reached on a test part."""

    test: str
    error: str  # With its unit
    model: str
    source: str
    read: str  # Where the figure was read


def _published() -> tuple[Published, ...]:
    """Read the file, in which sources and places that recur have a name."""
    known = tomllib.loads(files(__package__).joinpath("published.toml").read_text(encoding="utf-8"))
    return tuple(
        Published(
            **{**one, "source": known["source"].get(one["source"], one["source"]), "read": known["read"][one["read"]]}
        )
        for one in known["published"]
    )


PUBLISHED = _published()


def said(test: str) -> str:
    """Return the results of others on a test part, in one line."""
    return ", ".join(f"{one.error} ({one.model})" for one in PUBLISHED if one.test == test)


def sources() -> Table:
    """Return all figures with their sources."""
    return Table.of(
        "Published errors, and where they were read",
        PUBLISHED,
        {
            "test part": lambda one: one.test,
            "error": lambda one: one.error,
            "model": lambda one: one.model,
            "source": lambda one: one.source,
            "read in": lambda one: one.read,
        },
    )
