"""The functions of which a free form may consist, and their values along recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from deatwin.ident.greybox.parts import Part
from deatwin.plant.arrays import Array, root_mean_square
from deatwin.plant.effects.primitives import (
    DeadBand,
    Largest,
    LowPass,
    Magnitude,
    Play,
    Power,
    Primitive,
    SignedSquare,
    Smallest,
)
from deatwin.plant.model import Plant

Signals = Mapping[str, Array]

SHORTEST, LONGEST, TIMES = (0.1, 5), (100.0, 1000), 7
"""Shortest and longest time constants of low passes, in s and, for a plant that is sampled slowly, in samples; and
their number."""
WIDTHS = (0.15, 0.4, 1.0)
"""Half widths of plays and dead bands, in units of the signal's scale."""
POSITION, RATE = "displacement", "velocity"
"""Names of the position and the velocity that a rig with a moving part watches."""


def signals_along(plant: Plant, part: Part, position: str) -> dict[str, Array]:
    """Return the signals on which functions can depend, along a plant's free run: means over each sample, (n,), SI.

    They run from rest to the last sample that counts. A watched velocity is the change of `position` over the sample,
    so motion between the ends of samples counts; `position` is a watched signal or, without one, the reading.
    """
    timeline, rest = plant.timeline(part.experiment), plant.rig.start.rest_command
    n = 1 + max(int(r[m].max()) for r, m in zip(timeline.readings, part.masks, strict=True) if m.any())
    commands, h = timeline.commands[:n], timeline.sample_time
    run = plant.runner.run(
        commands,
        start=timeline.start,
        sample_time=h,
        rest_command=rest,
        values=plant.free_values,
        channels=timeline.channels,
    )
    watched = dict(zip(plant.signals, run.watched if run.watched is not None else (), strict=True))
    ends = watched.get(position, run.outputs[1:])
    before = np.concatenate([ends[:1], ends[:-1]])
    found = {
        position: (before + ends) / 2,
        "command": commands,
        "command_rate": np.diff(commands, prepend=rest) / h,
        "time": timeline.start + h * (np.arange(n) + 0.5),
    }
    return {**found, RATE: (ends - before) / h} if {POSITION, RATE} <= watched.keys() else found


def dictionary(along: Sequence[Signals], position: str) -> tuple[Primitive, ...]:
    """Return functions of state, input and time, with and without memory, the simpler first.

    `along` has for each part the signals of `signals_along`, (n,), whose rms are the scales; constant signals are left
    out. `position` is the name of the signal that moves.
    """
    h = max(float(np.diff(signals["time"][:2]).sum()) for signals in along)
    first, last = (max(seconds, samples * h) for seconds, samples in (SHORTEST, LONGEST))
    times = np.geomspace(first, last, TIMES)
    names = [name for name in along[0] if any(np.ptp(signals[name]) > 0 for signals in along)]
    given: dict[str, dict[str, Any]] = {
        name: {"variable": name, "scale": root_mean_square(np.concatenate([signals[name] for signals in along]))}
        for name in names
    }
    found: list[Primitive] = []
    if position in given:
        x = given[position]
        found += [*(Power(order=n, **x) for n in (1, 2, 3)), Magnitude(**x), Largest(**x), Smallest(**x)]
        found += [kind(width=w, **x) for kind in (DeadBand, Play) for w in WIDTHS]
        found += [LowPass(time=float(t), **x) for t in times]
    if RATE in given:
        v = given[RATE]
        found += [Power(**v), Magnitude(**v), SignedSquare(**v)]
    if "command" in given:
        u = given["command"]
        found += [*(Power(order=n, **u) for n in (1, 2, 4)), *(LowPass(time=float(t), order=2, **u) for t in times)]
    found += [Power(**given[name]) for name in ("command_rate", "time") if name in given]
    return tuple(found)


def evaluated(terms: Sequence[Primitive], signals: Signals, sample_time: float) -> Array:
    """Return values of k functions along one part, (n, k); `signals`, (n,), from rest on, are in SI."""
    # Memories start at rest and follow implicit Euler steps with one Newton update each.
    names = tuple(dict.fromkeys(term.variable for term in terms))
    sampled, memory = ca.SX.sym("s", len(names)), ca.SX.sym("m", len(terms))
    values, later, rests = [], [], []
    for number, term in enumerate(terms):
        s, m = sampled[names.index(term.variable)] / term.scale, memory[number]
        shape = term.shape_parameter.value if term.shape_parameter is not None else 0.0
        if term.remembers:
            rate = term.rate(s, m, shape, sample_time)
            m = m + sample_time * rate / (1 - sample_time * ca.jacobian(rate, m))
        later.append(m)
        values.append(term.value(s, m, shape))
        rests.append(term.at_rest(s) if term.remembers else 0.0)
    step = ca.Function("step", [memory, sampled], [ca.vertcat(*later), ca.vertcat(*values)])
    start = ca.Function("start", [sampled], [ca.vertcat(*rests)])
    rows = np.array([signals[name] for name in names])
    found = step.mapaccum(rows.shape[1])(start(rows[:, 0]), rows)[1]
    return np.asarray(found).T
