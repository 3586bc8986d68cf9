"""Convert NARX models and plants to nonlinear systems of python-control, also with the delay of a control loop."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import instance, numbers, taking
from deatwin.control.errors import ControlError
from deatwin.control.interop.narx_system import NarxSystem
from deatwin.control.interop.plant_system import PlantSystem
from deatwin.ident.narx import NarxModel
from deatwin.plant.arrays import Array
from deatwin.plant.model import Plant

if TYPE_CHECKING:
    from control import NonlinearIOSystem


@singledispatch
def to_nlsys(source: object, /, name: str | None = None) -> NonlinearIOSystem:
    """Convert a model or a plant to a discrete nonlinear system of python-control, with its sampling time as ``dt``.

    - `NarxModel`: the states are the past outputs and inputs that the model's terms contain, in their units. An input
      of lag 0 feeds through to the output. Noise terms are left out.
    - `Plant`: the states are the plant's states, as deviations from the rest at which experiments start, divided by
      typical sizes (``plant.equations.scale``). If the plant has a delay, past commands follow. The time ``t`` is that
      of the experiment's clock, s. If the rig takes the reading at the end of the hold, the command feeds through to
      the reading of the same sample: apply `in_loop` before you connect a controller.

    Parameters
    ----------
    source : NarxModel or Plant
        Model or plant. Inputs of a plant other than the command, such as a temperature, keep the values that the rig
        assumes when they are not measured.
    name : str, optional
        Name of the system; chosen by python-control by default.

    Returns
    -------
    control.NonlinearIOSystem
        System with the source's signal names and units; the reading of a plant is in SI units. During a simulation, a
        model that diverges or a plant that pulls in raises `SimulationError`.

    Raises
    ------
    ControlError
        If the source is neither a model nor a plant.
    ModelError
        If the model has only noise terms.
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
def rest_state_of(source: object, /, operating_input: ArrayLike) -> Array:
    """Return the state at which a system from `to_nlsys` rests under a constant input.

    In the system of a plant, the zero state is the state of rest in which experiments start. From there the command
    changes to the operating input, at which the plant comes to rest again. The sensor's zero does not change.

    Parameters
    ----------
    source : NarxModel or Plant
        Model with one output, or a plant.
    operating_input : array_like, shape () or (n_inputs,)
        Constant inputs, in their units.

    Returns
    -------
    ndarray, shape (n_states,)
        State for starting a simulation or for linearising.

    Raises
    ------
    ControlError
        If the source is neither a model nor a plant, or a plant's command is not one finite number.
    ModelError
        If a model has several outputs or no equilibrium at these inputs, or if the inputs are not one finite number for
        each input of the model.
    SimulationError
        If a plant cannot come to rest at the command, for example beyond pull-in.
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
    """Delay the outputs of a system by one sample, as in a control loop that reads at the end of each hold.

    In such a loop, only the command of the next sample can react to a reading. For linear models, use
    `LinearModel.in_loop`.

    Parameters
    ----------
    system : control.NonlinearIOSystem
        Discrete system, for example from `to_nlsys`.
    name : str, optional
        Name of the new system; chosen by python-control by default.

    Returns
    -------
    control.NonlinearIOSystem
        System with the states of `system`, followed by one state for each delayed output. The name of such a state is
        ``last_`` plus the name of the output. If `system` rests at ``x0`` under the input ``u0``, the delayed system
        rests at ``numpy.append(x0, system.output(0.0, x0, u0))``.

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
