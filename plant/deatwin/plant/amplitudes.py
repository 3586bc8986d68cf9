"""The unit in which results state amplitudes, and how it is written beside an axis."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["UNITS", "amplitude_unit", "written_amplitude"]

UNITS: Mapping[str, tuple[str, float]] = {"m": ("um", 1e-6)}
"""Units in which amplitudes are reported, with their SI size; others are reported in SI."""


def amplitude_unit(output_unit: str) -> tuple[str, float]:
    """Unit of amplitudes, and its SI size.

    Parameters
    ----------
    output_unit : str
        SI unit of the rig's output.

    Returns
    -------
    tuple of str and float
        As ``("um", 1e-6)`` for a displacement.
    """
    return UNITS.get(output_unit, (output_unit, 1.0))


def written_amplitude(output_unit: str) -> tuple[str, float]:
    """Unit of amplitudes as axes show it, and its SI size.

    Parameters
    ----------
    output_unit : str
        SI unit of the rig's output.

    Returns
    -------
    tuple of str and float
        As ``("µm", 1e-6)`` for a displacement.
    """
    name, size = amplitude_unit(output_unit)
    return ("µm" if name == "um" else name), size
