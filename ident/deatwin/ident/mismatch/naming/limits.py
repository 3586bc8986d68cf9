"""Explanations fitted to a limit at which they equal another effect: that effect is possible, too."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming, normalised
from deatwin.ident.mismatch.thresholds import ROUNDING


def with_limits(naming: Naming, possible: Callable[[Candidate], bool]) -> Naming:
    """Add, as an alternative, the effect into which the best one turns when a parameter reaches its lower bound."""
    # Hysteresis over a vanishing distance is dry friction. If the fit ends at the smallest distance, or its 95 %
    # interval includes it, a smaller residual is due to details of the contact; so both names are equally likely.
    if naming.best is None:
        return naming
    meant = list(_become(naming.best))
    others = [c for c in naming.candidates if frozenset(c.effects) in meant and possible(c)]
    found = naming.as_likely(others)
    likely = dict.fromkeys([c.effects for c in others], found.probabilities[naming.best.effects])
    return replace(found, probabilities=normalised({**found.probabilities, **likely})) if others else naming


def _become(candidate: Candidate) -> Iterator[frozenset[str]]:
    """Yield the sets of effects to which a candidate may be equal, besides its own."""
    fit = candidate.calibration
    for effect in fit.plant.effects:
        for parameter, other in effect.becomes.items():
            if effect.name in candidate.effects and _may_be_least(fit, f"{effect.name}.{parameter}"):
                yield frozenset(candidate.effects) - {effect.name} | {other}


def _may_be_least(fit: Calibration, name: str) -> bool:
    """Return whether a parameter is at the lower end of its range, or its interval includes that."""
    known = fit.plant.parameters[name]
    return (name in fit.at_bound and known.is_low) or fit.interval(name)[0] <= known.lower * (1.0 + ROUNDING)
