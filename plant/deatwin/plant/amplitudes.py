"""The unit in which results state amplitudes, and its notation on an axis."""

from __future__ import annotations

from collections.abc import Mapping

UNITS: Mapping[str, tuple[str, float]] = {"m": ("um", 1e-6), "1": ("", 1.0)}
"""Units in which amplitudes are reported, with their SI size; all others are reported in SI."""


def amplitude_unit(output_unit: str) -> tuple[str, float]:
    """Return the unit of amplitudes and its SI size."""
    return UNITS.get(output_unit, (output_unit, 1.0))


def written_amplitude(output_unit: str) -> tuple[str, float]:
    """Return the unit of amplitudes for an axis, such as ``"µm"``, and its SI size."""
    name, size = amplitude_unit(output_unit)
    return written_unit(name), size


def written_unit(reported: str) -> str:
    """Write a unit of amplitudes for a reader.

    >>> written_unit("um"), written_unit("N")
    ('µm', 'N')
    """
    return "µm" if reported == "um" else reported


def amount(number: str, unit: str) -> str:
    """Format a number with its unit, without one if it is a pure number or the unit is unknown.

    >>> amount("2.6", "V"), amount("2.6", "1")
    ('2.6 V', '2.6')
    """
    return number if unit in ("", "1") else f"{number} {unit}"


def axis_label(name: str, unit: str) -> str:
    """Write the label of an axis, with its unit in brackets if it has one."""
    return name if unit in ("", "1") else f"{name} ({unit})"


def reported_size(reported: str, output_unit: str) -> float:
    """Return the size of a result's unit of amplitudes, in the unit of the readings.

    >>> reported_size("um", "m"), reported_size("um", "um"), reported_size("rpm", "rpm")
    (1e-06, 1.0, 1.0)
    """
    return 1.0 if reported == output_unit else dict(UNITS.values()).get(reported, 1.0)
