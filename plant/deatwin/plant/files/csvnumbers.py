"""Numbers in cells, converted between the unit of a column and SI, each rounded once."""

from collections.abc import Callable
from decimal import Context, Decimal

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.files.units import Unit

EXACT = Context(prec=800)  # Decimal context with enough digits for the exact sum of any two floats


def power_of_ten(unit: Unit) -> int | None:
    """Return the exponent by which a unit's values differ from SI values, or None for another relation.

    >>> from deatwin.plant.files.units import UNITS
    >>> power_of_ten(UNITS["mm"]), power_of_ten(UNITS["kV"]), power_of_ten(UNITS["min"]), power_of_ten(UNITS["°C"])
    (-3, 3, None, None)
    """
    exponent = round(np.log10(unit.numerator / unit.denominator))
    exact = unit.numerator == unit.denominator * 10.0**exponent or unit.denominator == unit.numerator / 10.0**exponent
    return exponent if exact and not unit.shift else None


def si_values(cells: list[str], unit: Unit) -> NDArray[np.float64]:
    """Return the numbers of a column in SI units."""
    text = "\n".join(cells)
    if "_" in text:
        raise ValueError("Python's own mark between thousands")
    exponent = power_of_ten(unit)
    if exponent and not any(sign in text for sign in "eE \t"):
        power = f"e{exponent}"
        return np.array(list(map(float, f"{text}{power}".replace("\n", f"{power}\n").split("\n"))))
    return np.array(list(map(reader(unit), cells)))


def reader(unit: Unit) -> Callable[[str], float]:
    """Return a function that converts a cell in a unit to its SI value, rounded once."""
    exponent = power_of_ten(unit)
    if exponent is None:
        return _converted(unit)
    return _moved(exponent) if exponent else float


def _converted(unit: Unit) -> Callable[[str], float]:
    """Return a function that converts a cell of any unit to SI, by exact decimal arithmetic with one rounding."""
    shift, numerator, denominator = decimal_relation(unit)

    def read(cell: str) -> float:
        float(cell)  # raises ValueError before Decimal raises its own error
        shifted = EXACT.add(Decimal(cell.strip()), shift)
        return float(EXACT.divide(EXACT.multiply(shifted, numerator), denominator))

    return read


def decimal_relation(unit: Unit) -> tuple[Decimal, Decimal, Decimal]:
    """Return shift, numerator and denominator of a unit as decimal numbers."""
    return Decimal(repr(unit.shift)), Decimal(repr(unit.numerator)), Decimal(repr(unit.denominator))


def _moved(exponent: int) -> Callable[[str], float]:
    """Return a function that reads a cell with its decimal point shifted."""

    def read(cell: str) -> float:
        float(cell)  # otherwise "1e" would pass
        mantissa, _, power = cell.strip().lower().partition("e")
        return float(f"{mantissa}e{int(power or 0) + exponent}")

    return read
