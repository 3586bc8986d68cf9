"""Inputs of few levels: a power from their number on is a sum of lower ones on every sample, and tells nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.terms import Term, Variable
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]

_GLANCE = 256  # samples that show at once that a signal has many levels
_ROUNDING = 1e-12  # of the largest value: what arithmetic and decimal files make of one level


def few_levels(values: Array, most: int) -> Array:
    """Return the levels of a signal, if it has few. Shapes: returns (n_levels,)."""
    flat = np.ravel(values)
    for part in (flat[:_GLANCE], flat):
        distinct = np.unique(part)
        apart = np.diff(distinct, prepend=-np.inf) > _ROUNDING * np.abs(distinct).max(initial=0.0)
        if np.count_nonzero(apart) > most:
            return np.empty(0)
    return distinct[apart]


def without_repeated_powers(terms: Sequence[Term], recordings: Sequence[Recording]) -> tuple[Term, ...]:
    """Leave out candidates that equal sums of lower-degree candidates because an input has few levels.

    An input with m levels l obeys ``prod(u - l) = 0``, so u^m is a sum of lower powers: with levels 0 and 1 the square
    is the input itself, with -1 and 1 the constant.
    """
    degree = max((term.degree for term in terms), default=0)
    relations: dict[int, Array] = {}
    for row in range(len(recordings[0].inputs)):
        levels = few_levels(np.concatenate([record.inputs[row] for record in recordings]), degree)
        if levels.size > 1:  # a constant input is left to the user
            relations[row] = np.asarray(np.poly(levels), dtype=np.float64)
    there = set(terms)
    return tuple(term for term in terms if not any(_repeats(term, v, p, relations, there) for v, p in term.factors))


def said_of_levels(name: str, count: int) -> str:
    """Return a sentence that says what an input with few levels cannot show."""
    if count == 1:
        return f"{name} is constant: the recording does not show what it does"
    shown = "curvature" if count == 2 else f"power from the {count}th on" if count > 3 else "third power or higher one"
    return (
        f"{name} has {count} levels and shows no {shown}: let it take more levels, or keep its powers in the model "
        f"below {count}"
    )


def remarks_on_levels(recordings: Sequence[Recording], degree: int) -> tuple[str, ...]:
    """Return sentences on inputs with too few levels for models of a degree."""
    names = recordings[0].input_names
    together = np.concatenate([record.inputs for record in recordings], axis=1)
    counts = [few_levels(values, degree).size for values in together]
    return tuple(said_of_levels(name, count) for name, count in zip(names, counts, strict=True) if count)


def _repeats(term: Term, variable: Variable, power: int, relations: dict[int, Array], there: set[Term]) -> bool:
    """Whether a term is a sum of others that are there, by the relation of one of its inputs."""
    relation = relations.get(variable.index) if variable.kind == "u" and variable.shape is None else None
    if relation is None or power < relation.size - 1:
        return False
    others = list(term.expanded)
    for _ in range(relation.size - 1):
        others.remove(variable)
    # u^m = -(a_1 u^(m-1) + .. + a_m), the first of the coefficients being 1
    lower = [relation.size - 1 - i for i in range(1, relation.size) if relation[i] != 0.0]
    return all(Term.product([*others, *[variable] * exponent]) in there for exponent in lower)
