"""Check that the inputs of a check fit together, and collect what is known about the recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from deatwin.control.arguments import instance
from deatwin.control.controllers.base import Controller
from deatwin.control.controllers.law import Law
from deatwin.control.design.pid import PidGains
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel
from deatwin.ident.narx import NarxModel, Reliance
from deatwin.ident.narx.excited import Excitation, excitation
from deatwin.ident.narx.residual import Residual, free_run_residual
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import DeatwinError, ModelError
from deatwin.plant.model import Plant
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Recording
from deatwin.plant.words import listed, spaced

_TAKEN = ("model", "plant")
_FOREIGN = 3.0
"""Largest residual of a recording, in units of the residual that the model states. A recording that leaves more is of
another actuator, or in another unit."""

Design = Callable[..., Controller]  # Takes the model with the loop's delay, and ``command_limits``

SAME = 1e-9  # Difference below which operating inputs are equal, as a share of the range of the command


class UndesignedError(ControlError):
    """Raised if a design finds no controller: a result of the check, not a mistake of the caller."""


def designed(design: Design, linear: LinearModel, command_limits: tuple[float, float]) -> Controller:
    """Design a controller on a model; raise exceptions of other libraries as ControlError."""
    try:
        controller = design(linear, command_limits=command_limits)
    except (ControlError, ModelError) as error:
        raise UndesignedError(f"no controller could be designed: {error}") from error
    except DeatwinError:
        raise
    except Exception as error:
        raise ControlError(f"the design {_name(design)} raised {type(error).__name__}: {error}") from error
    if not isinstance(controller, Controller):
        raise ControlError(
            f"the design {_name(design)} returned {type(controller).__name__}; it must return a Controller"
        )
    low, high = command_limits
    if abs(controller.operating_input - linear.operating_input) > SAME * (high - low):
        raise ControlError(
            f"the design is for the operating input {controller.operating_input:g}, not for {linear.operating_input:g}"
        )
    return controller


def _name(design: Design) -> str:
    """Return the name of a design for messages: the function's name, or that of a callable object's class."""
    while isinstance(design, partial):
        design = design.func
    return str(getattr(design, "__name__", type(design).__name__))


def require_others(value: Any, name: str) -> None:
    """Raise ControlError unless all further plants are plants with different names."""
    instance(Mapping, hint=" from names to plants")(value, name)
    for key, plant in value.items():
        instance(str)(key, f"a name in {name}")
        if not key.strip() or key.split()[0] in _TAKEN:
            raise ControlError(
                f"an alternative plant cannot be called {key!r}; an empty name and {', '.join(_TAKEN)} are reserved"
            )
        instance(Plant, CalibratedPlant)(plant, f"{name}[{key!r}]")


def require_pair(model: NarxModel, plant: Plant) -> None:
    """Raise ModelError unless model and plant agree in sample time and units, and the model is none of deviations."""
    rig = plant.rig
    if abs(model.sample_time / rig.sample_time - 1.0) > 1e-6:
        raise ModelError(
            f"the model is sampled every {model.sample_time:g} s, the rig every {rig.sample_time:g} s; a "
            "NARX model cannot be resampled: identify it at the rig's rate, or correct sample_rate_Hz in the "
            "rig file"
        )
    if "deviations_from" in model.provenance:
        raise ModelError(
            f"the model describes deviations from {model.provenance['deviations_from']}; give the "
            "identified model itself, as it was before remove_dc"
        )
    if model.output_names[0] in {reading.name for reading in rig.further}:
        raise ModelError(
            f"the model predicts the {spaced(model.output_names[0])}, but a check closes the loop on the rig's first "
            f"reading, the {spaced(rig.output_name)}: identify a model of that reading"
        )
    for signal, unit, known in (
        ("input", model.input_units[0], rig.input_unit),
        ("output", model.output_units[0], rig.output_unit),
    ):
        if unit and unit != known:
            raise ModelError(f"the model's {signal} is in {unit}, the rig's in {known}")


def require_effect(controller: Any, design: Any, **of_design: Any) -> None:
    """Raise ControlError for arguments of a design that is not made, or that does not take them from the check."""
    if controller is not None:
        ignored = [name for name, value in {"design": design, **of_design}.items() if value is not None]
        if ignored:
            raise ControlError(
                f"{listed(ignored)} would have no effect, because a controller is given: leave out either, or change "
                "the controller"
            )
    elif design is not None and of_design["closed_loop_time"] is not None:
        raise ControlError(
            f"closed_loop_time would have no effect on the design {_name(design)}: leave it out, or bind it to a design "
            f"that takes one, as design=partial(lqg, closed_loop_time={of_design['closed_loop_time']:g})"
        )


def require_controller(controller: Any, model: NarxModel) -> None:
    """Raise ControlError unless the object to be judged is a controller with the model's sample time."""
    if not isinstance(controller, Controller):
        instead = " (a model, from which a controller can be designed)" if isinstance(controller, LinearModel) else ""
        raise ControlError(
            f"controller is a {type(controller).__name__}{instead}; it must be a Controller, such as a LinearController, "
            "which represents any linear control law"
        )
    if abs(controller.sample_time / model.sample_time - 1.0) > 1e-6:
        raise ControlError(
            f"the controller runs every {controller.sample_time:g} s, the model is sampled every "
            f"{model.sample_time:g} s"
        )


def require_laws(controller: Controller, operating_inputs: Iterable[float]) -> None:
    """Raise ControlError unless a controller, possibly of a user's class, has a law at all operating points."""
    name = f"{type(controller).__name__}.local"
    for operating_input in operating_inputs:
        try:
            law = controller.local(float(operating_input))
        except DeatwinError:
            raise
        except Exception as error:
            raise ControlError(f"{name} raised {type(error).__name__} at {operating_input:g}: {error}") from error
        if not isinstance(law, Law):
            raise ControlError(f"{name} returned {type(law).__name__} at {operating_input:g}; it must return a Law")


def require_inside(model: NarxModel, operating_inputs: Sequence[float]) -> None:
    """Raise ModelError unless operating inputs lie inside the training data."""
    if model.operating is None:
        return
    low, high = float(model.operating.input_min[0]), float(model.operating.input_max[0])
    for operating_input in operating_inputs:
        if not low <= operating_input <= high:
            raise ModelError(
                f"the operating input {operating_input:g} lies outside the range of the training data, "
                f"{low:g} to {high:g} {model.input_units[0]}"
            )


def require_limits(limits: tuple[float, float], linear: LinearModel) -> None:
    """Raise ControlError unless the limits of the command hold the operating input."""
    low, high = limits
    if not low < linear.operating_input < high:
        raise ControlError(
            f"the operating input {linear.operating_input:g} must lie between the limits of the command, "
            f"{low:g} and {high:g}"
        )


def trained_range(model: NarxModel) -> tuple[float, float]:
    """Return the smallest and largest input of the training data, in its unit."""
    if model.operating is None:
        raise ModelError("the model does not state the range of its training data: give command_limits")
    return float(model.operating.input_min[0]), float(model.operating.input_max[0])


def known_caveats(model: NarxModel) -> tuple[str, ...]:
    """Return the caveats that the model's file contains."""
    reliance = Reliance.of_provenance(model.provenance)
    return () if reliance is None else reliance.caveats


def integral_only(controller: Controller) -> tuple[str, ...]:
    """Return a sentence if a designed controller has no proportional part."""
    gains = PidGains.of_law(controller.local(controller.operating_input), controller.sample_time)
    if gains is None or gains.proportional:
        return ()
    return (
        "the controller has no proportional part, because the time constant of the model is shorter than the closed-loop "
        f"time, {controller.closed_loop_time:.2g} s",
    )


def known_excitation(model: NarxModel, recording: Recording | None) -> Excitation | None:
    """Return the band that the recording excited; None if it is unknown."""
    return Excitation.of_provenance(model.provenance) if recording is None else excitation(recording)


def known_residual(model: NarxModel, recording: Recording | None) -> Residual | None:
    """Return the residual of the model's free run; None if it is unknown."""
    carried = Residual.of_provenance(model.provenance)
    if recording is None:
        return carried
    found = free_run_residual(model, recording)
    if carried is not None and found.rms > _FOREIGN * carried.rms:
        raise ModelError(
            f"the model's free-run error is {with_unit(found.rms, model.output_units[0])} rms on this recording, but was "
            f"{with_unit(carried.rms, model.output_units[0])} rms when the model was identified: give a recording of the same actuator, in the same units"
        )
    return found
