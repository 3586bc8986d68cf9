"""Explanations that a fit has driven to where they are another effect: the other one is possible, too."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming

__all__ = ["with_limits"]


def with_limits(naming: Naming, possible: Callable[[Candidate], bool]) -> Naming:
    """Also keep as a rival what the best explanation has become at a bound of its range.

    Hysteresis over ever smaller distances is dry friction: where the fit ends at the smallest, better residuals speak
    for details of the contact, not for the one name or the other.

    Parameters
    ----------
    naming : Naming
        Decided.
    possible : callable
        Whether a candidate could be a rival.

    Returns
    -------
    Naming
    """
    if naming.best is None:
        return naming
    meant = list(_become(naming.best))
    kept = {frozenset(c.effects) for c in (naming.best, *naming.rivals)}
    further = tuple(c for c in naming.candidates if frozenset(c.effects) in meant and possible(c))
    return replace(naming, rivals=(*naming.rivals, *(c for c in further if frozenset(c.effects) not in kept)))


def _become(candidate: Candidate) -> Iterator[frozenset[str]]:
    """The sets of effects that a candidate is, besides its own."""
    fit = candidate.calibration
    for effect in fit.plant.effects:
        for parameter, other in effect.becomes.items():
            name = f"{effect.name}.{parameter}"
            if effect.name in candidate.effects and name in fit.at_bound and fit.plant.parameters[name].is_low:
                yield frozenset(candidate.effects) - {effect.name} | {other}
