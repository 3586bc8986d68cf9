"""Polynomial NARMAX terms: lags of candidates, and terms written, parsed, generated, and evaluated as regressors.

A term is a product of lagged outputs, inputs and noise, written as ``y(k-1)u(k-2)^2``, with several channels as
``y1(k-1)u3(k-2)^2``; the constant is ``1``. Factors may be functions of a signal; see `deatwin.ident.narx.shapes`. A
rule that says which products are candidates is any callable that takes a `Term` and returns a bool; `AtMost` prints, so
that a model's provenance names it.

>>> [str(term) for term in generate_terms(1, 1, 2, rule=AtMost(output=1))]
['1', 'y(k-1)', 'u(k-1)', 'y(k-1)u(k-1)', 'u(k-1)^2']
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import whole_number
from deatwin.ident.narx.variables import SignalNames, read_factor, value_of
from deatwin.ident.narx.variables import Variable as Variable
from deatwin.plant.arguments import kind_of
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError, nearest
from deatwin.plant.safe_read import clipped

ChannelLags = int | Sequence[int]  # A number n for the lags 1..n, or the lags themselves, in samples
Lags = ChannelLags | Sequence[ChannelLags] | Mapping[str, ChannelLags]
"""Lags of all channels of a kind, or of each channel, in order or by name."""

_KINDS = {"u": "input", "y": "output"}


def lag_list(lags: ChannelLags, *, smallest: int) -> tuple[int, ...]:
    """Return lags in samples as an increasing tuple; a number n stands for 1..n, 0 for none."""
    if not isinstance(lags, int | np.integer | Iterable):
        raise ModelError(f"lags = {lags!r}; give a number n >= 0 for 1..n, or a sequence of lags")
    wanted = range(1, lags + 1) if isinstance(lags, int | np.integer) else lags
    if isinstance(lags, int | np.integer) and lags < 0:
        raise ModelError(f"lags = {lags}; give a number n >= 0 for 1..n, or a sequence of lags")
    if any(not isinstance(lag, int | np.integer) or lag < smallest for lag in wanted):
        raise ModelError(f"lags {list(wanted)!r} must be integers of at least {smallest}")
    return tuple(sorted({int(lag) for lag in wanted}))


def channel_lags(lags: Lags, kind: str, count: int, names: Sequence[str] = ()) -> tuple[tuple[int, ...], ...]:
    """Return the lags of each channel as an increasing tuple."""
    smallest = 1 if kind == "y" else 0
    if isinstance(lags, Mapping):
        values = _by_name(lags, kind, count, names)
    elif _is_nested(lags):
        values = list(lags)  # type: ignore[arg-type]
    else:
        return (lag_list(lags, smallest=smallest),) * count  # type: ignore[arg-type]
    if len(values) != count:
        raise ModelError(f"{_KINDS[kind]}_lags hold the lags of {len(values)} {_KINDS[kind]}s; there are {count}")
    return tuple(lag_list(value, smallest=smallest) for value in values)


def lags_anywhere(lags: Lags) -> tuple[int, ...]:
    """Return the lags of all channels in one list, with repetitions."""
    if isinstance(lags, Mapping) or _is_nested(lags):
        values: Iterable[Any] = lags.values() if isinstance(lags, Mapping) else lags  # type: ignore[assignment]
        return tuple(lag for value in values for lag in lag_list(value, smallest=0))
    return lag_list(lags, smallest=0)  # type: ignore[arg-type]


def _is_nested(lags: Any) -> bool:
    return isinstance(lags, Iterable) and any(isinstance(one, Iterable) and not isinstance(one, str) for one in lags)


def _by_name(lags: Mapping[str, ChannelLags], kind: str, count: int, names: Sequence[str]) -> list[ChannelLags]:
    side = _KINDS[kind]
    placed = [f"{kind}{row + 1}" for row in range(count)] if count > 1 else [kind] * count
    known = list(names) or placed
    row_of = dict(zip(placed, range(count), strict=True)) | dict(zip(known, range(count), strict=True))
    found: dict[int, ChannelLags] = {}
    for name, value in lags.items():
        if name not in row_of:
            raise ModelError(
                f"{side}_lags name {name!r}{nearest(str(name), known)}; the {side}s are {', '.join(known) or 'none'}"
            )
        if row_of[name] in found:
            raise ModelError(f"{side}_lags name the {side} {known[row_of[name]]} twice, the second time as {name!r}")
        found[row_of[name]] = value
    left = [known[row] for row in range(count) if row not in found]
    if left:
        raise ModelError(f"{side}_lags leave out {', '.join(left)}; give [] for what has no lags")
    return [found[row] for row in range(count)]


def channel_numbers(count: int) -> Sequence[int]:
    """Return the numbers that the channels of a kind have in terms: 1, 2, ..., or 0 for a single one."""
    return range(1, count + 1) if count > 1 else (0,) * count


Rule = Callable[["Term"], bool]

MOST_TERMS = 20_000  # Most candidates; for more, the Gram matrix alone would need gigabytes


@dataclass(frozen=True, slots=True)
class Term:
    """Product of powers of lagged signals.

    Parameters
    ----------
    factors : tuple of (Variable, int)
        Variables in the order in which they are written, each with its power (at least 1); empty for the constant term.
    """

    factors: tuple[tuple[Variable, int], ...]

    @classmethod
    def product(cls, variables: Iterable[Variable]) -> Term:
        """Return the product of `variables`, given in any order; a variable that occurs n times gets the power n."""
        return cls(tuple(sorted(Counter(variables).items())))

    @classmethod
    def parse(cls, text: str, *, input_names: Sequence[str] = (), output_names: Sequence[str] = ()) -> Term:
        """Read a term from its written form `text`, such as ``y(k-1)u(k-2)^2``; spaces and ``*`` are allowed.

        `input_names` and `output_names` are names that the text may use for the signals; they take precedence over u1,
        y1 and so on. ModelError if the text is not a term, or names a signal that does not exist.
        """
        if not isinstance(text, str):
            raise ModelError(f"a term must be text such as y(k-1)u(k-2)^2; got {kind_of(text)}")
        if text.strip() == "1":
            return cls(())
        names = SignalNames(tuple(input_names), tuple(output_names))
        variables: list[Variable] = []
        position = 0
        while position < len(text):
            variable, power, position = read_factor(text, position, names)
            variables += [variable] * power
        if not variables:
            raise ModelError(f"the term {text!r} is empty; write 1 for the constant")
        return cls.product(variables)

    @property
    def degree(self) -> int:
        """Sum of the powers of the factors; 0 for the constant term."""
        return sum(power for _, power in self.factors)

    @property
    def expanded(self) -> tuple[Variable, ...]:
        """Factors with each variable repeated as often as its power."""
        return tuple(variable for variable, power in self.factors for _ in range(power))

    def written(self, symbols: Mapping[tuple[str, int], str]) -> str:
        """Return the term as text with other symbols for its signals.

        `symbols` maps the kind of a signal ("y", "u" or "e") and its row index to the symbol. Other signals keep their
        symbols.
        """
        factors = [(v.written(symbols.get((v.kind, v.index), v.symbol)), power) for v, power in self.factors]
        return "".join(f"{text}^{power}" if power > 1 else text for text, power in factors) or "1"

    def __str__(self) -> str:
        return self.written({})


def without(term: Term, variable: Variable) -> Term:
    """Return a term without one factor."""
    factors = list(term.expanded)
    factors.remove(variable)
    return Term.product(factors)


def require_terms(given: object, name: str, example: str, least: int = 0) -> None:
    """Raise ModelError for anything but terms that can be read twice: a collection, or one for each output."""
    equations = given.values() if isinstance(given, Mapping) else (given,)
    for one in equations:
        listed = one if isinstance(one, Collection) and not isinstance(one, str) else (None,)
        if len(listed) < least or not all(isinstance(term, str | Term) for term in listed):
            raise ModelError(f"{name} = {clipped(repr(given))}; give a list of terms, as {example}")


def generate_terms(
    output_lags: Lags,
    input_lags: Lags,
    degree: int,
    *,
    n_inputs: int = 1,
    n_outputs: int = 1,
    functions: Sequence[Variable] = (),
    rule: Rule | None = None,
) -> tuple[Term, ...]:
    """Return all candidate terms up to a degree, in the order of their degrees; the constant term comes first.

    Parameters
    ----------
    output_lags, input_lags : int, sequence, or mapping of str to int or sequence of int
        Lags in samples: a number n for the lags 1 to n, or a list of lags; an input lag may be 0. One value applies to
        every channel. To give each channel its own lags, write ``[[1, 2], [4, 5]]`` or
        ``{"u1": [1, 2], "u2": [4, 5]}``.
    degree : int
        Largest degree of a term, at least 1.
    n_inputs, n_outputs : int
        Numbers of inputs and outputs. In the terms, channels are written u1, u2, ... and y1, y2, ...; a single
        input is written u, and a single output y.
    functions : sequence of Variable
        Functions of lagged signals, such as |u(k-1)|, as additional factors. A candidate contains each function at most
        once.
    rule : callable, optional
        Function of a `Term` that returns True if the term is a candidate; see `deatwin.ident.narx.terms`.

    Returns
    -------
    tuple of Term
        Candidates. Without functions and rule, n lagged signals give (n + degree)! / (n! degree!) terms.

    Raises
    ------
    ModelError
        If an argument is invalid, there would be more than 20 000 terms, or the rule drops all terms.

    Examples
    --------
    >>> [str(term) for term in generate_terms(output_lags=1, input_lags=1, degree=2)]
    ['1', 'y(k-1)', 'u(k-1)', 'y(k-1)^2', 'y(k-1)u(k-1)', 'u(k-1)^2']
    """
    for name, value, least in (("degree", degree, 1), ("n_inputs", n_inputs, 0), ("n_outputs", n_outputs, 0)):
        whole_number(value, name, least)
    if rule is not None and not callable(rule):
        raise ModelError(f"rule = {rule!r}; it must be a callable that takes a term, or None")
    variables = []
    for kind, count, lags in (
        ("y", n_outputs, channel_lags(output_lags, "y", n_outputs)),
        ("u", n_inputs, channel_lags(input_lags, "u", n_inputs)),
    ):
        variables += [
            Variable(kind, n, lag) for n, own in zip(channel_numbers(count), lags, strict=True) for lag in own
        ]
    variables += dict.fromkeys(functions)
    if not variables:
        raise ModelError("no lags at all; give output_lags or input_lags")
    candidates = math.comb(len(variables) + degree, degree)
    if candidates > MOST_TERMS:
        raise ModelError(
            f"{len(variables)} lagged signals of degree {degree} make {candidates} candidate terms; "
            f"at most {MOST_TERMS} can be handled: take fewer lags or a lower degree"
        )
    products = (
        Term.product(chosen) for n in range(degree + 1) for chosen in combinations_with_replacement(variables, n)
    )
    # |x|^2 is x^2 and sign(x)^2 is 1; powers of other functions offer nothing that a further function would not.
    once = (term for term in products if all(power == 1 for v, power in term.factors if v.shape is not None))
    terms = tuple(term for term in once if rule is None or rule(term))
    if not terms:
        raise ModelError(f"the rule {rule!r} leaves none of {candidates} candidate terms")
    return terms


@dataclass(frozen=True, eq=False)
class TermTable:
    """Terms of a model, evaluated for many samples at once.

    Parameters
    ----------
    terms : tuple of Term
        Terms to evaluate.
    """

    terms: tuple[Term, ...]

    @cached_property
    def variables(self) -> tuple[Variable, ...]:
        """Different variables in the terms: first those of outputs, then of inputs, then of noise."""
        return tuple(sorted({variable for term in self.terms for variable, _ in term.factors}))

    @cached_property
    def exponents(self) -> NDArray[np.int64]:
        """Power of each variable in each term, shape (n_terms, n_variables), read-only."""
        column = {variable: j for j, variable in enumerate(self.variables)}
        table = np.zeros((len(self.terms), len(column)), dtype=np.int64)
        for row, term in zip(table, self.terms, strict=True):
            for variable, power in term.factors:
                row[column[variable]] = power
        table.setflags(write=False)
        return table

    @cached_property
    def max_lag(self) -> int:
        """Largest lag in samples, which is the index of the first sample that can be computed."""
        return max((variable.reach for variable in self.variables), default=0)

    @cached_property
    def functions(self) -> tuple[Variable, ...]:
        """Return the ``variables`` that are functions of a signal."""
        return tuple(variable for variable in self.variables if variable.shape is not None)

    def in_units(self, scales: Mapping[str, Array]) -> TermTable:
        """Return the same terms for signals in other units.

        ``scales[kind][row]`` is the size of a signal's new unit in the old unit. A function of the signal, such as
        sat(y(k-1),0.5), multiplies the signal by this number, so that the limit 0.5 stays in the old unit.
        """
        if not self.functions:
            return self

        def scaled(v: Variable) -> Variable:
            if v.shape is None:
                return v
            return replace(v, shape=replace(v.shape, gain=v.shape.gain * float(scales[v.kind][v.index])))

        return TermTable(tuple(Term(tuple((scaled(v), p) for v, p in term.factors)) for term in self.terms))

    def of_signals(self, lagged: Callable[[Variable, int], Array]) -> list[Array]:
        """Return the values of each variable; the function `lagged` returns a variable's signal at a given lag."""
        return [value_of(v, lagged) for v in self.variables]

    def channels(self, kind: str) -> int:
        """Return the number of channels of a `kind`, "y", "u" or "e", that the terms need."""
        return max((v.index + 1 for v in self.variables if v.kind == kind), default=0)

    @cached_property
    def _plan(self) -> tuple[tuple[int | None, tuple[int, ...]], ...]:
        """Return, for each term, the earlier term that it extends by a factor, if any, and the factors to multiply."""
        column = {variable: j for j, variable in enumerate(self.variables)}
        seen: dict[tuple[Variable, ...], int] = {}
        plan = []
        for position, term in enumerate(self.terms):
            factors = term.expanded
            parent = seen.get(factors[:-1]) if len(factors) > 1 else None
            rest = factors if parent is None else factors[-1:]
            plan.append((parent, tuple(column[variable] for variable in rest)))
            seen.setdefault(factors, position)
        return tuple(plan)

    def rows(self, inputs: Array, outputs: Array, start: int, stop: int, noise: Array | None = None) -> Array:
        """Evaluate all terms over the samples [start:stop) of one recording, in the units of the model's parameters.

        `inputs` has the shape (n_inputs, n), `outputs` and `noise` (n_outputs, n); `start` must be at least ``max_lag``.
        Returns the transposed regressors, (n_terms, stop - start); ModelError if terms need a noise that is not given.
        """
        signal = {"y": outputs, "u": inputs, "e": noise}
        if noise is None and self.channels("e"):
            raise ModelError("the terms hold noise e(k-l), which is not measured: give its values")

        def lagged(v: Variable, lag: int) -> Array:
            return signal[v.kind][v.index, start - lag : stop - lag]  # type: ignore[index]

        return self.over(self.of_signals(lagged), stop - start)

    def over(self, lagged: Sequence[Array], count: int) -> Array:
        """Evaluate all terms. Returns an array of shape (n_terms, count).

        `lagged` holds one array of `count` values for each variable, in the order of ``variables``.
        """
        rows = np.empty((len(self.terms), count))
        for row, (parent, rest) in zip(rows, self._plan, strict=True):
            row[:] = 1.0 if parent is None else rows[parent]
            for j in rest:
                row *= lagged[j]
        return rows

    def at(self, values: Array) -> Array:
        """Evaluate all terms for one value of each variable. Shapes: `values` (n_variables,), returns (n_terms,)."""
        return np.asarray(np.prod(values**self.exponents, axis=1), dtype=np.float64)


def derivative(terms: Sequence[Term], theta: Array, variable: Variable) -> tuple[TermTable, Array]:
    """Return terms and coefficients of the derivative of a sum of terms by a variable. Shapes: `theta` (n_terms,)."""
    powers = [dict(term.factors).get(variable, 0) for term in terms]
    held = [m for m, power in enumerate(powers) if power]
    return TermTable(tuple(without(terms[m], variable) for m in held)), np.array([theta[m] * powers[m] for m in held])


@dataclass(frozen=True, kw_only=True)
class AtMost:
    """Bounds the degree in each kind of signal; ``AtMost(output=1)`` keeps models that are affine in the output."""

    output: int | None = None
    input: int | None = None

    def __call__(self, term: Term) -> bool:
        bounds = (("y", self.output), ("u", self.input))
        return all(
            bound is None or sum(power for v, power in term.factors if v.kind == kind) <= bound
            for kind, bound in bounds
        )
