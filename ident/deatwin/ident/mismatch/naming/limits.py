"""Explanations that a fit has driven to where they are another effect: the other one is possible, too."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming, normalised

ROUNDING = 1e-9
"""Tolerance of a bound whose logarithm was taken."""


def with_limits(naming: Naming, possible: Callable[[Candidate], bool]) -> Naming:
    """Also keep as an alternative what the best explanation has become at the lower end of its range.

    Hysteresis over ever smaller distances is dry friction: where the fit ends at the smallest, or is not sure to be
    away from it (95 %), better residuals speak for details of the contact, not for the one name or the other: they are
    equally likely.

    Parameters
    ----------
    naming : Naming
        Decided.
    possible : callable
        Whether a candidate could be an alternative.

    Returns
    -------
    Naming
        With each of those as likely as the best.
    """
    if naming.best is None:
        return naming
    meant = list(_become(naming.best))
    others = [c for c in naming.candidates if frozenset(c.effects) in meant and possible(c)]
    found = naming.as_likely(others)
    likely = dict.fromkeys([c.effects for c in others], found.probabilities[naming.best.effects])
    return replace(found, probabilities=normalised({**found.probabilities, **likely})) if others else naming


def _become(candidate: Candidate) -> Iterator[frozenset[str]]:
    """The sets of effects that a candidate may be, besides its own."""
    fit = candidate.calibration
    for effect in fit.plant.effects:
        for parameter, other in effect.becomes.items():
            if effect.name in candidate.effects and _may_be_least(fit, f"{effect.name}.{parameter}"):
                yield frozenset(candidate.effects) - {effect.name} | {other}


def _may_be_least(fit: Calibration, name: str) -> bool:
    """Return whether a parameter has ended at the lower end of its range, or is not sure to be above that."""
    known = fit.plant.parameters[name]
    return (name in fit.at_bound and known.is_low) or fit.interval(name)[0] <= known.lower * (1.0 + ROUNDING)
