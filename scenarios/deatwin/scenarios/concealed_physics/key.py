"""The key, which is `key.toml` beside this module: right names of concealed mechanisms, and how far each reaches."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from typing import Any

VISIBLE = 0.3
"""Structural residual over noise from which on a mechanism counts as visible: the lowest rung of the ladder."""

_FILE: dict[str, Any] = tomllib.loads(files(__package__).joinpath("key.toml").read_text(encoding="utf-8"))
_INSIDE, _OUTSIDE, _GROUPS = _FILE["inside"], _FILE["outside"], _FILE["group"]

KEY: dict[str, tuple[str, ...]] = {mechanism: tuple(known["names"]) for mechanism, known in _INSIDE.items()}
"""Catalogue names of each mechanism, the canonical name first."""
OUTSIDE: dict[str, str] = {mechanism: known["because"] for mechanism, known in _OUTSIDE.items()}
"""Mechanisms outside the catalogue, and why no effect of it describes them."""
REACH: dict[str, float] = {mechanism: known["reach"] for mechanism, known in (_INSIDE | _OUTSIDE).items()}
SHOWN_BY: dict[str, str] = {mechanism: known["shown_by"] for mechanism, known in _INSIDE.items() if "shown_by" in known}
"""The only waveform under which a mechanism reaches so far."""
INVISIBLE = frozenset(names[0] for name, names in KEY.items() if REACH[name] < VISIBLE)
"""Effects of the catalogue whose mechanism reaches no visible ratio."""
TIES: tuple[tuple[str, tuple[str, ...], str, str], ...] = tuple(
    (tie["waveform"], tuple(tie["names"]), mechanism, " ".join(tie["because"].split()))
    for tie in _FILE["tie"]
    for mechanism in tie["mechanisms"]
)
"""Input, names that it cannot tell apart, the mechanism, and why."""
TERM_NAMES: dict[str, frozenset[str]] = {
    term: frozenset(" ".join(_GROUPS.get(word, word) for word in words.split()).split())
    for term, words in _FILE["term"].items()
}
"""For each term of the sparse dynamics of a residual, every effect that it may stand for."""


def key_dict() -> dict[str, Any]:
    """Return the whole key as plain data, which is hashed."""
    reasons = {name: " ".join(known["because"].split()) for name, known in _INSIDE.items() if "because" in known}
    return {
        "key": {name: list(names) for name, names in KEY.items()},
        "reasons": reasons,
        "outside": dict(OUTSIDE),
        "reach": dict(REACH),
        "ties": [[waveform, list(names), mechanism, why] for waveform, names, mechanism, why in TIES],
    }
