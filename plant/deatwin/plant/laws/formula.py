"""A user's elastic energy as a formula: text that a file can store, without code."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import casadi as ca

from deatwin.plant.errors import RigError
from deatwin.plant.laws.energies import first_invariant, second_invariant
from deatwin.plant.safe_read import clipped

Symbol = Any
KNOWN = ("I1", "I2", "stretch_1", "stretch_2", "stretch_3")  # Names that a formula may use besides its parameters
_FUNCTIONS: Mapping[str, Callable[[Symbol], Symbol]] = MappingProxyType({"exp": ca.exp, "log": ca.log, "sqrt": ca.sqrt})
_OPERATORS: Mapping[type, Callable[..., Symbol]] = MappingProxyType(
    {
        ast.Add: operator.add,
        ast.Sub: operator.sub,
        ast.Mult: operator.mul,
        ast.Div: operator.truediv,
        ast.Pow: operator.pow,
        ast.USub: operator.neg,
        ast.UAdd: operator.pos,
    }
)
LONGEST = 1000  # Characters of a formula: more than any published energy needs, and too few to nest deeply


@dataclass(frozen=True)
class Formula:
    """Elastic energy per reference volume, J/m³, as the text of a formula.

    Parameters
    ----------
    text : str
        Formula. It may contain the invariants ``I1`` and ``I2``, the principal stretches ``stretch_1``, ``stretch_2``
        and ``stretch_3`` (across the film), numbers, the operators ``+ - * / ^``, and the functions ``exp``, ``log``
        and ``sqrt``. All other names are parameters.

    Raises
    ------
    RigError
        If the text contains anything else, or is not a formula.

    Examples
    --------
    >>> energy = Formula("mu/2*(I1 - 3) + c*(I1 - 3)^2")
    >>> energy.names, float(energy(1.0, 1.0, 25e3, 1e3))
    (('mu', 'c'), 0.0)
    """

    text: str

    def __post_init__(self) -> None:
        self.names  # noqa: B018  (checks the text)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of their first occurrence."""
        found = sorted(
            (node for node in ast.walk(self._tree) if isinstance(node, ast.Name)), key=lambda node: node.col_offset
        )
        called = {node.func.id for node in ast.walk(self._tree) if isinstance(node, ast.Call)}  # type: ignore[attr-defined]
        return tuple(dict.fromkeys(node.id for node in found if node.id not in (*KNOWN, *called)))

    def __call__(self, stretch_1: Symbol, stretch_2: Symbol, *parameters: Symbol) -> Symbol:
        """Return the energy. `stretch_1, stretch_2` principal in-plane stretches; `parameters` in the order of `names`."""
        known = (
            first_invariant(stretch_1, stretch_2),
            second_invariant(stretch_1, stretch_2),
            stretch_1,
            stretch_2,
            1 / (stretch_1 * stretch_2),
        )
        values = dict(zip(KNOWN, known, strict=True)) | dict(zip(self.names, parameters, strict=True))
        return _value(self._tree.body, values)

    @cached_property
    def _tree(self) -> ast.Expression:
        if not isinstance(self.text, str):
            raise self._error("it is not a text")
        if len(self.text) > LONGEST:
            raise self._error(f"it is longer than {LONGEST} characters")
        try:
            tree = ast.parse(self.text.strip().replace("^", "**"), mode="eval")
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise self._error("it is not a formula") from None
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                self._require_function(node)
            elif isinstance(node, ast.Constant):
                if isinstance(node.value, bool) or not isinstance(node.value, int | float):
                    raise self._error(f"{clipped(repr(node.value))} is not a number")
            elif not isinstance(node, (ast.Expression, ast.BinOp, ast.UnaryOp, ast.Name, ast.Load, *_OPERATORS)):
                raise self._error(f"{type(node).__name__.lower()} is not allowed in it")
        return tree

    def _require_function(self, node: ast.Call) -> None:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in _FUNCTIONS or len(node.args) != 1 or node.keywords:
            raise self._error(f"{clipped(ast.unparse(node), 40)} is not one of the functions {', '.join(_FUNCTIONS)}")

    def _error(self, fault: str) -> RigError:
        return RigError(
            f"the energy {clipped(repr(self.text), 80)}: {fault}; write it with I1, I2, stretch_1, stretch_2, "
            'stretch_3, numbers and names of parameters, as in "mu/2*(I1 - 3)"'
        )


def _value(node: ast.expr, values: Mapping[str, Symbol]) -> Symbol:
    """Evaluate a part of a formula."""
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return values[node.id]
    if isinstance(node, ast.Call):
        return _FUNCTIONS[node.func.id](_value(node.args[0], values))  # type: ignore[attr-defined]
    if isinstance(node, ast.UnaryOp):
        return _OPERATORS[type(node.op)](_value(node.operand, values))
    if isinstance(node, ast.BinOp):
        return _OPERATORS[type(node.op)](_value(node.left, values), _value(node.right, values))
    raise TypeError(type(node).__name__)  # the tree was checked
