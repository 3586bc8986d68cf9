"""Write numbers in sentences. A number beyond a limit is written as "more than" that limit, without its many digits."""

from __future__ import annotations

from collections.abc import Mapping

LARGEST: Mapping[str, float] = {" %": 1000.0, " times": 100.0, " steps": 100.0}
"""Largest number that is written in full, by unit."""


def amount(value: float, form: str, unit: str) -> str:
    """A number as a sentence has it: "12.3 %", or "more than 1000 %"."""
    text = f"{value:{form}}"
    if unit in LARGEST:
        if value > LARGEST[unit]:
            return f"more than {LARGEST[unit]:g}{unit}"
        if "e+" in text:  # a format of few digits, although the number is not large
            text = f"{float(text):.0f}"
    return f"{text}{unit}"


def three_digits(value: float) -> str:
    """Write a number with at most three significant digits, and without an exponent for ordinary sizes.

    >>> three_digits(1234.0), three_digits(0.9), three_digits(-0.12345)
    ('1230', '0.9', '-0.123')
    """
    return f"{float(f'{value:.3g}'):g}"
