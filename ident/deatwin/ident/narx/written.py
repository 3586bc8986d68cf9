"""Convert the equations of NARX models from text to terms and back, in units that are easy to read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.narx.terms import Term
from deatwin.ident.narx.variables import symbols_of
from deatwin.plant.arrays import Array, texts
from deatwin.plant.errors import ModelError
from deatwin.plant.prefixes import prefixed

if TYPE_CHECKING:
    from deatwin.ident.narx.model import NarxModel


def by_equation(
    terms: Mapping[str, float] | Mapping[str, Mapping[str, float]], output_names: Sequence[str] = ()
) -> list[tuple[int, str, float]]:
    """Return output row, text and parameter of each written term."""
    if not isinstance(terms, Mapping):
        raise ModelError(f'terms are given as a {type(terms).__name__}; give a mapping, as {{"y(k-1)": 0.5}}')
    if not terms:
        raise ModelError("no terms are given; a NARX model needs at least one")
    equations = {name: value for name, value in terms.items() if isinstance(value, Mapping)}
    if not equations:
        return [(0, text, _number(text, value)) for text, value in terms.items()]
    wanted = [f"y{number}" for number in range(1, len(terms) + 1)]
    if list(equations) not in (wanted, list(output_names)):
        raise ModelError(f"equations {', '.join(terms)}: give a mapping of terms for each of {', '.join(wanted)}")
    return [
        (row, text, _number(text, value))
        for row, equation in enumerate(equations.values())
        for text, value in equation.items()
    ]


def _number(text: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ModelError(f"the parameter of {text} is {value!r}; it must be a number") from None


def name_signals(details: dict[str, Any], side: str, count: int) -> None:
    """Number the signals of one side if there are several without names; each has a unit, unknown by default."""
    if count > 1:
        details.setdefault(f"{side}_names", tuple(f"{side}{number}" for number in range(1, count + 1)))
    if f"{side}_names" in details:
        details.setdefault(f"{side}_units", ("",) * len(texts(details[f"{side}_names"])))


def written(
    terms: Sequence[Term],
    theta: Array,
    equations: Sequence[int],
    input_names: Sequence[str],
    output_names: Sequence[str],
) -> str:
    """Return the equations of a model as text, a line each. Shapes: `theta` (n_terms,)."""
    symbols = symbols_of(input_names, output_names)
    right: list[list[str]] = [[] for _ in output_names]
    for term, value, row in zip(terms, theta, equations, strict=True):
        right[row].append(f"{value:.6g} {term.written(symbols)}")
    lines = (f"{symbols['y', row]}(k) = {' + '.join(sums)} + {symbols['e', row]}(k)" for row, sums in enumerate(right))
    return "\n".join(lines).replace("+ -", "- ")


def origins(model: NarxModel) -> str:
    """Return a line that states the origins of the signals; empty if they are zero."""
    said, symbols = [], symbols_of(model.input_names, model.output_names)
    for kind, names, units, values in (
        ("y", model.output_names, model.output_units, model.output_origin),
        ("u", model.input_names, model.input_units, model.input_origin),
    ):
        for row, (name, unit, value) in enumerate(zip(names, units, values.tolist(), strict=True)):
            if value:
                symbol = symbols[kind, row]
                what = f"{symbol} counts from" if symbol == name else f"{symbol} is {name} less"
                said.append(f"{what} {value:.12g} {unit if unit != '1' else ''}".rstrip())
    return "\nwhere " + ", ".join(said) if said else ""


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
