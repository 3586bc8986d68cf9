"""C code that evaluates one function at several points at once, one per lane of a vector (GCC and Clang)."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca

LANES = 4
"""Number of points evaluated at a time, one per number in a vector. A processor with longer vectors would need fewer of
them; but the compiler cuts a vector that is too long for the processor in two, takes twice as long, keeps half as much
in registers, and moves the halves through memory."""
DIRECT = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "1.0 / {0}",
}
"""Operations that C has for vectors."""
ONE = "sqrt exp log sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh log1p expm1 erf floor ceil fabs".split()
TWO = "pow atan2 hypot fmin fmax".split()
BY_LANE = {
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}})" for name in ONE},
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}}, {{1}})" for name in TWO},
    ca.OP_CONSTPOW: "pow({0}, {1})",
    ca.OP_SIGN: "({0} > 0) - ({0} < 0)",
    ca.OP_LT: "{0} < {1}",
    ca.OP_LE: "{0} <= {1}",
    ca.OP_EQ: "{0} == {1}",
    ca.OP_NE: "{0} != {1}",
    ca.OP_NOT: "!{0}",
    ca.OP_AND: "{0} && {1}",
    ca.OP_OR: "{0} || {1}",
    ca.OP_IF_ELSE_ZERO: "{0} ? {1} : 0",
}
"""Operations done lane by lane, most by a function of C with `ONE` or `TWO` arguments; a compiler may still find a
vector instruction."""


INCLUDE = "#include <math.h>\n"
"""Line in CasADi's code after which helpers are inserted."""


@dataclass(frozen=True, kw_only=True)
class Exchange:
    """C code that replaces parts of CasADi's code."""

    bodies: Mapping[str, str] = field(default_factory=dict)
    beginnings: Mapping[str, str] = field(default_factory=dict)
    helpers: Mapping[str, str] = field(default_factory=dict)  # C functions called by these parts, by name

    def into(self, source: str) -> str:
        """Return CasADi's code with the bodies replaced."""
        for name, body in self.bodies.items():
            if found := _body(name, source):
                source = source[: found.start(1)] + body + source[found.end(1) :]
        for name, beginning in self.beginnings.items():
            if found := _body(name, source):
                source = f"{source[: found.start(1)]}{beginning}\n{source[found.start(1) :]}"
        called = [code for name, code in self.helpers.items() if f"{name}(" in source]
        return source.replace(INCLUDE, INCLUDE + "".join(f"\n{code}\n" for code in called), 1)


def _body(name: str, source: str) -> re.Match[str] | None:
    """Return the position of a function's body in CasADi's code."""
    pattern = rf"/\* {name}:\(.*?\n(?:static )?int \w+\([^)]*\) \{{\n(.*?)\n\}}\n"
    return re.search(pattern, source, flags=re.DOTALL)


def call_in_lanes(function: ca.Function, count: int) -> str:
    """Return the body of a C function that calls the code written by `in_lanes`."""
    calls = (f"{in_lanes_name(function)}(arg, res, {first}, {count})" for first in range(0, count, LANES))
    return f"  return {' || '.join(calls)};"


def in_lanes_name(function: ca.Function) -> str:
    """Return the name of the function that `in_lanes` writes."""
    return f"{function.name()}_in_lanes"


def in_lanes(function: ca.Function, varying: Sequence[int]) -> str | None:
    """Write a C function that evaluates a function at several points."""
    names = ", ".join(f"a{i}" for i in range(function.sz_w()))
    lines = [
        f"static int {in_lanes_name(function)}(const double** arg, double** res, int first, int count) {{",
        f"  typedef double lanes __attribute__((vector_size({LANES * 8})));",
        f"  lanes {names};",
        "  const lanes zero = {0};",
        f"  const int points = count - first < {LANES} ? count - first : {LANES};",
        "  int k;",
        # Lanes without a point repeat the last point, so that they raise no further floating-point exceptions.
        *(f"  const int p{k} = first + ({k} < points ? {k} : points - 1);" for k in range(LANES)),
    ]
    for number in range(function.n_instructions()):
        line = _statement(function, number, varying)
        if line is None:
            return None
        lines.append(f"  {line}")
    return "\n".join([*lines, "  return 0;", "}"])


def _statement(function: ca.Function, number: int, varying: Sequence[int]) -> str | None:
    """Write one instruction in C."""
    operation = function.instruction_id(number)
    inputs, outputs = function.instruction_input(number), function.instruction_output(number)
    if operation == ca.OP_OUTPUT:
        result, entry = outputs
        target = f"res[{result}][(first + k) * {function.nnz_out(result)} + {entry}]"
        return f"if (res[{result}]) for (k = 0; k < points; ++k) {target} = a{inputs[0]}[k];"
    target = f"a{outputs[0]}"
    if operation == ca.OP_CONST and math.isfinite(function.instruction_constant(number)):
        return f"{target} = zero + {function.instruction_constant(number)!r};"
    if operation == ca.OP_INPUT:
        argument, entry = inputs
        if argument not in varying:
            return f"{target} = zero + arg[{argument}][{entry}];"
        points = [f"arg[{argument}][p{lane} * {function.nnz_in(argument)} + {entry}]" for lane in range(LANES)]
        return f"{target} = (lanes){{{', '.join(points)}}};"
    if operation in DIRECT:
        return f"{target} = {DIRECT[operation].format(*(f'a{i}' for i in inputs))};"
    if operation in BY_LANE:
        value = BY_LANE[operation].format(*(f"a{i}[k]" for i in inputs))
        return f"{{ lanes b; for (k = 0; k < {LANES}; ++k) b[k] = {value}; {target} = b; }}"
    return None
