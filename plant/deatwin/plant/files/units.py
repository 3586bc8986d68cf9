"""Units of file columns, and their way to SI and back."""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Unit:
    """A unit of a file: ``SI value = (value + shift) * numerator / denominator``.

    Two whole numbers instead of one factor: 35 / 1000 is the float nearest to 0.035, and 35 * 1e-3 is not.
    """

    si: str
    numerator: float = 1.0
    denominator: float = 1.0
    shift: float = 0.0

    def to_si(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of any shape, given in this unit, in the unit `si`."""
        return (values + self.shift) * self.numerator / self.denominator

    def from_si(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of any shape, given in the unit `si`, in this unit."""
        return values * self.denominator / self.numerator - self.shift


UNITS = {
    "": Unit(""),  # not known: values are taken as they are
    "s": Unit("s"),
    "ms": Unit("s", 1, 1e3),
    "us": Unit("s", 1, 1e6),
    "ns": Unit("s", 1, 1e9),
    "min": Unit("s", 60),
    "h": Unit("s", 3600),
    "V": Unit("V"),
    "mV": Unit("V", 1, 1e3),
    "kV": Unit("V", 1e3),
    "m": Unit("m"),
    "cm": Unit("m", 1, 1e2),
    "mm": Unit("m", 1, 1e3),
    "um": Unit("m", 1, 1e6),
    "nm": Unit("m", 1, 1e9),
    "A": Unit("A"),
    "mA": Unit("A", 1, 1e3),
    "uA": Unit("A", 1, 1e6),
    "nA": Unit("A", 1, 1e9),
    "N": Unit("N"),
    "mN": Unit("N", 1, 1e3),
    "kN": Unit("N", 1e3),
    "K": Unit("K"),
    "C": Unit("K", shift=273.15),
    "Pa": Unit("Pa"),
    "kPa": Unit("Pa", 1e3),
    "MPa": Unit("Pa", 1e6),
}
_LOWERED = {name.lower() for name in UNITS}
_IN_BRACKETS = re.compile(r"(.+?)\s*(\([^()]*\)|\[[^\[\]]*\])")
_LAST_PART = re.compile(r"(.+?)\s*_([^_]+)")
_IN_WORDS = re.compile(r"(.+?)\s+in\s+(\S+)")
_DIVIDED = re.compile(r"([^\W\d]\w*)\s*/\s*([^\s/]+)")
_FORMS = (_IN_BRACKETS, _LAST_PART, _IN_WORDS, _DIVIDED)
"""How a header may give its unit, as the second group."""
_NO_QUANTITIES = frozenset({"kg", "g", "rad", "deg", "counts"})
"""Before a stroke these begin a unit, as in ``rad/m``."""
_PREFIXES = {"": "", "nano": "n", "micro": "u", "milli": "m", "centi": "c", "kilo": "k", "mega": "M"}
_WORDS = {"second": "s", "volt": "V", "metre": "m", "meter": "m", "ampere": "A", "amp": "A", "newton": "N",
          "kelvin": "K", "pascal": "Pa"}  # fmt: skip
_SPELLED_OUT = {"micron": "um", "minute": "min", "hour": "h", "celsius": "C"} | {
    prefix + word: short + unit
    for prefix, short in _PREFIXES.items() for word, unit in _WORDS.items() if short + unit in UNITS
}  # fmt: skip
_OTHER_SPELLINGS = {"µ": "u", "μ": "u", "°C": "C", "℃": "C", "degC": "C", "sec": "s"}


def find_unit(text: str) -> str:
    """Return the unit that a cell such as ``(mm)``, ``[µm]``, ``s`` or ``(Volts)`` names.

    Parameters
    ----------
    text : str
        One cell of a header line.

    Returns
    -------
    str
        A key of `UNITS`, an empty text where the cell names no unit.

    Examples
    --------
    >>> find_unit("(mm)"), find_unit("[µm]"), find_unit("(Volts)"), find_unit("force")
    ('mm', 'um', 'V', '')
    """
    bare = text.strip()
    if bare[:1] + bare[-1:] in ("()", "[]"):
        bare = bare[1:-1].strip()
    if (word := bare.lower()) in _SPELLED_OUT or (word := word.removesuffix("s")) in _SPELLED_OUT:
        return _SPELLED_OUT[word]
    for spelling, usual in _OTHER_SPELLINGS.items():
        bare = bare.replace(spelling, usual)
    return bare if bare in UNITS else ""


def split_unit(header: str) -> tuple[str, str]:
    """Return name and unit of a column header.

    Parameters
    ----------
    header : str
        The header, with the unit as its last part, in brackets, behind "in" or below a stroke (``U/mV``, but not
        below the name of another unit, as in ``mm/s``), or without one.

    Returns
    -------
    name : str
        The name without the unit.
    unit : str
        A key of `UNITS`, an empty text where the header names none.

    Examples
    --------
    >>> split_unit("displacement_mm"), split_unit("Force [N]"), split_unit("film_voltage"), split_unit("U_cmd (kV)")
    (('displacement', 'mm'), ('Force', 'N'), ('film_voltage', ''), ('U_cmd', 'kV'))
    """
    for form in _FORMS:
        match = form.fullmatch(header)
        if match and (unit := find_unit(match[2])) and not (form is _DIVIDED and _is_rate(match[1], unit)):
            return match[1], unit
    return header, ""


def unknown_unit(header: str) -> str:
    """Return what a header gives as its unit where that is none, but was surely meant to be one.

    Parameters
    ----------
    header : str
        Of a column, of which `split_unit` knows no unit.

    Returns
    -------
    str
        As the header has it; empty where nothing tells that it is meant as a unit.

    Examples
    --------
    >>> unknown_unit("command_MV"), unknown_unit("U (%)"), unknown_unit("U_cmd"), unknown_unit("x (left)")
    ('MV', '%', '', '')
    """
    for form in _FORMS:
        if match := form.fullmatch(header):
            said = match[2].strip("()[] ")
            if "%" in said or (len(said) > 1 and said.lower() in _LOWERED):
                return said
    return ""


def _is_rate(before: str, unit: str) -> bool:
    """Whether what stands before a stroke belongs to a unit; ``t/s`` is a time, any other ``/s`` a rate."""
    rate = UNITS[unit].si == "s" and before.lower() not in ("t", "time")
    return rate or before in UNITS or before in _NO_QUANTITIES
