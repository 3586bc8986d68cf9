"""Explanations that differ only in the places at which their effects act, or in the timing error of the rig."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from deatwin.ident.mismatch.likelihood.beforehand import LATEST
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import takes_most
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.delay import Delay
from deatwin.plant.effects.sensor_lag import SensorLag

_LATE = frozenset({Delay.name, SensorLag.name})
"""Effects of which a short one cannot be distinguished from the timing error that every rig has."""


def causes_of(candidate: Candidate) -> tuple[str, ...]:
    """Return the names of a candidate's effects, without their places, and without the timing error of the rig."""
    return tuple(effect.cause for effect in missing_effects(candidate))


def missing_effects(candidate: Candidate) -> tuple[Effect, ...]:
    """Return a candidate's effects without the timing error of the rig."""
    timing = timing_error(candidate)
    return tuple(effect for effect in _added(candidate) if effect not in timing)


def timing_error(candidate: Candidate) -> tuple[Effect, ...]:
    """Return the delays and lags beside a candidate's other effects that are no longer than a rig's timing error."""
    # Triggers, filters and the neglected dynamics of the rig make it late, which is no missing physics.
    plant = candidate.calibration.plant
    latest = LATEST * plant.rig.sample_time
    added = _added(candidate)
    short = tuple(e for e in added if e.cause in _LATE and plant.parameters[f"{e.name}.time"].value <= latest)
    return short if len(short) < len(added) else ()


def _added(candidate: Candidate) -> list[Effect]:
    return [effect for effect in candidate.calibration.plant.effects if effect.name in candidate.effects]


def without_places(naming: Naming) -> tuple[Naming, tuple[Candidate, ...]]:
    """Separate the alternatives that are the best explanation at other places."""
    # Of the remaining alternatives with the same causes, the first one is kept. If the plant does not rest before the
    # first reading, a tone is simulated as if it began there. That is arbitrary, so the place of the tone is left open.
    if naming.best is None:
        return naming, ()
    best, rig = naming.best, naming.base.calibration.plant.rig
    is_open = rig.start.hold == 0.0 and any(e.cycle(()) > 0.0 and (e.places or e.placed_at) for e in _added(best))
    known = [c for c in naming.candidates if takes_most(c, naming.base)] if is_open else naming.alternatives
    elsewhere = tuple(c for c in known if _is_elsewhere(c, [best]))
    others: list[Candidate] = []
    for alternative in naming.alternatives:
        if not _is_elsewhere(alternative, [best]) and not _is_elsewhere(alternative, others):
            others.append(alternative)
    return replace(naming, alternatives=tuple(others)), elsewhere


def _is_elsewhere(candidate: Candidate, known: Iterable[Candidate]) -> bool:
    """Return whether one of the `known` has the same causes, of which any are at other places."""
    causes = set(causes_of(candidate))
    return any(set(causes_of(c)) == causes and set(c.effects) != set(candidate.effects) for c in known)
