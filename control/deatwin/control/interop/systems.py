"""NARX models and plants as nonlinear systems of python-control, and as a controller in the loop sees them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import instance, numbers, taking
from deatwin.control.errors import ControlError
from deatwin.control.interop.narx_system import NarxSystem
from deatwin.control.interop.plant_system import PlantSystem
from deatwin.ident.narx import NarxModel
from deatwin.plant.model import Plant

if TYPE_CHECKING:
    from control import NonlinearIOSystem


Array = NDArray[np.float64]


@singledispatch
def to_nlsys(source: object, name: str | None = None) -> NonlinearIOSystem:
    """A model or a plant as a discrete nonlinear system of python-control, ``dt`` its sample time.

    Of a `NarxModel` the states are the past outputs and inputs that its terms hold, in their units; an input of lag 0
    feeds through, and noise terms are at zero noise. Of a `Plant` a sample is one implicit step, ``t`` is the
    experiment's clock, and the states are departures from the rest at which experiments start, in typical sizes
    (``plant.equations.scale``), with the past commands where the plant remembers any. The rows are those of a
    recording: where the rig reads at the end of a row's hold, the row's command feeds through to its reading, and a
    controller answers to `in_loop` of the system.

    Parameters
    ----------
    source : NarxModel or Plant
        Channels besides a plant's command keep the value that they have where nobody measures them.
    name : str, optional
        Of the system; python-control's choice by default.

    Returns
    -------
    control.NonlinearIOSystem
        Inputs, outputs and states carry the source's names; inputs and outputs are in its units (a plant's reading is
        in SI), of which python-control keeps no record. While it runs, a model that diverges and a plant that pulls
        in raise `SimulationError`.

    Raises
    ------
    ControlError
        If the source is neither.
    ModelError
        If a model has terms of noise only.
    SimulationError
        If a plant has no state of rest.
    """
    raise _unknown(source)


@to_nlsys.register(NarxModel)
@taking(name=instance(str))
def _(source: NarxModel, name: str | None = None) -> NonlinearIOSystem:
    return NarxSystem(model=source.deterministic).to_control(name)


@to_nlsys.register(Plant)
@taking(name=instance(str))
def _(source: Plant, name: str | None = None) -> NonlinearIOSystem:
    return PlantSystem(source).to_control(name)


@singledispatch
def rest_state_of(source: object, operating_input: ArrayLike) -> Array:
    """The state of rest of the system that `to_nlsys` makes, under a constant input.

    A plant is brought from its start to the command and rests there; what is held since the start is held. The rest at
    which experiments start is zero.

    Parameters
    ----------
    source : NarxModel or Plant
        A model has one output.
    operating_input : array_like, shape () or (n_inputs,)
        In the inputs' units.

    Returns
    -------
    ndarray, shape (n_states,)
        To start a simulation from, or to linearise about.

    Raises
    ------
    ControlError
        If the source is neither, or a plant's command is not one finite number.
    ModelError
        If a model has several outputs or no equilibrium there, or the inputs are not as many finite numbers as it has.
    SimulationError
        If a plant has no rest in reach there, as beyond pull-in.
    """
    raise _unknown(source)


@rest_state_of.register(NarxModel)
def _(source: NarxModel, operating_input: ArrayLike) -> Array:
    return NarxSystem(model=source.deterministic).rest(operating_input)


@rest_state_of.register(Plant)
def _(source: Plant, operating_input: ArrayLike) -> Array:
    numbers(operating_input, "operating_input")
    command = np.asarray(operating_input, dtype=np.float64).ravel()
    if command.size != 1 or not np.isfinite(command).all():
        raise ControlError("a plant rests under one finite command")
    return PlantSystem(source).rest(float(command[0]))


@taking(name=instance(str))
def in_loop(system: NonlinearIOSystem, name: str | None = None) -> NonlinearIOSystem:
    """A system with its outputs one sample later: the readings to which the commands of a loop can answer.

    Where a row is read at the end of its hold, the next row's command is the first that can answer to it. See
    `LinearModel.in_loop`, which does the same to a linear model.

    Parameters
    ----------
    system : control.NonlinearIOSystem
        Discrete, as of `to_nlsys`.
    name : str, optional
        Of the new system; python-control's choice by default.

    Returns
    -------
    control.NonlinearIOSystem
        Its states are those of `system` and then the last outputs, ``last_...``: from a rest ``x0`` at the input
        ``u0`` it starts at ``numpy.append(x0, system.output(0.0, x0, u0))``.

    Raises
    ------
    ControlError
        If the system is not discrete.
    """
    import control

    if not isinstance(system, control.NonlinearIOSystem) or not system.isdtime(strict=True):
        raise ControlError("only a discrete system of python-control can be read one sample later")
    count = system.nstates

    def update(t: float, x: Array, u: Array, params: Mapping[str, Any]) -> Array:
        seen = system.output(t, x[:count], u, params)
        return np.concatenate([system.dynamics(t, x[:count], u, params), seen])

    def output(t: float, x: Array, u: Array, params: Mapping[str, Any]) -> Array:
        return x[count:]

    return control.nlsys(
        update,
        output,
        name=name,
        dt=system.dt,
        inputs=system.input_labels,
        outputs=system.output_labels,
        states=[*system.state_labels, *(f"last_{label}" for label in system.output_labels)],
    )


def _unknown(source: object) -> ControlError:
    return ControlError(
        f"a {type(source).__name__} is neither a NarxModel nor a Plant; a LinearModel has `system` and `state_space`"
    )
