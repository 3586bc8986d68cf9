"""Results of others on the same recordings, with their sources, from `published.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from deatwin.ident.narx import NarxModel
from deatwin.plant import Recording

_FILE: dict[str, Any] = tomllib.loads(files(__package__).joinpath("published.toml").read_text(encoding="utf-8"))
DOCUMENTED: Mapping[str, Mapping[str, float]] = _FILE["documented"]
"""Models of the buck converter in SysIdentPy's documentation, in its order: parameters by term."""
QUOTED = [[" ".join(one[key].split()) for key in ("data", "method", "error", "source")] for one in _FILE["quoted"]]
"""Rows of data set, method, error as it is reported, and where."""


def documented_errors(test: Recording) -> dict[str, float]:
    """Root mean square errors of free runs of the documented models, V."""
    return {
        name: NarxModel.from_terms(terms, sample_time=test.sample_time).simulate(test).rms_error
        for name, terms in DOCUMENTED.items()
    }
