"""Write numbers with units for readers."""

from __future__ import annotations

import re
from math import floor, log10

from deatwin.ident.mismatch.certainty import percent
from deatwin.ident.mismatch.thresholds import CREDIBLE
from deatwin.ident.mismatch.verdict import Interval
from deatwin.plant.prefixes import LEAST_DIGITS, prefixed, resolving

_RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹"


def quantity(value: float, unit: str) -> str:
    """Write an SI value with three digits and a prefix.

    >>> quantity(26400.0, "Pa"), quantity(0.05, "s"), quantity(-0.1, "1")
    ('26.4 kPa', '50 ms', '-0.1')
    """
    factor, shown = prefixed(value, unit)
    return f"{_written(value / factor)} {shown}".rstrip()


def raised(text: str) -> str:
    """Write the powers in a unit or a term as raised digits, and ohm as its sign.

    >>> raised("12.4 MN/m3"), raised("u'^2 5.12 s ago"), raised("1.2 Gohm")
    ('12.4 MN/m³', "u'² 5.12 s ago", '1.2 GΩ')
    """
    powers = re.sub(r"(?<=[A-Za-z'])\^?([2-9])(?!\w)", lambda found: _RAISED[int(found[1])], text)
    return re.sub(r"\b([pnµmkMG]?)ohm\b", r"\1Ω", powers)


def three_digits(value: float | None) -> str:
    """Write a number with three significant digits, or a dash for None.

    >>> three_digits(2.0), three_digits(128.4), three_digits(4321.0), three_digits(0.0123), three_digits(None)
    ('2.00', '128', '4321', '0.0123', '–')
    """
    if value is None:
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def likely(probability: float) -> str:
    """Write a cause's probability; the highest one that a diagnosis states is marked as such.

    >>> likely(0.388), likely(0.947), likely(0.95)
    ('39 %', '95 % (maximum)', '95 % (maximum)')
    """
    shown = percent(probability)
    return f"{shown} (maximum)" if shown == percent(CREDIBLE) else shown


def with_interval(value: float, low: float, high: float, unit: str) -> tuple[str, str]:
    """Write a value and its interval with one unit prefix, and enough digits to distinguish the ends."""
    shown = Interval(value=value, low=low, high=high, unit=unit).shown
    middle, ends = _in_interval(shown.value, shown.low, shown.high)
    return f"{middle} {shown.unit}".rstrip(), f"{ends} {shown.unit}".rstrip()


def in_interval(value: float, low: float, high: float) -> str:
    """Write a value and its interval without a unit, with enough digits to distinguish the ends."""
    middle, ends = _in_interval(value, low, high)
    return f"{middle} ({ends})"


def between(span: tuple[float, float]) -> str:
    """Write the ends of a range with equally many decimals: three digits of the larger end, or as many as distinguish them.

    >>> between((-6382.1, -23.96)), between((-23.96, 0.003713)), between((2.0412, 2.4622)), between((0.0, 0.0))
    ('-6382 to -24', '-24.0 to 0.0', '2.04 to 2.46', '0 to 0')
    """
    decimals = _decimals(*span)
    return " to ".join(f"{end:.{decimals}f}" for end in span)


def _decimals(low: float, high: float) -> int:
    size = max(abs(low), abs(high))
    return max(resolving(low, high) - 1 - floor(log10(size)), 0) if size > 0.0 else 0


def _in_interval(value: float, low: float, high: float) -> tuple[str, str]:
    if resolving(low, high) == LEAST_DIGITS:
        return _written(value), f"{_written(low)} to {_written(high)}"
    decimals = _decimals(low, high)
    return f"{value:.{decimals}f}", f"{low:.{decimals}f} to {high:.{decimals}f}"


def _written(value: float) -> str:
    """Write three significant digits, without an exponent for ordinary sizes."""
    return f"{value:.0f}" if 1000 <= abs(value) < 1e6 else f"{value:.3g}"
