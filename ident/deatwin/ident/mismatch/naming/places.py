"""Explanations that differ only in the places at which their effects enter."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming


def causes_of(candidate: Candidate) -> tuple[str, ...]:
    """Names of a candidate's effects, whatever their places."""
    return tuple(e.cause for e in candidate.calibration.plant.effects if e.name in candidate.effects)


def without_places(naming: Naming) -> tuple[Naming, tuple[Candidate, ...]]:
    """The same answer without rivals that are its best explanation at other places, and these.

    Of others with the same causes the first is kept.
    """
    if naming.best is None:
        return naming, ()
    elsewhere = tuple(c for c in naming.rivals if _is_elsewhere(c, [naming.best]))
    others: list[Candidate] = []
    for rival in naming.rivals:
        if rival not in elsewhere and not _is_elsewhere(rival, others):
            others.append(rival)
    return replace(naming, rivals=tuple(others)), elsewhere


def _is_elsewhere(candidate: Candidate, known: Iterable[Candidate]) -> bool:
    """Whether one of the `known` has the same causes, of which any are at other places."""
    causes = set(causes_of(candidate))
    return any(set(causes_of(c)) == causes and set(c.effects) != set(candidate.effects) for c in known)
