"""The recordings of the fleet, and of actuators of which it is known in what they differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from deatwin.ident.narx import generate_terms
from deatwin.ident.narx.fleet.records import STEADY, as_variant, thinned
from deatwin.ident.narx.rules import AtMost
from deatwin.ident.narx.terms import Term
from deatwin.plant.fleet import DURATION, HISTORIES, TOLERANCES, Actuator, fleet, specification
from deatwin.plant.model import Plant
from deatwin.plant.recording import Recording

FACTOR = 6
"""Every so many samples are kept: 0.12 s, the sampling time of the story `semp-fleet`."""
STRUCTURE: tuple[Term, ...] = tuple(generate_terms(1, (0, 1), 3, rule=AtMost(output=1)))
"""All products up to the third degree of y(k-1), at most once, u(k) and u(k-1): chosen beforehand, so that no
covariance leaves out that terms were selected on the data."""
OPERATING_INPUT = 2.4
"""Mean of the thesis' noise, V."""
INPUT_BAND = (0.0, 1.0)
"""Of the thesis' noise, Hz."""
ORDERS = (1, 2, 3)
BANDS = ((0.0, 0.1), (0.1, 0.3), (0.3, 1.0))
"""Of the output's frequencies, Hz."""
REPEATS = 24
"""Of one stationary actuator, each under noise of its own."""
BEGIN = 60.0
"""Of what is compared, s. Before it lie the transient from rest, what the story of the first actuator has from 10 to
30 s, and the shift of the sixth at 45 s."""
STATIONARY = 1
"""Number of the actuator that is repeated, without its history."""
SHARED = (1, 2, 3, 4, 5)
"""Numbers of the histories that are given to one fabrication; the sixth is an event before what is compared."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Records:
    """All recordings, thinned, from `BEGIN` on."""

    fleet: Mapping[str, Recording]  # The six as they are
    steady: Mapping[str, Recording]  # The six without their histories, under the same commands
    level: Mapping[str, Recording]
    repeats: Mapping[str, Recording]
    shared: Mapping[str, Recording]
    tolerances: Mapping[str, Recording]
    specification: Recording


def tasks(seed: int, n_repeats: int = REPEATS, duration: float = DURATION) -> dict[tuple[str, str], tuple[Any, ...]]:
    """What is to be recorded."""
    six = fleet(seed)
    steady = {one.name: as_variant(one, STEADY) for one in six}
    still = steady[six[STATIONARY - 1].name]
    alike = (seed, 0)  # the fleet's own begin with seed and 1 to 6
    found: dict[tuple[str, str], Actuator] = {}
    found |= {("fleet", one.name): one for one in six}
    found |= {("steady", name): one for name, one in steady.items()}
    found |= {("level", name): replace(one, seed=alike) for name, one in steady.items()}
    found |= {("repeats", f"repeat {k}"): replace(still, seed=(*still.seed, 1000 + k)) for k in range(1, n_repeats + 1)}
    found |= {
        ("shared", f"history {n}"): _made(specification().with_effects(*HISTORIES[n - 1].effects), (seed, 0, 2000 + n))
        for n in SHARED
    }
    found |= {("tolerances", name): _made(_off(name), alike) for name in TOLERANCES}
    found["specification", ""] = _made(specification(), alike)
    return {key: (one, duration) for key, one in found.items()}


def recorded(actuator: Actuator, duration: float) -> Recording:
    """Record an actuator."""
    record = actuator.record(actuator.excitation(duration)).recordings[0]
    return thinned(record.section(round(BEGIN / record.sample_time), record.n_samples), FACTOR)


def collected(found: Mapping[tuple[str, str], Recording]) -> Records:
    """Sort what was recorded."""
    groups: dict[str, dict[str, Recording]] = {}
    for (group, name), record in found.items():
        groups.setdefault(group, {})[name] = record
    return Records(
        fleet=groups["fleet"],
        steady=groups["steady"],
        level=groups["level"],
        repeats=groups["repeats"],
        shared=groups["shared"],
        tolerances=groups["tolerances"],
        specification=groups["specification"][""],
    )


def _made(plant: Plant, seed: tuple[int, ...]) -> Actuator:
    return Actuator(name="made", plant=plant, story="", seed=seed)


def _off(name: str) -> Plant:
    """The specification with one quantity at the upper end of its tolerance."""
    wished, factor = specification(), 1 + TOLERANCES[name].share
    if hasattr(wished.rig, name):
        return wished.with_rig(replace(wished.rig, **{name: factor * getattr(wished.rig, name)}))
    return wished.with_values({name: factor * wished.parameters[name].value})
