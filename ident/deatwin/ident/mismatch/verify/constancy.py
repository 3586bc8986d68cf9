"""Test whether the strength of a named effect is constant over the fitted data.

The strengths of the catalogue's effects are constant; a drift or a creep changes by its own law. An effect whose
strength would have to grow from zero stands for something else: a clock that runs fast looks like a growing delay. The
same holds for an effect that leaves too much if a changing strength would correct that.
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
from deatwin.ident.mismatch.thresholds import PRACTICAL_SHARE, STRETCHES
from deatwin.plant.datasets import Metadata, variable

SURELY = float(stdtrit(STRETCHES - 1, 0.975))
"""Half width of a 95 % interval, in standard deviations."""
BEYOND_DOUBT = 7.0
"""Half width, in standard deviations, of an interval that also covers residuals correlated over a third of the
recordings. A slightly different law may exceed it, so the change must also remove the share `MOST`."""
MOST = 0.75
"""Share of the residual's power beyond noise that the change must remove. In recordings with known causes, it removed
at most two fifths for right causes, and at least five sixths for clocks that ran late."""


@dataclass(frozen=True, kw_only=True)
class Constancy:
    """Change of the strength of one effect from the beginning to the end of the fitted data."""

    effect: str
    own: float = field(metadata=variable(about="share of the power of this change that no parameter can imitate"))
    # To first order; None if `own` is too small
    change: float | None = field(
        default=None,
        metadata=variable(
            about="relative change of the effect's strength from the beginning to the end of the fitted data"
        ),
    )
    deviation: float | None = field(default=None, metadata=variable(about="standard deviation of `change`"))
    mends: bool = False  # True if the explanation leaves too much, and the change would remove most of that

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "holds": variable(),
    }

    @property
    def holds(self) -> bool:
        """Return whether the strength does not certainly change by more than itself."""
        # A slightly different law causes a smaller change. If the change would correct the explanation, it must not differ from zero beyond doubt.
        if self.change is None or self.deviation is None:
            return True
        if self.mends and abs(self.change) > BEYOND_DOUBT * self.deviation:
            return False
        return abs(self.change) - SURELY * self.deviation <= 1.0


def constancies(
    fit: Calibration, parts: Sequence[Part], effects: Sequence[str], too_much: float | None = None
) -> tuple[Constancy, ...]:
    """Estimate a linear change with time of the strength of each effect, with all other parameters free.

    Events and effects whose strength was not fitted are ignored. `too_much` is the rms residual beyond noise, SI, of an
    explanation that leaves too much.
    """
    basis, running = tangent_basis(fit.jacobian), _running(parts)
    return tuple(_constancy(name, by * running, basis, fit, too_much) for name, by in _by_strength(fit, effects))


def _by_strength(fit: Calibration, effects: Sequence[str]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the derivatives of the readings by the relative strength of each effect, shape (n,), SI."""
    strengths = {e.name: f"{e.name}.{e.strength}" for e in fit.plant.effects if not e.event}
    for effect in effects:
        name = strengths.get(effect)
        if name in fit.names:
            parameter = fit.plant.parameters[name]
            slope = parameter.scale.slope(parameter.value)
            yield effect, fit.jacobian[:, fit.names.index(name)] * (parameter.value / slope)


def _running(parts: Sequence[Part]) -> np.ndarray:
    """Return the time within each experiment, shape (n,), scaled to a range of 2 and a mean of 0."""
    since = np.concatenate([part.timepts - part.timepts[0] for part in parts])
    return 2.0 * (since - since.mean()) / max(float(since.max()), np.finfo(float).tiny)


def _constancy(
    effect: str, change: np.ndarray, basis: np.ndarray, fit: Calibration, too_much: float | None
) -> Constancy:
    """Estimate a change from its part outside the `basis` of the other parameters."""
    free, whole = taken_off(change, basis), float(change @ change)
    power = float(free @ free)
    own = min(power / whole, 1.0) if whole > 0.0 else 0.0
    # With a smaller share, a law error of a tenth of the effect would be magnified to the whole effect.
    if own < PRACTICAL_SHARE:
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
