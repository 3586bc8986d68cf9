"""List the errors that others reached on the standard tasks, from `published.toml`, each with its source."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from typing import Any

from deatwin.studies.report.story import Table

_FILE: dict[str, Any] = tomllib.loads(files(__package__).joinpath("published.toml").read_text(encoding="utf-8"))
PUBLISHED: list[dict[str, str]] = _FILE["published"]
"""Errors on test parts, each with its model; sources and places that recur have a name."""


def said(test: str) -> str:
    """Return the results of others on a test part, in one line."""
    return ", ".join(f"{one['error']} ({one['model']})" for one in PUBLISHED if one["test"] == test)


def sources() -> Table:
    """Return all figures with their sources."""
    return Table.of(
        "Published errors, and where they were read",
        PUBLISHED,
        {
            "test part": lambda one: one["test"],
            "error": lambda one: one["error"],
            "model": lambda one: one["model"],
            "source": lambda one: _FILE["source"].get(one["source"], one["source"]),
            "read in": lambda one: _FILE["read"][one["read"]],
        },
    )
