"""Signals and events of a film that loses tension or breaks down.

A membrane wrinkles where a true in-plane stress, including the Maxwell stress, falls below zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.film import AnyFilm, FilmPoint
from deatwin.plant.rest import TENSION
from deatwin.plant.simulate import RunStatus
from deatwin.plant.timeline import Timeline
from deatwin.plant.words import spaced

Symbol = Any
BREAKDOWN = "breakdown_share"
EVENTS = ((TENSION, RunStatus.TENSION_LOST, -1.0, 0.0), (BREAKDOWN, RunStatus.BREAKDOWN, 1.0, 1.0))
"""Signal, event that it indicates, sign of the excess, and threshold."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """Event in the film during a sample, such as loss of tension or breakdown.

    Parameters
    ----------
    status : RunStatus
        Kind of event.
    time : float
        Time at which the command of this sample was applied, on the experiment's clock, s.
    command : float
        Command of this sample, in the unit of the rig's command.
    film_voltage : float
        Voltage across the film, V; NaN if unknown.
    place : str
        Place in the film, such as "electrode, 3.2 mm from the middle"; empty if unknown.
    """

    status: RunStatus
    time: float
    command: float
    film_voltage: float
    place: str

    def __str__(self) -> str:
        what = spaced(self.status.name.lower())
        volts = f" ({self.film_voltage:.0f} V on the film)" if np.isfinite(self.film_voltage) else ""
        where = f": {self.place}" if self.place else ""
        return f"{what} at {self.time:.2f} s and a command of {self.command:.3f}{volts}{where}"


def watch_limits(film: AnyFilm, squared_voltage: Symbol, build: Builder) -> None:
    """Watch how near the film is to loss of tension and to breakdown, and where."""
    _watch_least(TENSION, _true_stresses(film, squared_voltage), [p for p in film.points for _ in (1, 2)], 1, build)
    if shares := breakdown_shares(film, build):
        _watch_least(BREAKDOWN, shares, [p for p in film.points if p.active], -1, build)


def _true_stresses(film: AnyFilm, squared_voltage: Symbol) -> list[Symbol]:
    """Return the stresses along meridian and hoop of each point in turn, Pa."""
    virtual = ca.vertcat(*(v for p in film.points for v in p.virtual or ()))
    work = film.force(virtual, squared_voltage)
    pairs = [(p.stretches[axis], p.volume) for p in film.points for axis in (0, 1)]
    return [stretch * work[k] / volume for k, (stretch, volume) in enumerate(pairs)]


def breakdown_shares(film: AnyFilm, build: Builder) -> list[Symbol]:
    """Return the field at each electrode point divided by its breakdown field; empty if that is unknown."""
    thickness, voltage, law = build.parameter("thickness"), ca.fabs(build.signal("film_voltage")), film.breakdown
    points = [] if law is None else [(p, thickness / (p.stretches[0] * p.stretches[1])) for p in film.points]
    return [voltage / now / law.at(now, *p.stretches) for p, now in points if p.active]  # type: ignore[union-attr]


def _watch_least(name: str, values: Sequence[Symbol], points: Sequence[FilmPoint], sign: int, build: Builder) -> None:
    """Watch the smallest value (for a negative sign, the largest) and its point."""
    least, radius, active = values[0], points[0].mounted, float(points[0].active)
    for value, point in zip(values[1:], points[1:], strict=True):
        nearer = sign * value < sign * least
        least, radius = ca.if_else(nearer, value, least), ca.if_else(nearer, point.mounted, radius)
        active = ca.if_else(nearer, float(point.active), active)
    build.watch(name, least)
    build.watch(f"{name}_radius", radius)
    build.watch(f"{name}_active", active)


def film_events(
    signals: Mapping[str, np.ndarray], status: RunStatus, timeline: Timeline, snaps: Sequence[int] = ()
) -> tuple[Event, ...]:
    """Return the events of the film along a simulation. Shapes: `signals` (n,)."""
    count = min((values.size for values in signals.values()), default=0)
    found = []
    for name, what, sign, limit in EVENTS:
        beyond = np.flatnonzero(sign * (signals.get(name, np.empty(0)) - limit) > 0)
        if beyond.size:
            found.append(_event(what, signals, int(beyond[0]), int(beyond[0]), name, timeline))
    found += [_event(RunStatus.SNAP_THROUGH, signals, sample, sample, BREAKDOWN, timeline) for sample in snaps]
    if not status.ok:
        # The film gives way where it was thinnest in the last solved sample.
        found.append(_event(status, signals, min(count, timeline.commands.size - 1), count - 1, BREAKDOWN, timeline))
    return tuple(sorted(found, key=lambda event: event.time))


def _event(
    what: RunStatus, signals: Mapping[str, np.ndarray], sample: int, seen: int, name: str, timeline: Timeline
) -> Event:
    known = seen >= 0 and f"{name}_radius" in signals
    zone = "electrode" if known and signals[f"{name}_active"][seen] else "bare film"
    uniform = "the whole film" if seen >= 0 and name in signals and not known else ""  # the stretch is uniform
    return Event(
        status=what,
        time=timeline.start + sample * timeline.sample_time,
        command=float(timeline.commands[sample]),
        # The voltage of an unsolved sample is unknown.
        film_voltage=float(signals["film_voltage"][seen]) if seen == sample and "film_voltage" in signals else np.nan,
        place=f"{zone}, {1e3 * signals[f'{name}_radius'][seen]:.1f} mm from the middle" if known else uniform,
    )
