"""What rigs and effects write their equations into."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Effect, Place
from deatwin.plant.equations import SAMPLE_START, STEP_MIDDLE, Equations
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.intake import clipped
from deatwin.plant.integrator.parts import Parts
from deatwin.plant.parameters import ParameterSet
from deatwin.plant.rigfaults import number, size, unknown_symbols

if TYPE_CHECKING:
    from deatwin.plant.rigs.base import Rig


Symbol = Any  # casadi.SX


class Builder:
    """What a rig and its effects write their equations into.

    Parameters
    ----------
    parameters : ParameterSet
        Of rig and effects.
    effects : sequence of Effect
        At one signal they act in the order of their `order`, then of their names.
    """

    def __init__(self, parameters: ParameterSet, effects: Sequence[Effect]) -> None:
        self._parameters = parameters
        self._effects = tuple(sorted(effects, key=lambda e: (e.order, e.name)))
        self._symbols = {name: ca.SX.sym(name) for name in parameters}
        self._states: dict[str, tuple[Symbol, float, Symbol | None]] = {}
        self._rates: dict[str, tuple[Symbol, Symbol]] = {}
        self._coordinates: dict[str, tuple[Symbol, float]] = {}
        self._balances: list[Symbol] = []
        self._guesses: dict[str, Symbol] = {}
        self._held: dict[str, tuple[Symbol, Symbol]] = {}
        self._constants: list[tuple[Symbol, np.ndarray]] = []
        self._watched: dict[str, Symbol] = {}
        self._shared: dict[str, Any] = {}
        self._offered: set[tuple[Enum, str]] = set()
        self._past: list[Symbol] = []
        self._channels: dict[str, tuple[Symbol, float]] = {}
        self._parts: Parts | None = None
        self.command = ca.SX.sym("command")
        self.time = ca.SX.sym("time")

    def own(self, name: str) -> Symbol:
        """The bare symbol of a parameter.

        Parameters
        ----------
        name : str
            Name in the plant's parameter set.

        Returns
        -------
        casadi.SX
        """
        self._parameters[name]
        return self._symbols[name]

    def parameter(self, name: str) -> Symbol:
        """A parameter as the effects at the place *parameter* leave it.

        Parameters
        ----------
        name : str
            Name in the plant's parameter set.

        Returns
        -------
        casadi.SX
        """
        return self.place(Place.PARAMETER, name, self.own(name))

    def constant(self, name: str, value: np.ndarray | float) -> Symbol:
        """A number of the rig that no fit moves.

        Parameters
        ----------
        name : str
            Name of the symbol.
        value : ndarray, shape (n,), or float
            Its SI value.

        Returns
        -------
        casadi.SX, shape (n, 1)
        """
        numbers = np.atleast_1d(np.asarray(value, dtype=float))
        if np.isnan(numbers).any():
            raise RigError(f"the constant {name} is not a number (NaN)")
        symbol = ca.SX.sym(name, numbers.size)
        self._constants.append((symbol, numbers))
        return symbol

    def past_commands(self, count: int) -> list[Symbol]:
        """The command of this sample and of some before it.

        Parameters
        ----------
        count : int
            How many samples to look back.

        Returns
        -------
        list of casadi.SX, length 1 + count
            This sample's first; before the first sample the command was the one at rest.
        """
        while len(self._past) < count:
            self._past.append(ca.SX.sym(f"command_{len(self._past) + 1}_ago"))
        return [self.command, *self._past[:count]]

    @property
    def sample_start(self) -> Symbol:
        """Clock time at which the present sample begins, s; `time` runs on within it."""
        return self.channel(SAMPLE_START, 0.0)

    @cached_property
    def sample_time(self) -> Symbol:
        """Width of a sample, s, among the constants; `signal` has its number."""
        return self.constant("sample_time", self.signal("sample_time"))

    def divide(self, first: Symbol) -> Parts:
        """Divide each sample in two parts, each of which is solved in a step of its own: what jumps does so between.

        Parameters
        ----------
        first : casadi.SX
            Share of the sample that the first part takes, 0 to 1, in terms of parameters and constants.

        Returns
        -------
        Parts
            That tell in which one the present step is.

        Raises
        ------
        RigError
            If it is divided already.
        """
        if self._parts is not None:
            raise RigError("two effects divide a sample, each elsewhere: leave one of them out")
        # Nobody but a step tells a middle: all else looks at a sample's end, which is in its second part.
        self._parts = Parts(
            first=first, start=self.sample_start, middle=self.channel(STEP_MIDDLE, np.inf), width=self.sample_time
        )
        return self._parts

    def channel(self, name: str, default: float) -> Symbol:
        """A further measured input, such as the temperature.

        Parameters
        ----------
        name : str
            As the recordings call it.
        default : float
            Its value where nobody measured it, SI.

        Returns
        -------
        casadi.SX
        """
        if name not in self._channels:
            self._channels[name] = (ca.SX.sym(name), default)
        return self._channels[name][0]

    def state(self, name: str, *, scale: float, start: Symbol | None = None) -> Symbol:
        """A differential state.

        Parameters
        ----------
        name : str
            Unique name.
        scale : float
            Typical size, SI.
        start : symbol, optional
            Value at rest; without it the state rests where its rate is zero.

        Returns
        -------
        casadi.SX
        """
        symbol = self._unknown(name)
        first = None if start is None else number(start, f"the start of state {name}")
        self._states[name] = (symbol, size(scale, f"the scale of state {name}"), first)
        return symbol

    def _unknown(self, name: str) -> Symbol:
        if name in self._states or name in self._coordinates:
            raise RigError(f"two unknowns are called {name}: give each state and coordinate a name of its own")
        return ca.SX.sym(name)

    def rate(self, state: Symbol, value: Symbol, *, mass: Symbol = 1.0) -> None:
        """Set ``mass * d(state)/dt = value``.

        Parameters
        ----------
        state : casadi.SX
            What `state` returned.
        value, mass : symbol or float
            Both sides; `mass` depends on parameters only.
        """
        name = next((n for n, (symbol, _, _) in self._states.items() if _same(symbol, state)), None)
        if name is None:
            raise RigError(f"a rate is given for {clipped(state)}, which build.state did not return")
        if name in self._rates:
            raise RigError(f"state {name} has two rates; give the sum of what moves it in one build.rate")
        self._rates[name] = (number(value, f"the rate of state {name}"), number(mass, f"the mass of state {name}"))

    def coordinate(self, name: str, *, scale: float) -> Symbol:
        """An algebraic coordinate; give one `balance` for each.

        Parameters
        ----------
        name : str
            Unique name.
        scale : float
            Typical size, SI.

        Returns
        -------
        casadi.SX
        """
        symbol = self._unknown(name)
        self._coordinates[name] = (symbol, size(scale, f"the scale of coordinate {name}"))
        return symbol

    def balance(self, value: Symbol) -> None:
        """Demand ``0 = value``.

        Parameters
        ----------
        value : symbol
            Left side of an algebraic equation.
        """
        self._balances.append(number(value, f"balance {1 + len(self._balances)}"))

    def guess(self, unknown: Symbol, value: Symbol) -> None:
        """Where to look for the rest state.

        Parameters
        ----------
        unknown : casadi.SX
            A state or coordinate.
        value : symbol or float
            In terms of parameters and constants.
        """
        known = {n: s for n, (s, *_) in (*self._states.items(), *self._coordinates.items())}
        name = next((n for n, symbol in known.items() if _same(symbol, unknown)), None)
        if name is None:
            raise RigError(f"a guess is given for {clipped(unknown)}, which is neither a state nor a coordinate")
        self._guesses[name] = number(value, f"the guess of {name}")

    def at_rest(self, name: str, value: Symbol) -> Symbol:
        """The value that an expression has at rest, held for the whole experiment.

        Parameters
        ----------
        name : str
            Unique name.
        value : symbol
            In terms of states, coordinates and parameters.

        Returns
        -------
        casadi.SX
        """
        symbol = ca.SX.sym(name)
        self._held[name] = (symbol, value)
        return symbol

    def place(self, place: Enum, name: str, signal: Any) -> Any:
        """Offer a signal to the effects that act on it.

        Parameters
        ----------
        place : Place, or a member of another Enum
            Where in the plant the signal lives.
        name : str
            Name of the signal.
        signal : symbol or object
            As the rig has it.

        Returns
        -------
        same kind as `signal`
            As the effects leave it.
        """
        self._offered.add((place, name))
        for effect in self._effects:
            if (effect.place, effect.signal) == (place, name):
                signal = effect.rewrite(signal, self)
        return signal

    def watch(self, name: str, value: Symbol) -> Symbol:
        """Give a signal a name under which results report it.

        Parameters
        ----------
        name : str
            With its unit, if not SI.
        value : symbol
            The signal.

        Returns
        -------
        symbol
            `value`.
        """
        number(value, f"the watched signal {name}")
        self._watched[name] = value
        return value

    def share(self, name: str, value: Any) -> Any:
        """Let effects have something that results do not report.

        Parameters
        ----------
        name : str
            For `signal`.
        value : symbol or object
            For example the film.

        Returns
        -------
        same kind as `value`
            `value`.
        """
        self._shared[name] = value
        return value

    def share_sampling(self, rig: Rig) -> None:
        """Let effects know when a rig is sampled: its ``sample_time`` and whether it ``follows_at_once``.

        Parameters
        ----------
        rig : Rig
            Whose equations are written.
        """
        self.share("sample_time", rig.sample_time)
        self.share("follows_at_once", rig.follows_at_once)

    def signal(self, name: str, otherwise: Any = None) -> Any:
        """A watched or shared signal, for effects that need more than the one they rewrite.

        Parameters
        ----------
        name : str
            As given to `watch` or `share`.
        otherwise : symbol or object, optional
            What to take where the rig does not have it.

        Returns
        -------
        symbol or object

        Raises
        ------
        RigError
            If the rig does not have it (yet), and nothing is to be taken otherwise.
        """
        known = {**self._watched, **self._shared}
        try:
            return known[name]
        except KeyError:
            if otherwise is not None:
                return otherwise
            raise RigError(f"this rig has no signal {name!r}{nearest(name, known)}") from None

    def finish(self, output: Symbol) -> Equations:
        """Close the system.

        Parameters
        ----------
        output : symbol
            The reading.

        Returns
        -------
        Equations

        Raises
        ------
        RigError
            If an effect acts on a signal that the rig does not have, or equations are missing.
        """
        self._check()
        output = number(output, "what write returns, the reading,")
        x = _column(*(s for s, _, _ in self._states.values()))
        z = _column(*(s for s, _ in self._coordinates.values()))
        d = _column(*(s for s, _ in self._held.values()))
        p = _column(*(self._symbols[n] for n in self._parameters.free))
        known = [n for n in self._parameters if n not in self._parameters.free]
        c = _column(*(self._symbols[n] for n in known), *(s for s, _ in self._constants))
        f = _column(*(self._rates[n][0] for n in self._states))
        g = _column(*self._balances)
        mass = _column(*(self._rates[n][1] for n in self._states))
        u = _column(self.command, *self._past, *(s for s, _ in self._channels.values()))
        arguments = [x, z, d, u, self.time, p, c]
        self._check_symbols(arguments, output)
        moving = f if self._parts is None else self._parts.speed * f
        unknowns = {**{n: s[0] for n, s in self._states.items()}, **{n: s[0] for n, s in self._coordinates.items()}}
        guess = _column(*(self._guesses.get(n, 0.0) for n in unknowns))
        return Equations(
            states=tuple(self._states),
            coordinates=tuple(self._coordinates),
            held=tuple(self._held),
            signals=tuple(self._watched),
            scale=np.array([s[1] for s in (*self._states.values(), *self._coordinates.values())]),
            constants=np.concatenate([self._parameters.array(known), *(v for _, v in self._constants)]),
            parameters=self._parameters,
            dynamics=ca.Function("dynamics", arguments, [self._on_the_clock(ca.vertcat(moving, g))]),
            mass=ca.Function("mass", [p, c], [mass]),
            output=ca.Function("output", arguments, [self._on_the_clock(output)]),
            watched=ca.Function("watched", arguments, [self._on_the_clock(_column(*self._watched.values()))]),
            rest=ca.Function("rest", [x, z, u, p, c], [self._rest_residual(f, g, d)]),
            guess=ca.Function("guess", [p, c], [guess]),
            hold=ca.Function("hold", [x, z, p, c], [self._held_at_start()]),
            history=len(self._past),
            channels={name: default for name, (_, default) in self._channels.items()},
        )

    def _check_symbols(self, arguments: list[Symbol], output: Symbol) -> None:
        """Each equation depends on what it may, and on symbols of this builder only."""
        *_, p, c = arguments
        rates = {f"the rate of state {n}": rate for n, (rate, _) in self._rates.items()}
        balances = {f"balance {k}": value for k, value in enumerate(self._balances, start=1)}
        watched = {f"the watched signal {n}": value for n, value in self._watched.items()}
        fixed = {
            **{f"the mass of state {n}": mass for n, (_, mass) in self._rates.items()},
            **{f"the guess of {n}": value for n, value in self._guesses.items()},
        }
        moving = {**rates, **balances, **watched, "the reading": output}
        if fault := unknown_symbols(arguments, moving):
            raise RigError(f"{fault}take states, coordinates, parameters and constants from the builder")
        if fault := unknown_symbols([p, c], fixed):
            raise RigError(f"{fault}parameters and constants are all it may depend on")
        coordinates = _column(*(symbol for symbol, _ in self._coordinates.values()))
        balanced = ca.which_depends(_column(*self._balances), coordinates, 1, False)
        if missing := [n for n, found in zip(self._coordinates, balanced, strict=True) if not found]:
            raise RigError(f"no balance depends on coordinate {', '.join(missing)}: nothing decides its value")

    def _on_the_clock(self, value: Symbol) -> Symbol:
        """The same where the clock does not run as a step is taken."""
        return value if self._parts is None else ca.substitute(value, self.time, self._parts.clock(self.time))

    def _rest_residual(self, f: Symbol, g: Symbol, held: Symbol) -> Symbol:
        rows = [
            f[row] if start is None else symbol - start for row, (symbol, _, start) in enumerate(self._states.values())
        ]
        residual = _column(*rows, g)
        return ca.substitute(ca.substitute(residual, held, self._held_at_start()), self.time, 0.0)

    def _held_at_start(self) -> Symbol:
        return ca.substitute(_column(*(v for _, v in self._held.values())), self.time, 0.0)

    def _check(self) -> None:
        for effect in self._effects:
            if (effect.place, effect.signal) not in self._offered:
                names = [n for place, n in self._offered if place is effect.place]
                raise RigError(
                    f"effect {effect.name} acts on {effect.place.value} signal {effect.signal!r}, which this "
                    f"rig does not have{nearest(effect.signal, names)}"
                )
        if missing := set(self._states) - set(self._rates):
            raise RigError(f"no rate is given for state {', '.join(sorted(missing))}")
        if len(self._balances) != len(self._coordinates):
            raise RigError(
                f"{len(self._coordinates)} algebraic coordinates need as many balances, {len(self._balances)} are given"
            )


def _same(symbol: Symbol, other: Any) -> bool:
    return isinstance(other, ca.SX) and other.shape == (1, 1) and bool(ca.is_equal(symbol, other))


def _column(*parts: Symbol) -> Symbol:
    """The parts below each other; a column without rows where there are none."""
    return ca.vertcat(ca.SX(0, 1), *parts)
