"""Collect the equations that rigs and effects write."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Effect, Place
from deatwin.plant.equations import SAMPLE_START, STAGES, STEP_MIDDLE, Equations
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.integrator.parts import Parts
from deatwin.plant.parameters import ParameterSet
from deatwin.plant.rigfaults import known, number, size
from deatwin.plant.safe_read import clipped
from deatwin.plant.written import State, Symbol, Written, is_same


class Builder:
    """Collects the equations of a rig and of its effects. All symbols are `casadi.SX`.

    Parameters
    ----------
    parameters : ParameterSet
        Parameters of the rig and its effects.
    effects : sequence of Effect
        Effects of the plant. Effects on the same signal act in the order of their attribute `order`, then of their
        names.
    stages : int
        Number of stages of the Radau IIA step over a sample.
    """

    def __init__(self, parameters: ParameterSet, effects: Sequence[Effect], stages: int = STAGES) -> None:
        self._effects = tuple(sorted(effects, key=lambda e: (e.order, e.name)))
        self._shared: dict[str, Any] = {}
        self._offered: set[tuple[Enum, str]] = set()
        self._last: list[Callable[[Symbol, Builder], Symbol]] = []
        self.command = ca.SX.sym("command")
        self.time = ca.SX.sym("time")
        symbols = {name: ca.SX.sym(name) for name in parameters}
        self.stages = stages
        self.written = Written(
            parameters=parameters, symbols=symbols, command=self.command, time=self.time, stages=stages
        )

    def own(self, name: str) -> Symbol:
        """Return the symbol of the parameter `name` before any effect rewrites it."""
        self.written.parameters[name]
        return self.written.symbols[name]

    def reach(self, name: str) -> float:
        """Return the upper end of the range of parameter `name`, SI; a larger value rebuilds the equations."""
        return self.written.parameters[name].upper

    def parameter(self, name: str) -> Symbol:
        """Return the parameter `name` after the effects at the place *parameter* have rewritten it."""
        return self.place(Place.PARAMETER, name, self.own(name))

    def constant(self, name: str, value: np.ndarray | float) -> Symbol:
        """Add a constant that is never fitted: a symbol `name` of shape (n, 1) with an SI `value` (n,) or float."""
        numbers = known(value, f"the constant {name}")
        symbol = ca.SX.sym(name, numbers.size)
        self.written.constants.append((symbol, numbers))
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
            Command of this sample, then the earlier ones, the latest first. Before the first sample the command is the
            one at rest.
        """
        while len(self.written.past) < count:
            self.written.past.append(ca.SX.sym(f"command_{len(self.written.past) + 1}_ago"))
        return [self.command, *self.written.past[:count]]

    @property
    def sample_start(self) -> Symbol:
        """Clock time at the start of the present sample, s; `time` is the clock time within the sample."""
        return self.channel(SAMPLE_START, 0.0)

    @cached_property
    def sample_time(self) -> Symbol:
        """Sample time as a symbolic constant, s; ``signal("sample_time")`` returns the number."""
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
            Symbols that indicate to which part the present step belongs.

        Raises
        ------
        RigError
            If the sample is already divided.
        """
        if self.written.parts is not None:
            raise RigError("two effects divide a sample at different times: leave one of them out")
        # Only a step sets the middle. Everything else evaluates a sample's end, which lies in the second part.
        self.written.parts = Parts(
            first=number(first, "the first part of a sample"),
            start=self.sample_start,
            middle=self.channel(STEP_MIDDLE, np.inf),
            width=self.sample_time,
        )
        return self.written.parts

    def channel(self, name: str, default: float) -> Symbol:
        """Add a measured input `name`, such as the temperature; its SI value is `default` if it is not recorded."""
        if name not in self.written.channels:
            self.written.channels[name] = (
                ca.SX.sym(name),
                float(known(default, f"the value without the channel {name}")[0]),
            )
        return self.written.channels[name][0]

    def state(self, name: str, *, scale: float, start: Symbol | None = None) -> Symbol:
        """Add a differential state.

        Parameters
        ----------
        name : str
            Unique name.
        scale : float
            Typical size, SI.
        start : casadi.SX, optional
            Value at rest; by default, the value at which the state's rate is zero.
        """
        symbol = self._unknown(name)
        first = None if start is None else number(start, f"the start of state {name}")
        self.written.states[name] = State(symbol, size(scale, f"the scale of state {name}"), first)
        return symbol

    def displace(self, owner: str, state: Symbol, displaced: Callable[[Symbol], Symbol]) -> None:
        """Let a slow state start away from rest, if the history before the experiment is unknown.

        Parameters
        ----------
        owner : str
            Name of the Maxwell branch or effect that the state belongs to. The call does nothing unless the plant has
            the parameter ``owner_at_start`` or ``owner.at_start``: the distance of the state from rest at the start.
        state : casadi.SX
            Symbol that `state` returned.
        displaced : callable
            Function that takes the symbol of this parameter and returns the state's value at rest, as an expression of
            the symbol and `state`.
        """
        name = next((n for n in (f"{owner}_at_start", f"{owner}.at_start") if n in self.written.parameters), None)
        if name is not None:
            self.written.displaced.append((state, displaced(self.own(name))))

    def rate(self, state: Symbol, value: Symbol, *, mass: Symbol = 1.0) -> None:
        """Set ``mass * d(state)/dt = value``.

        Parameters
        ----------
        state : casadi.SX
            Symbol that `state` returned.
        value : casadi.SX or float
            Right side of the equation.
        mass : casadi.SX or float
            Factor of the rate; it may depend on parameters only.
        """
        name = next((n for n, (symbol, _, _) in self.written.states.items() if is_same(symbol, state)), None)
        if name is None:
            raise RigError(f"a rate is given for {clipped(state)}, which build.state did not return")
        if name in self.written.rates:
            raise RigError(f"state {name} has two rates; give their sum in one build.rate")
        self.written.rates[name] = (
            number(value, f"the rate of state {name}"),
            number(mass, f"the mass of state {name}"),
        )

    def begin(self, state: Symbol, after: Symbol | None = None, *, at_rest: float = 1.0) -> None:
        """Let a state start each sample at zero, or at the value that another state has reached.

        Parameters
        ----------
        state : casadi.SX
            Symbol that `state` returned.
        after : casadi.SX, optional
            State of the same scale. `state` takes the value that `after` has at the end of the previous sample, and
            keeps this value for a sample. The rate of `state` must be zero, and so must the rates of all states written
            later. By default, `state` starts each sample at zero.
        at_rest : float
            Only for a state that starts each sample at zero: the value that it reaches at the end of a sample at rest,
            divided by the sample time and by its rate at that time.
        """
        names = {n: s.symbol for n, s in self.written.states.items()}
        name, source = (next((n for n, one in names.items() if is_same(one, each)), "") for each in (state, after))
        self.sample_start  # noqa: B018  (tells a step where its sample begins)
        if after is None:
            self.written.integrals[name] = at_rest * self.signal("sample_time")
        else:
            self.written.shifts[name] = source

    def at_last(self, rewrite: Callable[[Symbol, Builder], Symbol]) -> None:
        """Let `rewrite(reading, build)` change the reading, SI, after all other effects and any mean over a sample."""
        self._last.append(rewrite)

    def coordinate(self, name: str, *, scale: float) -> Symbol:
        """Add an algebraic unknown with a unique `name` and a typical size `scale`, SI; it needs one `balance`."""
        symbol = self._unknown(name)
        self.written.coordinates[name] = (symbol, size(scale, f"the scale of coordinate {name}"))
        return symbol

    def balance(self, value: Symbol) -> None:
        """Add the algebraic equation ``0 = value``."""
        self.written.balances.append(number(value, f"balance {1 + len(self.written.balances)}"))

    def guess(self, unknown: Symbol, value: Symbol) -> None:
        """Start the search for the state of rest with `unknown`, a state or coordinate, at the expression `value`."""
        known = {n: s for n, (s, *_) in (*self.written.states.items(), *self.written.coordinates.items())}
        name = next((n for n, symbol in known.items() if is_same(symbol, unknown)), None)
        if name is None:
            raise RigError(f"a guess is given for {clipped(unknown)}, which is neither a state nor a coordinate")
        self.written.guesses[name] = number(value, f"the guess of {name}")

    def at_rest(self, name: str, value: Symbol) -> Symbol:
        """Return a symbol `name` that is constant: its value is that of the expression `value` at rest."""
        symbol = ca.SX.sym(name)
        self.written.held[name] = (symbol, number(value, f"the value of {name} at rest"))
        return symbol

    def place(self, place: Enum, name: str, signal: Any) -> Any:
        """Let the effects rewrite the signal on which they act.

        Parameters
        ----------
        place : Place, or a member of another Enum
            Place of the signal in the plant.
        name : str
            Name of the signal.
        signal : casadi.SX or object
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
        """Report `value` in the results as the signal `name`, and return `value`.

        The name must include the unit if the unit is not SI.
        """
        number(value, f"the watched signal {name}")
        self.written.watched[name] = value
        return value

    def share(self, name: str, value: Any) -> Any:
        """Make a quantity `value`, such as the film, available to effects by its `name`, and return it."""
        self._shared[name] = value
        return value

    def measure(self, name: str, level: Symbol, *, stored: Symbol = 0.0, share: Symbol = 1.0) -> None:
        """Define what a further reading of the rig measures: ``level`` plus ``share`` times the rate of ``stored``.

        Parameters
        ----------
        name : str
            Name of the reading. A signal that `watch` reports is available under its own name without this call.
        level : casadi.SX or float
            Part of the reading that is not a rate, SI.
        stored : casadi.SX or float
            Quantity, such as a charge, whose mean rate over a sample is part of the reading, SI.
        share : casadi.SX or float
            Factor of this rate.
        """
        parts = (level, stored, share)
        self.written.measured[name] = tuple(number(part, f"the reading {name}") for part in parts)

    def signal(self, name: str, otherwise: Any = None) -> Any:
        """Return a signal that `watch` or `share` has made available, for effects that need several signals.

        Parameters
        ----------
        name : str
            Name given to `watch` or `share`.
        otherwise : casadi.SX or object, optional
            Value to return if the rig does not have the signal.

        Returns
        -------
        casadi.SX or object

        Raises
        ------
        RigError
            If the rig does not have the signal (yet) and `otherwise` is not given.
        """
        known = {**self.written.watched, **self._shared}
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
        output : casadi.SX
            Reading of the rig, SI.
        further : sequence of str
            Names of the rig's further readings.

        Raises
        ------
        RigError
            If an effect acts on a signal that the rig does not have, a further reading is not one of the rig's signals,
            or equations are missing.
        """
        for effect in self._effects:
            if (effect.place, effect.signal) not in self._offered:
                names = [n for place, n in self._offered if place is effect.place]
                raise RigError(
                    f"effect {effect.name} acts on {effect.place.value} signal {effect.signal!r}, which this "
                    f"rig does not have{nearest(effect.signal, names)}"
                )
        if self._shared.get("averages"):
            size_of_reading = self.signal("reading_size")
            output = self._mean("reading", number(output, "what write returns, the reading,"), size_of_reading)
            for name in set(further):
                self._average(name)
        for rewrite in self._last:
            output = rewrite(number(output, "what write returns, the reading,"), self)
        return self.written.equations(output, further)

    def _average(self, name: str) -> None:
        """Replace a further reading by the mean of its level over the sample."""
        offered = {**{n: (value, 0.0, 1.0) for n, value in self.written.watched.items()}, **self.written.measured}
        if name in offered:  # otherwise `equations` raises the error
            level, stored, share = offered[name]
            self.written.measured[name] = (self._mean(name, ca.SX(level), 1.0), stored, share)

    def _mean(self, name: str, value: Symbol, size: float) -> Symbol:
        """Return the mean of a signal over the sample, from an integral that restarts at each sample."""
        if value.is_constant():
            return value
        width, known = self.sample_time, f"{name}_integral"
        integral = self.state(known, scale=size * self.signal("sample_time"), start=value * width)
        self.rate(integral, value)
        self.begin(integral, at_rest=1.0)
        return integral / width

    def _unknown(self, name: str) -> Symbol:
        if name in self.written.states or name in self.written.coordinates:
            raise RigError(f"two unknowns are called {name}: give each state and coordinate a name of its own")
        return ca.SX.sym(name)
