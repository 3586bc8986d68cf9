"""Convert the equations of NARX models from text to terms and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from deatwin.ident.narx.names import symbols_of
from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array, texts
from deatwin.plant.errors import ModelError

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
