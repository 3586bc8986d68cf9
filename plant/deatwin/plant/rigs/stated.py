"""Check the fields of a rig: their types, and whether sizes are physically possible."""

from __future__ import annotations

from dataclasses import fields
from math import inf, isfinite
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

from deatwin.plant.errors import RigError
from deatwin.plant.safe_read import clipped

if TYPE_CHECKING:
    from deatwin.plant.rigs.base import Rig


LARGEST = 1e12  # Largest number in any unit; its square is still finite
_SIZE, _STRETCH, _AMOUNT, _DAY = (1e-9, 1e3), (0.1, 10.0), (0.0, 1e6), (0.0, 86400.0)
_RANGES: dict[str, tuple[float, float]] = {
    "sample_time": (1e-6, 1e3),
    "start_ramp": _DAY,
    "start_hold": _DAY,
    **dict.fromkeys(("noise", "model_error"), (0.0, LARGEST)),
    **dict.fromkeys(("mass", "damping", "spring_rate"), _AMOUNT),
    **dict.fromkeys(("thickness", "length", "width", "waist_width", "bar_width", "area"), _SIZE),
    **dict.fromkeys(("frame_radius", "electrode_radius", "contact_radius", "disc_radius", "snap_reach"), _SIZE),
    **dict.fromkeys(("prestretch", "side_prestretch", "hoop_prestretch"), _STRETCH),
    **dict.fromkeys(("elements", "layers", "stations"), (1, 1e6)),
}
"""Ranges of the fields of built-in rigs, both ends included, SI; other rigs have their own checks."""
_KINDS = {
    "float": (Real, "a number"),
    "int": (Integral, "a whole number"),
    "bool": (bool, "true or false"),
    "str": (str, "text"),
}


def require_number(name: str, value: object, *, least: float | None = None) -> None:
    """Raise RigError unless a value is a finite number, at least `least`, or above 0 if that is omitted."""
    is_number = isinstance(value, Real) and not isinstance(value, bool) and isfinite(value)
    if not is_number or (value <= 0.0 if least is None else value < least):  # type: ignore[operator]
        wanted = "" if least == -inf else " above 0" if least is None else f" of at least {least:g}"
        raise RigError(f"{name} is {clipped(repr(value))}; it must be a number{wanted}")


def require_stated(rig: Rig) -> None:
    """Raise RigError unless each field of a rig from a file has the right type and is in range."""
    require_sizes(rig)
    if rig.command_range is not None:
        _require_range(rig.command_range)


def require_sizes(rig: Rig) -> None:
    """Raise RigError unless the numbers, truth values and texts of a rig have the right type and are in range."""
    for field in fields(rig):
        value, kinds = getattr(rig, field.name), str(field.type).split(" | ")
        if kinds[0] in _KINDS and not (value is None and "None" in kinds) and type(value).__name__ not in kinds[1:]:
            _require(field.name, value, *_KINDS[kinds[0]])


def _require(name: str, value: Any, kind: Any, called: str) -> None:
    lower, upper = _RANGES.get(name, (-LARGEST, LARGEST))
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise RigError(f"rig.{name} is {clipped(repr(value))}; it must be {called}")
    if isinstance(value, Real) and not lower <= float(value) <= upper:  # true for NaN, too
        raise RigError(f"rig.{name} is {value:g}; it must be from {lower:g} to {upper:g}")
    if name == "direction" and abs(value) != 1:
        raise RigError(f"rig.direction is {value:g}; it must be 1 or -1")


def _require_range(limits: Any) -> None:
    numbers = [v for v in limits if isinstance(v, int | float) and not isinstance(v, bool) and isfinite(v)]
    if len(limits) != 2 or len(numbers) != 2 or not limits[0] < limits[1]:
        raise RigError(f"rig.command_range is {clipped(list(limits))}; it must be the lowest and the highest command")
