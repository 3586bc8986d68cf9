"""Explanations that differ only in the places at which their effects act, or in the timing error of the rig."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from deatwin.ident.mismatch.likelihood.beforehand import LATEST
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import takes_most
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.plant.effects.delay import Delay
from deatwin.plant.effects.sensor_lag import SensorLag

_LATE = frozenset({Delay.name, SensorLag.name})
"""Effects of which a short one cannot be distinguished from the timing error that every rig has."""


def causes_of(candidate: Candidate) -> tuple[str, ...]:
    """Return the names of a candidate's effects, without their places, and without the timing error of the rig."""
    timing = timing_error(candidate)
    effects = (e for e in candidate.calibration.plant.effects if e.name in candidate.effects)
    return tuple(e.cause for e in effects if e.name not in timing)


def timing_error(candidate: Candidate) -> tuple[str, ...]:
    """Return the delays and lags beside a candidate's other effects that are no longer than a rig's timing error."""
    # Triggers, filters and the neglected dynamics of the rig make it late, which is no missing physics.
    plant = candidate.calibration.plant
    latest = LATEST * plant.rig.sample_time
    added = [e for e in plant.effects if e.name in candidate.effects]
    short = [e.name for e in added if e.cause in _LATE and plant.parameters[f"{e.name}.time"].value <= latest]
    return tuple(short) if len(short) < len(added) else ()


def without_places(naming: Naming) -> tuple[Naming, tuple[Candidate, ...]]:
    """Separate the alternatives that are the best explanation at other places."""
    # Of the remaining alternatives with the same causes, the first one is kept. If the plant does not rest before the
    # first reading, a tone is simulated as if it began there. That is arbitrary, so the place of the tone is left open.
    if naming.best is None:
        return naming, ()
    best, rig = naming.best, naming.base.calibration.plant.rig
    effects = (e for e in best.calibration.plant.effects if e.name in best.effects)
    is_open = rig.start.hold == 0.0 and any(e.cycle(()) > 0.0 and (e.places or e.placed_at) for e in effects)
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
