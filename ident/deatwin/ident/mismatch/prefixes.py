"""Quantities in SI, shown with the prefix that a person would choose."""

from __future__ import annotations

import math
import re

__all__ = ["prefixed"]

PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
PREFIXED = ("Pa", "s", "m", "N", "V", "A", "Hz", "J", "ohm")


def prefixed(value: float, unit: str) -> tuple[float, str]:
    """The unit in which a value has one to three digits before the point, and its size.

    Parameters
    ----------
    value : float
        SI.
    unit : str
        SI unit; ``"1"`` is a pure number. The prefix goes to the first unit of a product or quotient.

    Returns
    -------
    tuple of float and str
        SI size of the unit with its prefix, and that unit, empty for a pure number.

    Examples
    --------
    >>> prefixed(26400.0, "Pa"), prefixed(54.0, "s"), prefixed(2e7, "N/m3"), prefixed(-0.1, "1")
    ((1000.0, 'kPa'), (1.0, 's'), (1000000.0, 'MN/m3'), (1.0, ''))
    """
    if re.split("[ /]", unit)[0] not in PREFIXED or value == 0 or not math.isfinite(value):
        return 1.0, "" if unit == "1" else unit
    power = 3 * math.floor(math.log10(abs(value)) / 3)
    if unit == "s":
        power = min(power, 0)  # nobody writes kiloseconds
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return 10.0**power, PREFIXES[power] + unit
