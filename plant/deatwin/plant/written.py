"""Check the equations that a rig and its effects wrote, and assemble them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from deatwin.plant.equations import STAGES, Equations
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.integrator.parts import Parts
from deatwin.plant.parameters import ParameterSet
from deatwin.plant.rigfaults import not_a_number, number, unknown_symbols

Symbol = Any  # casadi.SX


class State(NamedTuple):
    """A differential state: symbol, typical size, and its value at rest if that is not where its rate is zero."""

    symbol: Symbol
    scale: float
    start: Symbol | None


@dataclass(kw_only=True)
class Written:
    """Everything that a `Builder` has collected so far."""

    parameters: ParameterSet
    symbols: dict[str, Symbol]  # Symbols of the parameters
    command: Symbol
    time: Symbol
    states: dict[str, State] = field(default_factory=dict)
    rates: dict[str, tuple[Symbol, Symbol]] = field(default_factory=dict)  # Right side and mass of each state
    coordinates: dict[str, tuple[Symbol, float]] = field(default_factory=dict)  # Symbol and typical size
    balances: list[Symbol] = field(default_factory=list)
    guesses: dict[str, Symbol] = field(default_factory=dict)
    held: dict[str, tuple[Symbol, Symbol]] = field(default_factory=dict)  # Symbol, and its expression at rest
    constants: list[tuple[Symbol, np.ndarray]] = field(default_factory=list)
    watched: dict[str, Symbol] = field(default_factory=dict)
    measured: dict[str, tuple[Symbol, Symbol, Symbol]] = field(default_factory=dict)  # Level, stored quantity, share
    past: list[Symbol] = field(default_factory=list)
    channels: dict[str, tuple[Symbol, float]] = field(default_factory=dict)  # Symbol, and its value if not measured
    displaced: list[tuple[Symbol, Symbol]] = field(default_factory=list)  # State, and its value at rest
    parts: Parts | None = None
    integrals: dict[str, float] = field(default_factory=dict)  # As in `Equations`
    shifts: dict[str, str] = field(default_factory=dict)  # As in `Equations`
    stages: int = STAGES  # As in `Equations`

    def equations(self, output: Symbol, further: Sequence[str]) -> Equations:
        """Assemble the equations with all readings; errors name what is missing or wrong."""
        self._check_complete()
        output = number(output, "what write returns, the reading,")
        x = _column(*(s for s, _, _ in self.states.values()))
        z = _column(*(s for s, _ in self.coordinates.values()))
        d = _column(*(s for s, _ in self.held.values()))
        p = _column(*(self.symbols[n] for n in self.parameters.free))
        known = [n for n in self.parameters if n not in self.parameters.free]
        c = _column(*(self.symbols[n] for n in known), *(s for s, _ in self.constants))
        f = _column(*(self.rates[n][0] for n in self.states))
        g = _column(*self.balances)
        mass = _column(*(self.rates[n][1] for n in self.states))
        u = _column(self.command, *self.past, *(s for s, _ in self.channels.values()))
        arguments = [x, z, d, u, self.time, p, c]
        rows = self._rows(further)
        self._check_symbols(arguments, output)
        moving = f if self.parts is None else self.parts.speed * f
        unknowns = {**{n: s[0] for n, s in self.states.items()}, **{n: s[0] for n, s in self.coordinates.items()}}
        guess = _column(*(self.guesses.get(n, 0.0) for n in unknowns))
        return Equations(
            states=tuple(self.states),
            coordinates=tuple(self.coordinates),
            held=tuple(self.held),
            signals=tuple(self.watched),
            scale=np.array([s[1] for s in (*self.states.values(), *self.coordinates.values())]),
            constants=np.concatenate([self.parameters.array(known), *(v for _, v in self.constants)]),
            parameters=self.parameters,
            dynamics=ca.Function("dynamics", arguments, [self._on_the_clock(ca.vertcat(moving, g))]),
            mass=ca.Function("mass", [p, c], [mass]),
            output=ca.Function("output", arguments, [self._on_the_clock(output)]),
            further=ca.Function("further", arguments, [ca.densify(self._on_the_clock(rows))]) if further else None,
            watched=ca.Function("watched", arguments, [self._on_the_clock(_column(*self.watched.values()))]),
            rest=ca.Function("rest", [x, z, u, p, c], [self._rest_residual(f, g, d)]),
            guess=ca.Function("guess", [p, c], [guess]),
            hold=ca.Function("hold", [x, z, p, c], [self._held_at_start()]),
            history=len(self.past),
            integrals=self.integrals,
            shifts=self.shifts,
            channels={name: default for name, (_, default) in self.channels.items()},
            stages=self.stages,
        )

    def _check_complete(self) -> None:
        if missing := set(self.states) - set(self.rates):
            raise RigError(f"no rate is given for state {', '.join(sorted(missing))}")
        if len(self.balances) != len(self.coordinates):
            raise RigError(
                f"{len(self.coordinates)} algebraic coordinates need as many balances, {len(self.balances)} are given"
            )

    def _rows(self, further: Sequence[str]) -> Symbol:
        """Return the rows of the further readings: all levels, then all stored quantities, then their shares."""
        offered = {**{name: (value, 0.0, 1.0) for name, value in self.watched.items()}, **self.measured}
        for name in further:
            if name not in offered:
                known = ", ".join(sorted(offered))
                raise RigError(f'this rig has no reading "{name}"{nearest(name, offered)} (it offers {known})')
            if list(further).count(name) > 1:
                raise RigError(f'two readings of the rig are called "{name}": give each a name of its own')
        return _column(
            *(ca.SX(part) for parts in zip(*(offered[name] for name in further), strict=True) for part in parts)
        )

    def _check_symbols(self, arguments: list[Symbol], output: Symbol) -> None:
        """Raise an error if equations depend on symbols of another builder, or on forbidden ones."""
        rates = {f"the rate of state {n}": rate for n, (rate, _) in self.rates.items()}
        balances = {f"balance {k}": value for k, value in enumerate(self.balances, start=1)}
        watched = {f"the watched signal {n}": value for n, value in self.watched.items()}
        fixed = {
            **{f"the mass of state {n}": mass for n, (_, mass) in self.rates.items()},
            **{f"the guess of {n}": value for n, value in self.guesses.items()},
        }
        moving = {**rates, **balances, **watched, "the reading": output}
        x, z, d, u, _, p, c = arguments
        held = {f"the value of {n} at rest": value for n, (_, value) in self.held.items()}
        starts = {f"the start of state {n}": s for n, (_, _, s) in self.states.items() if s is not None}
        if fault := unknown_symbols(arguments, moving):
            raise RigError(f"{fault}take states, coordinates, parameters and constants from the builder")
        if fault := unknown_symbols([p, c], fixed):
            raise RigError(f"{fault}parameters and constants are all it may depend on")
        for equations, allowed in ((held, [x, z, self.time, p, c]), (starts, [x, z, d, u, self.time, p, c])):
            if fault := unknown_symbols(allowed, equations):
                raise RigError(f"{fault}states, coordinates, parameters and constants are all it may depend on")
        if what := not_a_number({**moving, **fixed, **held, **starts}):
            raise RigError(
                f"{what} contains a constant that is not a number (NaN), as NumPy or casadi.DM makes of an expression "
                "that it cannot evaluate"
            )
        coordinates = _column(*(symbol for symbol, _ in self.coordinates.values()))
        balanced = ca.which_depends(_column(*self.balances), coordinates, 1, False)
        if missing := [n for n, found in zip(self.coordinates, balanced, strict=True) if not found]:
            raise RigError(f"no balance depends on coordinate {', '.join(missing)}: nothing decides its value")

    def _on_the_clock(self, value: Symbol) -> Symbol:
        """Replace the time by the clock time, which runs at different speeds in the parts of a divided sample."""
        return value if self.parts is None else ca.substitute(value, self.time, self.parts.clock(self.time))

    def _rest_residual(self, f: Symbol, g: Symbol, held: Symbol) -> Symbol:
        rows = [
            self._at_rest(symbol, f[row]) if start is None else symbol - start
            for row, (symbol, _, start) in enumerate(self.states.values())
        ]
        residual = _column(*rows, g)
        return ca.substitute(ca.substitute(residual, held, self._held_at_start()), self.time, 0.0)

    def _at_rest(self, state: Symbol, rate: Symbol) -> Symbol:
        """Return the equation of rest of a state: its rate, with no memory displaced."""
        if not any(is_same(symbol, state) for symbol, _ in self.displaced):
            return rate
        symbols, others = zip(*self.displaced, strict=True)
        return ca.substitute([rate], list(symbols), list(others))[0]

    def _held_at_start(self) -> Symbol:
        return ca.substitute(_column(*(v for _, v in self.held.values())), self.time, 0.0)


def is_same(symbol: Symbol, other: Any) -> bool:
    """Return whether two symbols are identical."""
    return isinstance(other, ca.SX) and other.shape == (1, 1) and bool(ca.is_equal(symbol, other))


def _column(*parts: Symbol) -> Symbol:
    """Stack the parts in one column; without parts, it has no rows."""
    return ca.vertcat(ca.SX(0, 1), *parts)
