"""Is a named effect as strong at the end of what was fitted as at its beginning?

The catalogue's mechanisms are what they are all the time: what changes, such as a drift or a creep, changes by its own
law. An effect whose strength would have to grow from nothing stands for something else: a clock that runs fast looks
like a delay, which grows. So does one that leaves too much, if all that is wrong with it is that it does not change.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.special import stdtrit

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.plant.datasets import Metadata, variable

WHOLE = 1.0
"""Change by as much as the effect's own strength: a law that is not quite the catalogue's changes by less."""
STRETCHES = 20
"""Number of stretches for estimating a deviation: each is longer than most residuals remember."""
SURELY = float(stdtrit(STRETCHES - 1, 0.975))
"""Deviations from an estimate to the end of its 95 % interval,"""
BEYOND_DOUBT = 7.0
"""and more of them than residuals that remember a third of the recordings are likely to make up. A law that is not
quite the catalogue's is surely off by any number of them, so that this is not enough:"""
MOST = 0.75
"""the change must take this share of what the explanation leaves beyond the noise. Of right causes none took more than
two fifths, of clocks that ran late it was five sixths and more (recordings of which the causes were known)."""
OWN = 0.1
"""Least share of the change's power in the readings that nothing else in the plant can make: with less, what a law
lacks, a tenth of what the effect does, is magnified to the whole of it."""


@dataclass(frozen=True, kw_only=True)
class Constancy:
    """Change of the strength of one effect from the beginning to the end of the fitted data.

    Parameters
    ----------
    effect : str
        Canonical name.
    own : float
        Share of the change's power in the readings that no parameter of the plant can take up, from 0 to 1.
    change, deviation : float or None
        Relative to the fitted strength, to first order, and its standard deviation; None where `own` is too small to
        tell.
    mends : bool
        Whether the explanation leaves too much, and the change would take most of that.
    """

    effect: str
    own: float = field(metadata=variable(about="share of its power that nothing else can make"))
    change: float | None = field(
        default=None, metadata=variable(about="relative change of the strength over the recordings")
    )
    deviation: float | None = field(default=None, metadata=variable(about="its standard deviation"))
    mends: bool = False

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "holds": variable(),
    }

    @property
    def holds(self) -> bool:
        """Return whether the effect may be what it is called: its strength does not surely change by more than itself.

        Nor, beyond all doubt, by anything where that would mend the explanation.
        """
        if self.change is None or self.deviation is None:
            return True
        if self.mends and abs(self.change) > BEYOND_DOUBT * self.deviation:
            return False
        return abs(self.change) - SURELY * self.deviation <= WHOLE


def constancies(
    fit: Calibration, parts: Sequence[Part], effects: Sequence[str], too_much: float | None = None
) -> tuple[Constancy, ...]:
    """Let the strength of each effect of a fit change evenly with time, all other parameters being free.

    Parameters
    ----------
    fit : Calibration
        On `parts`.
    parts : sequence of Part
        What was fitted.
    effects : sequence of str
        Names of effects; events, which begin at a time of their own, are passed over, and those whose strength was
        not fitted.
    too_much : float, optional
        Rms of what the fit leaves beyond the noise, SI, of an explanation that leaves too much; nothing of others.

    Returns
    -------
    tuple of Constancy
        In the order of the effects.
    """
    basis, running = tangent_basis(fit.jacobian), _running(parts)
    return tuple(_constancy(name, by * running, basis, fit, too_much) for name, by in _by_strength(fit, effects))


def _by_strength(fit: Calibration, effects: Sequence[str]) -> Iterator[tuple[str, np.ndarray]]:
    """Derivatives of the readings by the relative strength of effects, shape (n,), SI."""
    strengths = {e.name: f"{e.name}.{e.strength}" for e in fit.plant.effects if not e.event}
    for effect in effects:
        name = strengths.get(effect)
        if name in fit.names:
            parameter = fit.plant.parameters[name]
            slope = parameter.scale.slope(parameter.value)
            yield effect, fit.jacobian[:, fit.names.index(name)] * (parameter.value / slope)


def _running(parts: Sequence[Part]) -> np.ndarray:
    """Time since the beginning of each experiment, shape (n,): it runs through 2 in the longest, and its mean is 0."""
    since = np.concatenate([part.timepts - part.timepts[0] for part in parts])
    return 2.0 * (since - since.mean()) / max(float(since.max()), np.finfo(float).tiny)


def _constancy(
    effect: str, change: np.ndarray, basis: np.ndarray, fit: Calibration, too_much: float | None
) -> Constancy:
    """By the part of the change that nothing in the `basis` of the other parameters can make."""
    free, whole = taken_off(change, basis), float(change @ change)
    power = float(free @ free)
    own = min(power / whole, 1.0) if whole > 0.0 else 0.0
    if own < OWN:
        return Constancy(effect=effect, own=own)
    half = float(free @ fit.residuals) / power
    taken = half**2 * power / free.size
    sums = [float(np.sum(s)) for s in np.array_split(free * (fit.residuals - half * free), STRETCHES)]
    return Constancy(
        effect=effect,
        own=own,
        change=2.0 * half,
        deviation=2.0 * float(np.linalg.norm(sums)) / power,
        mends=too_much is not None and taken > MOST * too_much**2,
    )
