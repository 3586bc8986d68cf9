"""The functions among which a free form is sought, and their values along recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

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

__all__ = ["dictionary", "evaluated"]

TIMES = np.logspace(-1, 2, 7)
"""Time constants of low-passes, s: two a decade."""
WIDTHS = (0.15, 0.4, 1.0)
"""Half widths of plays and dead bands, in units of the signal's scale."""


def dictionary(series: Sequence[Mapping[str, np.ndarray]], position: str, rate: str | None) -> tuple[Primitive, ...]:
    """Functions of state, input and time, with and without memory.

    Parameters
    ----------
    series : sequence of mapping of str to ndarray, each of shape (n,)
        For each experiment the signals from rest on, SI: they give the scales.
    position : str
        The signal that moves, ``"displacement"`` or the reading.
    rate : str or None
        Its velocity; None where nobody knows it.

    Returns
    -------
    tuple of Primitive
        Of signals that do not move there are none.
    """
    scales = {name: _scale(series, name) for name in (position, rate, "command", "command_rate", "time") if name}
    x, u = ({"variable": name, "scale": scales[name]} for name in (position, "command"))
    found: list[Primitive] = [
        *(Power(order=n, **x) for n in (1, 2, 3)), Magnitude(**x),
        *(DeadBand(width=w, **x) for w in WIDTHS), *(Play(width=w, **x) for w in WIDTHS), Largest(**x), Smallest(**x),
        *(LowPass(time=float(t), **x) for t in TIMES),
        *(Power(order=n, **u) for n in (1, 2, 4)),
        *(LowPass(time=float(t), order=2, **u) for t in TIMES),
        Power(variable="command_rate", scale=scales["command_rate"]),
        Power(variable="time", scale=scales["time"]),
    ]  # fmt: skip
    if rate is not None:
        v = {"variable": rate, "scale": scales[rate]}
        found += [Power(**v), Magnitude(**v), SignedSquare(**v)]
    return tuple(term for term in found if term.scale > 0)


def _scale(series: Sequence[Mapping[str, np.ndarray]], name: str) -> float:
    """Rms."""
    whole = np.concatenate([signals[name] for signals in series])
    return float(np.sqrt(np.mean(whole**2)))


def evaluated(
    terms: Sequence[Primitive], signals: Mapping[str, np.ndarray], sample_time: float
) -> np.ndarray:
    """Values of functions along one experiment.

    Parameters
    ----------
    terms : sequence of Primitive
        k of them.
    signals : mapping of str to ndarray, each of shape (n,)
        From rest on, SI.
    sample_time : float
        s.

    Returns
    -------
    ndarray, shape (n, k)
        Memories, which start at rest, by implicit Euler steps with one Newton update each.
    """
    names = tuple(dict.fromkeys(term.variable for term in terms))
    sampled = ca.SX.sym("s", len(names))
    memory = ca.SX.sym("m", len(terms))
    values, nexts, rests = [], [], []
    for number, term in enumerate(terms):
        s, m = sampled[names.index(term.variable)] / term.scale, memory[number]
        shape = term.shape_parameter.value if term.shape_parameter is not None else 0.0
        after = m
        if term.remembers:
            rate = term.rate(s, m, shape, sample_time)
            after = m + sample_time * rate / (1 - sample_time * ca.jacobian(rate, m))
        nexts.append(after)
        values.append(term.value(s, after, shape))
        rests.append(term.at_rest(s) if term.remembers else 0.0)
    step = ca.Function("step", [memory, sampled], [ca.vertcat(*nexts), ca.vertcat(*values)])
    start = ca.Function("start", [sampled], [ca.vertcat(*rests)])
    rows = np.array([signals[name] for name in names])
    found = step.mapaccum(rows.shape[1])(start(rows[:, 0]), rows)[1]
    return np.asarray(found).T
