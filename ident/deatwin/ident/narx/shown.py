"""Choose units in which the parameters of a NARX model are easy to read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deatwin.ident.narx.names import symbols_of
from deatwin.plant.arrays import Array
from deatwin.plant.prefixes import prefixed

if TYPE_CHECKING:
    from deatwin.ident.narx.model import NarxModel


_PLAIN = (1e-4, 1e6)  # Range of sizes that six digits show without an exponent: from the first to below the second


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownUnits:
    """Units in which the parameters of a model are shown."""

    factors: Array  # shape (n_terms,): Factor on each parameter
    legend: str  # Such as ``y in mm, u in kV``; empty if the parameters are those of signals in SI


def shown_units(model: NarxModel) -> ShownUnits:
    """Return units in which parameters are shown: the signals' own, or prefixed where that avoids exponents."""
    plain = ShownUnits(factors=np.ones(len(model.terms)), legend="")
    trained = model.operating
    exponents = _exponents(model.theta)
    if trained is None or not exponents or model.table.functions:  # functions have numbers in the signals' own units
        return plain
    outputs = _sizes(
        trained.output_min - model.output_origin, trained.output_max - model.output_origin, model.output_units
    )
    inputs = _sizes(trained.input_min - model.input_origin, trained.input_max - model.input_origin, model.input_units)
    sizes = {"y": outputs, "e": outputs, "u": inputs}
    factors = np.array(
        [
            float(np.prod([sizes[v.kind][v.index][0] ** power for v, power in term.factors])) / outputs[row][0]
            for term, row in zip(model.terms, model.equations, strict=True)
        ]
    )
    if _exponents(model.theta * factors) >= exponents:
        return plain
    symbols = symbols_of(model.input_names, model.output_names)
    legend = ", ".join(
        f"{symbols[kind, row]} in {name}" for kind in "yu" for row, (_, name) in enumerate(sizes[kind]) if name
    )
    return ShownUnits(factors=factors, legend=legend)


def _exponents(theta: Array) -> int:
    """Return how many parameters would be written with an exponent."""
    size = np.abs(theta[theta != 0.0])
    return int(np.sum((size < _PLAIN[0]) | (size >= _PLAIN[1])))


def _sizes(low: Array, high: Array, units: tuple[str, ...]) -> list[tuple[float, str]]:
    """Return SI size and name of the prefixed unit for each signal."""
    largest = np.maximum(np.abs(low), np.abs(high)).tolist()
    return [prefixed(value, unit) for value, unit in zip(largest, units, strict=True)]
