"""Convert a controller to plain data and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from deatwin.control.arguments import instance, taking
from deatwin.control.controllers.base import Controller
from deatwin.control.controllers.inverse import InverseController
from deatwin.control.controllers.linear import LinearController
from deatwin.control.controllers.scheduled import ScheduledController
from deatwin.control.errors import ControlError
from deatwin.plant.arguments import MALFORMED
from deatwin.plant.errors import DeatwinError
from deatwin.plant.safe_read import clipped

_KINDS: tuple[type[Controller], ...] = (LinearController, InverseController, ScheduledController)
_COMMON = (
    "name",
    "sample_time",
    "operating_input",
    "operating_output",
    "command_min",
    "command_max",
    "closed_loop_time",
)


@taking(controller=instance(Controller))
def controller_to_dict(controller: Controller) -> dict[str, Any]:
    """Return a controller as plain data for JSON.

    Parameters
    ----------
    controller : Controller
        Controller of any kind.

    Returns
    -------
    dict
        Data from which `controller_from_dict` rebuilds the controller.
    """
    common = {name: getattr(controller, name) for name in _COMMON}
    return {"kind": controller.kind, **common, **controller.details()}


@taking(data=instance(Mapping))
def controller_from_dict(data: Mapping[str, Any]) -> Controller:
    """Rebuild a controller from plain data.

    Parameters
    ----------
    data : mapping
        Plain data that `controller_to_dict` returned.

    Raises
    ------
    ControlError
        If a key is missing, or the kind of controller is not known.
    """
    if absent := [name for name in ("kind", *_COMMON) if name not in data]:
        raise ControlError(f"the description of a controller lacks {', '.join(absent)}")
    for kind in _KINDS:
        if kind.kind == data["kind"]:
            try:
                return kind.from_details({name: data[name] for name in _COMMON}, data)
            except KeyError as error:
                raise ControlError(f"the description of a controller lacks {error.args[0]}") from None
            except DeatwinError:
                raise
            except MALFORMED as error:
                raise ControlError(f"malformed {kind.__name__}: {clipped(error, 200)}") from error
    known = ", ".join(kind.kind for kind in _KINDS)
    raise ControlError(f"a controller of the kind {data['kind']!r} is not known; there are {known}")
