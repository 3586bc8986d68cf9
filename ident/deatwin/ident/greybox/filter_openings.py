"""Places where an unknown input may act on a plant: signals that its rig offers, parameters, states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.equations import Equations
from deatwin.plant.film import AnyFilm
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Parameter, ParameterSet
from deatwin.plant.rigs.base import written

STATE = "state"  # Place of a state's own equation, if the rig declares no better one
COMMAND = (Place.DRIVE.value, "command")
READING = (Place.SENSOR.value, "reading")
STIFFNESS, PERMITTIVITY = "stiffness", "permittivity"
"""Properties of a film that may drift: a factor on the energy of its network, and one on its permittivity."""
LAST = (Place.SENSOR.value, Place.PARAMETER.value, STATE)
"""Places, in this order, that follow those that the rig declares between drive and sensor."""


@dataclass(frozen=True, kw_only=True)
class Opening:
    """A place where an unknown input, a slowly wandering quantity d, may act on a plant."""

    place: str
    signal: str  # Name of the signal, the parameter or the state

    @property
    def name(self) -> str:
        """``place.signal``."""
        return f"{self.place}.{self.signal}"


def places(plant: Plant) -> tuple[Opening, ...]:
    """Return all places of a plant where an unknown input may act."""
    declared, equations = dict.fromkeys([COMMAND, *_heard(plant), READING]), plant.equations
    of_a_sample = {*equations.integrals, *equations.shifts, *equations.shifts.values()}
    states = [name for name in equations.states if name not in of_a_sample]
    found = [
        *(Opening(place=place, signal=signal) for place, signal in declared),
        *(Opening(place=Place.PARAMETER.value, signal=name) for name in plant.parameters.free),
        *(Opening(place=STATE, signal=name) for name in states),
    ]
    return tuple(sorted(found, key=lambda o: LAST.index(o.place) + 1 if o.place in LAST else 0))


def opened_equations(plant: Plant, openings: Sequence[Opening], ghosts: Sequence[str]) -> Equations:
    """Return a plant's equations with an additional zero parameter for the unknown input at each signal."""
    built_in = [o for o in openings if o.place not in (Place.PARAMETER.value, STATE)]
    added = [
        Parameter(name=name, value=0.0, unit="1", lower=-1e300, upper=1e300)
        for name in (*(o.name for o in built_in), *ghosts)
    ]
    parameters = ParameterSet([*plant.parameters.values(), *added])
    build = _Opened(parameters, plant, built_in)
    with written(plant.rig, build) as reading:
        return build.finish(reading)


class _Listener(Builder):
    """A builder that records which signals a rig offers."""

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant.parameters, plant.effects, plant.stages)
        self.heard: list[tuple[str, str]] = []

    def place(self, place: Enum, name: str, signal: Any) -> Any:
        signal = super().place(place, name, signal)
        if isinstance(signal, AnyFilm):
            factors = (STIFFNESS, PERMITTIVITY) if signal.capacitances else (STIFFNESS,)
            self.heard += [(str(place.value), factor) for factor in factors]
        elif place is not Place.PARAMETER and _is_number(signal):
            self.heard.append((str(place.value), name))
        return signal


def _is_number(signal: Any) -> bool:
    return isinstance(signal, int | float) or (isinstance(signal, ca.SX | ca.DM) and signal.is_scalar())


def _heard(plant: Plant) -> list[tuple[str, str]]:
    build = _Listener(plant)
    with written(plant.rig, build):
        return build.heard


class _Opened(Builder):
    """A builder that adds the unknown input to each signal, after the effects there."""

    def __init__(self, parameters: ParameterSet, plant: Plant, openings: Sequence[Opening]) -> None:
        super().__init__(parameters, plant.effects, plant.stages)
        self._left = {(o.place, o.signal): o.name for o in openings}

    def place(self, place: Enum, name: str, signal: Any) -> Any:
        signal = super().place(place, name, signal)
        if isinstance(signal, AnyFilm):
            stiffness, permittivity = (self._entering(str(place.value), name) for name in (STIFFNESS, PERMITTIVITY))
            signal = signal.with_elastic(1 + stiffness)
            return signal.with_permittivity(lambda _: 1 + permittivity) if signal.capacitances else signal
        open_here = place is not Place.PARAMETER and _is_number(signal)
        return signal + self._entering(str(place.value), name) if open_here else signal

    def _entering(self, place: str, signal: str) -> Any:
        name = self._left.pop((place, signal), None)
        return 0.0 if name is None else self.own(name)

    def finish(self, output: Any, further: Sequence[str] = ()) -> Equations:
        """Close the system; add unknown inputs to command and first reading if the rig does not offer them."""
        reading, command = (self._entering(*place) for place in (READING, COMMAND))
        equations = super().finish(output + reading)
        if isinstance(command, float):
            return equations
        return _with_command(equations, command)


def _with_command(equations: Equations, entering: Any) -> Equations:
    """Return equations in which the unknown input is added to the present command."""
    inputs = equations.held_inputs(0.0).size
    u, present = ca.SX.sym("u", inputs), ca.DM(np.eye(inputs)[0])
    x, z = ca.SX.sym("x", len(equations.states)), ca.SX.sym("z", len(equations.coordinates))
    d, t = ca.SX.sym("d", len(equations.held)), ca.SX.sym("t")
    p, c = ca.SX.sym("p", len(equations.parameters.free)), ca.SX.sym("c", equations.constants.size)
    column = equations.parameters.free.index(entering.name())
    known = [x, z, d, u, t, p, c]
    there = [x, z, d, u + p[column] * present, t, p, c]
    return replace(
        equations,
        dynamics=ca.Function("dynamics", known, [equations.dynamics(*there)]),
        output=ca.Function("output", known, [equations.output(*there)]),
    )
