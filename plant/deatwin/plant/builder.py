"""Collector of the equations that rigs and effects write."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Effect, Place
from deatwin.plant.equations import SAMPLE_START, STEP_MIDDLE, Equations
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.integrator.parts import Parts
from deatwin.plant.parameters import ParameterSet
from deatwin.plant.rigfaults import known, not_a_number, number, size, unknown_symbols
from deatwin.plant.safe_read import clipped

if TYPE_CHECKING:
    from deatwin.plant.rigs.base import Rig


Symbol = Any  # casadi.SX


class Builder:
    """Collector of the equations that a rig and its effects write.

    Parameters
    ----------
    parameters : ParameterSet
        Parameters of the rig and its effects.
    effects : sequence of Effect
        Effects of the plant. Those that act on one signal act in the order of their `order`, then of their names.
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
        self._measured: dict[str, tuple[Symbol, Symbol, Symbol]] = {}
        self._offered: set[tuple[Enum, str]] = set()
        self._past: list[Symbol] = []
        self._channels: dict[str, tuple[Symbol, float]] = {}
        self._displaced: list[tuple[Symbol, Symbol]] = []
        self._parts: Parts | None = None
        self._integrals: dict[str, float] = {}
        self._reading_size, self._averages = 1.0, False
        self.command = ca.SX.sym("command")
        self.time = ca.SX.sym("time")

    def own(self, name: str) -> Symbol:
        """Return the symbol of a parameter, which no effect has rewritten.

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

    def reach(self, name: str) -> float:
        """Return the upper end of a parameter's range.

        Parameters
        ----------
        name : str
            Name in the plant's parameter set.

        Returns
        -------
        float
            SI; the equations hold up to it, and are written anew where a value beyond it widens the range.
        """
        return self._parameters[name].upper

    def parameter(self, name: str) -> Symbol:
        """Return a parameter after the effects at the place *parameter* have rewritten it.

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
        """Add a constant of the rig, which no fit moves.

        Parameters
        ----------
        name : str
            Name of the symbol.
        value : ndarray, shape (n,), or float
            SI value.

        Returns
        -------
        casadi.SX, shape (n, 1)
        """
        numbers = known(value, f"the constant {name}")
        symbol = ca.SX.sym(name, numbers.size)
        self._constants.append((symbol, numbers))
        return symbol

    def past_commands(self, count: int) -> list[Symbol]:
        """Return the commands of this sample and of earlier ones.

        Parameters
        ----------
        count : int
            Number of earlier samples.

        Returns
        -------
        list of casadi.SX, length 1 + count
            Command of this sample first, then those before it. Before the first sample the command is the one at rest.
        """
        while len(self._past) < count:
            self._past.append(ca.SX.sym(f"command_{len(self._past) + 1}_ago"))
        return [self.command, *self._past[:count]]

    @property
    def sample_start(self) -> Symbol:
        """Clock time at the start of the present sample, s; `time` continues within the sample."""
        return self.channel(SAMPLE_START, 0.0)

    @cached_property
    def sample_time(self) -> Symbol:
        """Sample time as a symbolic constant, s; `signal` returns it as a number."""
        return self.constant("sample_time", self.signal("sample_time"))

    def divide(self, first: Symbol) -> Parts:
        """Divide each sample into two parts, each solved in its own step, so that a signal can jump between them.

        Parameters
        ----------
        first : casadi.SX
            Share of the sample in the first part, 0 to 1, as an expression of parameters and constants.

        Returns
        -------
        Parts
            Symbols that tell in which part the present step lies.

        Raises
        ------
        RigError
            If the sample is already divided.
        """
        if self._parts is not None:
            raise RigError("two effects divide a sample, each elsewhere: leave one of them out")
        # Nobody but a step tells a middle: all else looks at a sample's end, which is in its second part.
        self._parts = Parts(
            first=number(first, "the first part of a sample"),
            start=self.sample_start,
            middle=self.channel(STEP_MIDDLE, np.inf),
            width=self.sample_time,
        )
        return self._parts

    def channel(self, name: str, default: float) -> Symbol:
        """Add a further measured input, such as the temperature.

        Parameters
        ----------
        name : str
            Name of the channel in the recordings.
        default : float
            SI value used for recordings without this channel.

        Returns
        -------
        casadi.SX
        """
        if name not in self._channels:
            self._channels[name] = (ca.SX.sym(name), float(known(default, f"the value without the channel {name}")[0]))
        return self._channels[name][0]

    def state(self, name: str, *, scale: float, start: Symbol | None = None) -> Symbol:
        """Add a differential state.

        Parameters
        ----------
        name : str
            Unique name.
        scale : float
            Typical size, SI.
        start : symbol, optional
            Value at rest; by default the value at which its rate is zero.

        Returns
        -------
        casadi.SX
        """
        symbol = self._unknown(name)
        first = None if start is None else number(start, f"the start of state {name}")
        self._states[name] = (symbol, size(scale, f"the scale of state {name}"), first)
        return symbol

    def displace(self, owner: str, state: Symbol, displaced: Callable[[Symbol], Symbol]) -> None:
        """Let a memory begin away from rest, where nobody knows how the experiment began.

        Parameters
        ----------
        owner : str
            Branch or effect whose memory it is; nothing happens unless the plant has a parameter for its start.
        state : casadi.SX
            Symbol that `state` returned.
        displaced : callable
            Returns, for that parameter, the value that the state would have at rest, in terms of the value that it has.
        """
        name = next((n for n in (f"{owner}_at_start", f"{owner}.at_start") if n in self._parameters), None)
        if name is not None:
            self._displaced.append((state, displaced(self.own(name))))

    def _unknown(self, name: str) -> Symbol:
        if name in self._states or name in self._coordinates:
            raise RigError(f"two unknowns are called {name}: give each state and coordinate a name of its own")
        return ca.SX.sym(name)

    def rate(self, state: Symbol, value: Symbol, *, mass: Symbol = 1.0) -> None:
        """Set ``mass * d(state)/dt = value``.

        Parameters
        ----------
        state : casadi.SX
            Symbol that `state` returned.
        value, mass : symbol or float
            Right side, and factor of the rate; `mass` depends on parameters only.
        """
        name = next((n for n, (symbol, _, _) in self._states.items() if _same(symbol, state)), None)
        if name is None:
            raise RigError(f"a rate is given for {clipped(state)}, which build.state did not return")
        if name in self._rates:
            raise RigError(f"state {name} has two rates; give the sum of what moves it in one build.rate")
        self._rates[name] = (number(value, f"the rate of state {name}"), number(mass, f"the mass of state {name}"))

    def coordinate(self, name: str, *, scale: float) -> Symbol:
        """Add an algebraic coordinate; each needs one `balance`.

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
        """Add the equation ``0 = value``.

        Parameters
        ----------
        value : symbol
            Residual of the algebraic equation.
        """
        self._balances.append(number(value, f"balance {1 + len(self._balances)}"))

    def guess(self, unknown: Symbol, value: Symbol) -> None:
        """Set the start value of an unknown in the search for rest.

        Parameters
        ----------
        unknown : casadi.SX
            State or coordinate.
        value : symbol or float
            Start value, an expression of parameters and constants.
        """
        known = {n: s for n, (s, *_) in (*self._states.items(), *self._coordinates.items())}
        name = next((n for n, symbol in known.items() if _same(symbol, unknown)), None)
        if name is None:
            raise RigError(f"a guess is given for {clipped(unknown)}, which is neither a state nor a coordinate")
        self._guesses[name] = number(value, f"the guess of {name}")

    def at_rest(self, name: str, value: Symbol) -> Symbol:
        """Return the value that an expression has at rest, held for the whole experiment.

        Parameters
        ----------
        name : str
            Unique name.
        value : symbol
            Expression of states, coordinates and parameters.

        Returns
        -------
        casadi.SX
        """
        symbol = ca.SX.sym(name)
        self._held[name] = (symbol, number(value, f"the value of {name} at rest"))
        return symbol

    def place(self, place: Enum, name: str, signal: Any) -> Any:
        """Let the effects rewrite the signal on which they act.

        Parameters
        ----------
        place : Place, or a member of another Enum
            Place of the signal in the plant.
        name : str
            Name of the signal.
        signal : symbol or object
            Signal without effects.

        Returns
        -------
        same kind as `signal`
            Signal with effects.
        """
        self._offered.add((place, name))
        for effect in self._effects:
            if (effect.place, effect.signal) == (place, name):
                signal = effect.rewrite(signal, self)
        return signal

    def watch(self, name: str, value: Symbol) -> Symbol:
        """Report a signal in the results under a name.

        Parameters
        ----------
        name : str
            Name in the results, with the unit if that is not SI.
        value : symbol
            Signal to report.

        Returns
        -------
        symbol
            `value`, unchanged.
        """
        number(value, f"the watched signal {name}")
        self._watched[name] = value
        return value

    def share(self, name: str, value: Any) -> Any:
        """Make a quantity available to effects without reporting it in the results.

        Parameters
        ----------
        name : str
            Name under which `signal` returns it.
        value : symbol or object
            Quantity to share, for example the film.

        Returns
        -------
        same kind as `value`
            `value`, unchanged.
        """
        self._shared[name] = value
        return value

    def measure(self, name: str, level: Symbol, *, stored: Symbol = 0.0, share: Symbol = 1.0) -> None:
        """Offer a signal to a further reading of the rig.

        Parameters
        ----------
        name : str
            Name of the reading. A watched signal is offered under its own name without this call.
        level : symbol or float
            Part of the reading that is read as it is, SI.
        stored : symbol or float
            Quantity whose mean rate over a sample is added, such as a charge, in SI.
        share : symbol or float
            Factor of that rate.
        """
        parts = (level, stored, share)
        self._measured[name] = tuple(number(part, f"the reading {name}") for part in parts)

    def share_sampling(self, rig: Rig) -> None:
        """Make a rig's ``sample_time``, ``follows_at_once`` and known ``series_resistance`` available to effects.

        Parameters
        ----------
        rig : Rig
            Rig whose equations are written.
        """
        self.share("sample_time", rig.sample_time)
        self.share("follows_at_once", rig.follows_at_once)
        self._reading_size, self._averages = rig.reading_size, rig.averages
        for reading in rig.further:
            if reading.name == "current":
                self.share("series_resistance", reading.series_resistance)

    def signal(self, name: str, otherwise: Any = None) -> Any:
        """Return a watched or shared signal, for effects that need more than the one they rewrite.

        Parameters
        ----------
        name : str
            Name given to `watch` or `share`.
        otherwise : symbol or object, optional
            Value to return if the rig does not have the signal.

        Returns
        -------
        symbol or object

        Raises
        ------
        RigError
            If the rig does not have the signal (yet) and `otherwise` is not given.
        """
        known = {**self._watched, **self._shared}
        try:
            return known[name]
        except KeyError:
            if otherwise is not None:
                return otherwise
            raise RigError(f"this rig has no signal {name!r}{nearest(name, known)}") from None

    def finish(self, output: Symbol, further: Sequence[str] = ()) -> Equations:
        """Check that the equations are complete, and return them.

        Parameters
        ----------
        output : symbol
            Reading of the rig, SI.
        further : sequence of str
            Names of its further readings.

        Returns
        -------
        Equations

        Raises
        ------
        RigError
            If an effect acts on a signal that the rig does not have, a further reading is of no signal of it, or
            equations are missing.
        """
        self._check()
        output = self._as_read("reading", number(output, "what write returns, the reading,"), self._reading_size)
        rows = self._rows(further)
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
            further=ca.Function("further", arguments, [ca.densify(self._on_the_clock(rows))]) if further else None,
            watched=ca.Function("watched", arguments, [self._on_the_clock(_column(*self._watched.values()))]),
            rest=ca.Function("rest", [x, z, u, p, c], [self._rest_residual(f, g, d)]),
            guess=ca.Function("guess", [p, c], [guess]),
            hold=ca.Function("hold", [x, z, p, c], [self._held_at_start()]),
            history=len(self._past),
            integrals=self._integrals,
            channels={name: default for name, (_, default) in self._channels.items()},
        )

    def _rows(self, further: Sequence[str]) -> Symbol:
        """Rows of the further readings: all levels, then all stored quantities, then their shares."""
        offered = {**{name: (value, 0.0, 1.0) for name, value in self._watched.items()}, **self._measured}
        for name in further:
            if name not in offered:
                known = ", ".join(sorted(offered))
                raise RigError(f'this rig has no reading "{name}"{nearest(name, offered)} (it offers {known})')
            if list(further).count(name) > 1:
                raise RigError(f'two readings of the rig are called "{name}": give each a name of its own')
        found = [
            (self._as_read(name, ca.SX(level), 1.0), *rate) for name in further for level, *rate in [offered[name]]
        ]
        return _column(*(ca.SX(part) for parts in zip(*found, strict=True) for part in parts))

    def _as_read(self, name: str, value: Symbol, scale: float) -> Symbol:
        """A reading as its row shows it: the value itself, or its mean over the sample, from an integral that begins
        each sample at zero.
        """
        if not self._averages or value.is_constant():
            return value
        width, known = self.sample_time, f"{name}_integral"
        self.sample_start  # noqa: B018  (tells a step where its sample begins)
        self._integrals[known] = self.signal("sample_time")
        integral = self.state(known, scale=scale * self._integrals[known], start=value * width)
        self.rate(integral, value)
        return integral / width

    def _check_symbols(self, arguments: list[Symbol], output: Symbol) -> None:
        """Refuse equations that depend on symbols of another builder, or on symbols that they may not depend on."""
        rates = {f"the rate of state {n}": rate for n, (rate, _) in self._rates.items()}
        balances = {f"balance {k}": value for k, value in enumerate(self._balances, start=1)}
        watched = {f"the watched signal {n}": value for n, value in self._watched.items()}
        fixed = {
            **{f"the mass of state {n}": mass for n, (_, mass) in self._rates.items()},
            **{f"the guess of {n}": value for n, value in self._guesses.items()},
        }
        moving = {**rates, **balances, **watched, "the reading": output}
        x, z, d, u, _, p, c = arguments
        held = {f"the value of {n} at rest": value for n, (_, value) in self._held.items()}
        starts = {f"the start of state {n}": s for n, (_, _, s) in self._states.items() if s is not None}
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
        coordinates = _column(*(symbol for symbol, _ in self._coordinates.values()))
        balanced = ca.which_depends(_column(*self._balances), coordinates, 1, False)
        if missing := [n for n, found in zip(self._coordinates, balanced, strict=True) if not found]:
            raise RigError(f"no balance depends on coordinate {', '.join(missing)}: nothing decides its value")

    def _on_the_clock(self, value: Symbol) -> Symbol:
        """Replace the time by the clock time, which runs unevenly over the parts of a divided sample."""
        return value if self._parts is None else ca.substitute(value, self.time, self._parts.clock(self.time))

    def _rest_residual(self, f: Symbol, g: Symbol, held: Symbol) -> Symbol:
        rows = [
            self._at_rest(symbol, f[row]) if start is None else symbol - start
            for row, (symbol, _, start) in enumerate(self._states.values())
        ]
        residual = _column(*rows, g)
        return ca.substitute(ca.substitute(residual, held, self._held_at_start()), self.time, 0.0)

    def _at_rest(self, state: Symbol, rate: Symbol) -> Symbol:
        """The equation of rest of a state: its rate, were no memory displaced."""
        if not any(_same(symbol, state) for symbol, _ in self._displaced):
            return rate
        symbols, others = zip(*self._displaced, strict=True)
        return ca.substitute([rate], list(symbols), list(others))[0]

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
    """Stack the parts in one column, without rows if there are none."""
    return ca.vertcat(ca.SX(0, 1), *parts)
