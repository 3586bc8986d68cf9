"""Show SI quantities with a suitable prefix."""

from __future__ import annotations

import math
import re

from deatwin.plant.amplitudes import amount

PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
LEAST_DIGITS, MOST_DIGITS = 3, 9
PREFIXED = ("Pa", "s", "m", "g", "N", "V", "A", "F", "Hz", "J", "W", "ohm")


def prefixed(value: float, unit: str) -> tuple[float, str]:
    """Return size and name of the unit in which a value has one to three digits before the point.

    >>> prefixed(26400.0, "Pa"), prefixed(54.0, "s"), prefixed(2e7, "N/m3"), prefixed(-0.1, "1"), prefixed(3e-4, "kg")
    ((1000.0, 'kPa'), (1.0, 's'), (1000000.0, 'MN/m3'), (1.0, ''), (1e-06, 'mg'))
    """
    if unit == "kg" and 0.0 < abs(value) < 1.0:
        size, shown = prefixed(1e3 * value, "g")
        return 1e-3 * size, shown
    if re.split("[ /]", unit)[0] not in PREFIXED or value == 0 or not math.isfinite(value):
        return 1.0, "" if unit == "1" else unit
    power = 3 * math.floor(math.log10(abs(value)) / 3)
    if unit == "s":
        power = min(power, 0)  # kiloseconds are not in use
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    return 10.0**power, PREFIXES[power] + unit


def with_unit(value: float, unit: str) -> str:
    """Write a value with three digits and a prefix on its SI unit; the rounded value decides the prefix.

    >>> with_unit(1.2e-5, "m"), with_unit(0.9999e-3, "m"), with_unit(-2500.0, "V"), with_unit(0.5, "1")
    ('12 µm', '1 mm', '-2.5 kV', '0.5')
    >>> with_unit(23460.0, "rpm")
    '23500 rpm'
    """
    shown = float(f"{value:.3g}")
    size, prefixed_unit = prefixed(shown, unit)
    return amount(f"{shown / size:g}", prefixed_unit)


def range_with_unit(first: float, last: float, unit: str) -> str:
    """Write the ends of a range with one prefix, that of the larger end, and enough digits to distinguish the ends.

    >>> range_with_unit(3e4, 26e3, "Pa"), range_with_unit(0.0, 0.02, "s"), range_with_unit(-800.0, 23460.0, "rpm")
    ('30 to 26 kPa', '0 to 20 ms', '-800 to 23500 rpm')
    """
    digits = resolving(min(first, last), max(first, last))
    first, last = (float(f"{end:.{digits}g}") for end in (first, last))
    size, prefixed_unit = prefixed(max(first, last, key=abs), unit)
    return amount(f"{first / size:.{MOST_DIGITS}g} to {last / size:.{MOST_DIGITS}g}", prefixed_unit)


def time_span(first: float, last: float, decimals: int = 2, between: str = " to ") -> str:
    """Write the ends of a stretch of time, in s, with more decimals if they would look equal, and equal ones once.

    >>> time_span(3.5, 12.25), time_span(3.502, 3.503), time_span(3.5, 3.5)
    ('3.50 to 12.25 s', '3.502 to 3.503 s', '3.50 s')
    """
    while first != last and f"{first:.{decimals}f}" == f"{last:.{decimals}f}" and decimals < MOST_DIGITS:
        decimals += 1
    ends = dict.fromkeys(f"{end:.{decimals}f}" for end in (first, last))
    return f"{between.join(ends)} s"


def resolving(low: float, high: float) -> int:
    """Return how many significant digits distinguish the ends of an interval: three, or to the first of its width.

    >>> resolving(50.2, 59.3), resolving(24.98, 25.04), resolving(151.39, 151.47), resolving(2.0, 2.0)
    (3, 4, 5, 3)
    """
    width, size = high - low, max(abs(low), abs(high))
    if not (width > 0.0 and math.isfinite(size)):
        return LEAST_DIGITS
    needed = math.floor(math.log10(size)) - math.floor(math.log10(width)) + 1
    return min(max(needed, LEAST_DIGITS), MOST_DIGITS)
