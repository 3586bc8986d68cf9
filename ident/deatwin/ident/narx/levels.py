"""Detect inputs with few levels, for which high powers are sums of lower ones and give no information."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from deatwin.ident.narx.terms import Term, Variable
from deatwin.plant.arrays import Array
from deatwin.plant.recording import Recording

_GLANCE = 256  # samples that suffice to show at once that a signal has many levels
_ROUNDING = 1e-12  # share of the largest value that arithmetic and decimal files may add to a level
_SCATTER = 0.01  # share of the range: the usual readback errs by less, and what scatters more may act on the plant
_APART = 0.1  # share of the range: ten such deviations, a gap that noise on a level does not bridge
_SHARE = 0.1
"""Least share of the samples on a level: scatter about a rarer one, as before a start, may be the experiment."""
_WHITE = 0.7  # least median step between readings, by their median deviation: 1.4 for white noise, 0 for a held motion
_SETTLED = 1e-3
"""Share of the range: what a filter leaves of an edge between holds, too little to show a gain of its own."""


def few_levels(values: Array, most: int) -> Array:
    """Return the levels (n_levels,) of a signal, up to noise and edges; empty if there are more than `most`."""
    flat = np.ravel(values)
    for part in (flat[:_GLANCE], flat):
        distinct = np.unique(part)
        apart = np.diff(distinct, prepend=-np.inf) > _ROUNDING * np.abs(distinct).max(initial=0.0)
        if np.count_nonzero(apart) > most:
            return _blurred_levels(flat, most)
    return distinct[apart]


def _blurred_levels(values: Array, most: int) -> Array:
    """Return the few levels around which white noise scatters readings at rest; None for a moving signal."""
    span = float(np.ptp(values))
    still = np.abs(np.diff(values)) <= 4.0 * _SCATTER * span
    resting = np.append(still, True) & np.append(True, still)
    seen = values[resting] if 2 * np.count_nonzero(resting) > values.size else values
    ordered = np.sort(seen)
    cuts = np.flatnonzero(np.diff(ordered) > _APART * span)
    if not 0 < cuts.size < most:
        return np.empty(0)
    which = np.searchsorted(0.5 * (ordered[cuts] + ordered[cuts + 1]), seen)
    parts = [seen[which == number] for number in range(cuts.size + 1)]
    clear = all(
        part.size >= _SHARE * seen.size
        and part.std() <= _SCATTER * span
        and np.median(np.abs(np.diff(part))) + _SETTLED * span >= _WHITE * np.median(np.abs(part - np.median(part)))
        for part in parts
    )
    return np.array([np.median(part) for part in parts]) if clear else np.empty(0)


def input_levels(recordings: Sequence[Recording], most: int) -> dict[int, Array]:
    """Return the levels (n_levels,) of each input that takes few in all recordings together, by its row."""
    rows = range(max(len(record.inputs) for record in recordings))
    pieces = {row: [record.inputs[row] for record in recordings if row < len(record.inputs)] for row in rows}
    found = {row: few_levels(np.concatenate(values), most) for row, values in pieces.items()}
    return {row: levels for row, levels in found.items() if levels.size}


def without_repeated_powers(terms: Sequence[Term], recordings: Sequence[Recording]) -> tuple[Term, ...]:
    """Remove candidates that equal lower ones, because an input with levels l obeys ``prod(u - l) = 0``."""
    degree = max((term.degree for term in terms), default=0)
    relations = {
        row: np.asarray(np.poly(levels), dtype=np.float64)
        for row, levels in input_levels(recordings, degree).items()
        if levels.size > 1  # a constant input is left to the user
    }
    there = set(terms)
    return tuple(term for term in terms if not any(_repeats(term, v, p, relations, there) for v, p in term.factors))


def said_of_levels(name: str, count: int) -> str:
    """Return a sentence on what an input with few levels cannot show."""
    if count == 1:
        return f"{name} is constant, so the recording does not show its effect"
    shown = "curvature" if count == 2 else f"power from the {count}th on" if count > 3 else "third power or higher one"
    return (
        f"{name} takes only {count} levels, which show no {shown}: use an input with more levels, or keep the powers of "
        f"{name} in the model below {count}"
    )


def remarks_on_levels(recordings: Sequence[Recording], degree: int) -> tuple[str, ...]:
    """Return sentences on inputs with too few levels for models of a degree."""
    names = recordings[0].input_names
    return tuple(said_of_levels(names[row], found.size) for row, found in input_levels(recordings, degree).items())


def _repeats(term: Term, variable: Variable, power: int, relations: dict[int, Array], there: set[Term]) -> bool:
    """Return whether a term is a sum of other terms by the level relation of one of its inputs."""
    relation = relations.get(variable.index) if variable.kind == "u" and variable.shape is None else None
    if relation is None or power < relation.size - 1:
        return False
    others = list(term.expanded)
    for _ in range(relation.size - 1):
        others.remove(variable)
    # u^m = -(a_1 u^(m-1) + .. + a_m), the first of the coefficients being 1
    lower = [relation.size - 1 - i for i in range(1, relation.size) if relation[i] != 0.0]
    return all(Term.product([*others, *[variable] * exponent]) in there for exponent in lower)
