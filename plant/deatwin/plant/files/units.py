"""Units of file columns, and their conversion to SI and back.

Factors are definitions: the pound-force is 0.45359237 kg times 9.80665 m/s2, the inch 0.0254 m, a turn 2 pi rad.
A temperature in degrees Celsius is shifted to kelvin, a temperature difference is not: it is told by its name, as
``dT``, ``temperature rise``, or by its unit, as ``delta_degC``. ``g`` is the gram, and behind the name of an
acceleration standard gravity. ``C`` is the degree Celsius behind the name of a temperature and
the coulomb behind that of a charge; behind others nobody knows.
"""

import math
import re
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Unit:
    """A unit of a file: ``SI value = (value + shift) * numerator / denominator``.

    Two whole numbers, since 35 / 1000 is the float nearest to 0.035 and 35 * 1e-3 is not.
    """

    si: str  # The SI unit of the same kind, or the one that is wanted instead
    numerator: float = 1.0  # Their quotient is the factor
    denominator: float = 1.0
    shift: float = 0.0  # Added before it; of degrees Celsius

    def to_si(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of any shape, given in this unit, in the unit `si`."""
        return (values + self.shift) * self.numerator / self.denominator

    def from_si(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of any shape, given in the unit `si`, in this unit."""
        return values * self.denominator / self.numerator - self.shift

    @property
    def is_si(self) -> bool:
        """True if values in this unit are the same numbers in the unit `si`."""
        return self.numerator == self.denominator and self.shift == 0.0

    def onto(self, wanted: "Unit", name: str) -> "Unit":
        """Return the unit that leads from this one to another of its kind."""
        numerator, denominator = self.numerator * wanted.denominator, self.denominator * wanted.numerator
        return Unit(name, numerator, denominator, self.shift - wanted.shift * (denominator / numerator))


_POWERS = {"p": -12, "n": -9, "u": -6, "m": -3, "c": -2, "h": 2, "k": 3, "M": 6, "G": 9}


def _scaled(si: str, prefixes: str, symbol: str = "", size: float = 1.0) -> dict[str, Unit]:
    """Return a unit, and it with prefixes; the prefix stands before the first symbol of a product or quotient."""
    symbol = symbol or si
    found = {symbol: Unit(si, size)}
    for prefix in prefixes:
        power = 10.0 ** abs(_POWERS[prefix])
        found[prefix + symbol] = Unit(si, size, power) if _POWERS[prefix] < 0 else Unit(si, size * power)
    return found


_POUND_FORCE = 4.4482216152605  # N, exactly 0.45359237 * 9.80665
UNITS = {
    "": Unit(""),  # not known: values are taken as they are
    **_scaled("s", "mun"),
    "min": Unit("s", 60),
    "h": Unit("s", 3600),
    "day": Unit("s", 86400),  # its symbol, d, ends too many names
    **_scaled("V", "munk"),
    **_scaled("A", "munpk"),
    **_scaled("ohm", "mkM"),
    **_scaled("F", "unp"),  # behind the name of a temperature it is none: there F are degrees Fahrenheit
    **_scaled("W", "muk"),
    **_scaled("J", "muk"),
    **_scaled("m", "cmunk"),
    **_scaled("m/s", "cmuk"),
    "km/h": Unit("m/s", 1, 3.6),
    "m/min": Unit("m/s", 1, 60),
    "mm/min": Unit("m/s", 1, 6e4),
    **_scaled("m/s2", "cmu"),
    "gn": Unit("m/s2", 9.80665),
    **_scaled("rad", "mu"),
    "deg": Unit("rad", math.pi, 180),
    "rev": Unit("rad", 2 * math.pi),
    **_scaled("rad/s", "mu"),
    "deg/s": Unit("rad/s", math.pi, 180),
    "rpm": Unit("rad/s", math.pi, 30),
    "rev/s": Unit("rad/s", 2 * math.pi),
    "deg/min": Unit("rad/s", math.pi, 10800),
    "deg/h": Unit("rad/s", math.pi, 648000),
    "rad/s2": Unit("rad/s2"),
    "deg/s2": Unit("rad/s2", math.pi, 180),
    **_scaled("Hz", "mkMG"),
    "1/s": Unit("1/s"),
    "1/min": Unit("1/s", 1, 60),
    "kg": Unit("kg"),
    "g": Unit("kg", 1, 1e3),
    "mg": Unit("kg", 1, 1e6),
    "ug": Unit("kg", 1, 1e9),
    **_scaled("N", "munkM"),
    "lbf": Unit("N", _POUND_FORCE),
    **_scaled("N m", "munkM"),
    "N cm": Unit("N m", 1, 1e2),
    "N mm": Unit("N m", 1, 1e3),
    "mN mm": Unit("N m", 1, 1e6),
    **_scaled("N/m", "muk"),
    "N/mm": Unit("N/m", 1e3),
    **_scaled("Pa", "muhkMG"),
    **_scaled("Pa", "mk", "bar", 1e5),
    "psi": Unit("Pa", _POUND_FORCE, 0.00064516),
    **_scaled("V/m", "kM"),
    "V/mm": Unit("V/m", 1e3),
    "kV/mm": Unit("V/m", 1e6),
    "V/um": Unit("V/m", 1e6),
    **_scaled("K", "m"),
    "C": Unit("C"),  # not known which
    "coulomb": Unit("C"),
    "°C": Unit("K", shift=273.15),
    "Δ°C": Unit("K"),
    "%": Unit("1", 1, 1e2),
}
_SAME_KIND = {"Hz": "1/s"}
_PREFIXES = {
    "": "",
    "pico": "p",
    "nano": "n",
    "micro": "u",
    "milli": "m",
    "centi": "c",
    "hecto": "h",
    "kilo": "k",
    "mega": "M",
    "giga": "G",
}
_WORDS = {
    "second": "s",
    "volt": "V",
    "metre": "m",
    "meter": "m",
    "ampere": "A",
    "amp": "A",
    "newton": "N",
    "kelvin": "K",
    "pascal": "Pa",
    "radian": "rad",
    "hertz": "Hz",
    "gram": "g",
    "bar": "bar",
    "watt": "W",
    "joule": "J",
    "ohm": "ohm",
    "farad": "F",
}
_SPELLED_OUT = {
    "micron": "um",
    "minute": "min",
    "hour": "h",
    "day": "day",
    "celsius": "°C",
    "coulomb": "coulomb",
    "degree": "deg",
    "revolution": "rev",
    "percent": "%",
    "millis": "ms",
    "micros": "us",
    "nanos": "ns",
    "nsec": "ns",
    "sec": "s",
    "msec": "ms",
    "usec": "us",
    # Without a prefix their capitals tell nothing.
    "deg": "deg",
    "rad": "rad",
    "rev": "rev",
    "rpm": "rpm",
    "psi": "psi",
    "hz": "Hz",
} | {
    prefix + word: short + unit
    for prefix, short in _PREFIXES.items()
    for word, unit in _WORDS.items()
    if short + unit in UNITS
}
_OTHER_SPELLINGS = {
    "deg C": "°C",
    "deg °C": "°C",
    "degC": "°C",
    "Δ C": "Δ°C",
    "Δ °C": "Δ°C",
    "delta C": "Δ°C",
    "delta °C": "Δ°C",
    "delta K": "K",
    "ΔK": "K",
    "°": "deg",
    "rev/min": "rpm",
    "r/min": "rpm",
    "U/min": "rpm",
    "tr/min": "rpm",
    "rps": "rev/s",
    "/s": "1/s",
    "/min": "1/min",
    "g0": "gn",
    "g_n": "gn",
    "cps": "Hz",
    "bar g": "bar",
    "pct": "%",
} | {
    product.replace(" ", ""): product
    for product in UNITS
    if " " in product  # Nm, mNm
}
_SIGNS = str.maketrans(
    {
        "µ": "u",
        "μ": "u",
        "∆": "Δ",
        "Ω": "ohm",
        "\u2126": "ohm",
        "·": " ",
        "⋅": " ",
        "∙": " ",
        "•": " ",
        "*": " ",
        "×": " ",
        "²": "2",
        "³": "3",
        "⁻": "-",
        "¹": "1",
        "−": "-",
        "^": "",
        "{": "",
        "}": "",
        "℃": "°C",
        "(": " ",
        ")": " ",
        "_": " ",
    }
)


def find_unit(text: str) -> str:
    """Return the unit that a cell such as ``(mm)``, ``[µm]``, ``s``, ``N·m``, ``m s^-2`` or ``(Volts)`` names.

    Examples
    --------
    >>> find_unit("(mm)"), find_unit("[µm]"), find_unit("(Volts)"), find_unit("N·m"), find_unit("force")
    ('mm', 'um', 'V', 'N m', '')
    """
    bare = text.strip()
    if bare[:1] + bare[-1:] in ("()", "[]"):
        bare = bare[1:-1].strip()
    if bare in UNITS:
        return bare
    plain = re.sub(r"(?<=[A-Za-z])[.-](?=[A-Za-z])", " ", bare.replace("**", "").translate(_SIGNS))
    above, *below = re.split(r"\s*/\s*|\s+per\s+", plain.strip())
    symbols: Counter[str] = Counter()
    for sign, factors in ((1, above.split()), *((-1, part.split()) for part in below)):
        for factor in factors:
            symbol, power = _factor(factor)
            symbols[symbol] += sign * power
    return _known(symbols)


def _factor(text: str) -> tuple[str, int]:
    """Return symbol and power of one factor of a unit."""
    match = re.fullmatch(r"([^\d-]+)(-?\d)", text)
    symbol, power = (match[1], int(match[2])) if match else (text, 1)
    word = symbol.lower()
    found = _SPELLED_OUT.get(word) or _SPELLED_OUT.get(word.removesuffix("s"))
    return found or _OTHER_SPELLINGS.get(symbol, symbol), power


def _known(symbols: Counter[str]) -> str:
    """Return the key of a unit that is given as the powers of its symbols; an empty text where it is none."""
    del symbols["1"]

    def product(sign: int) -> str:
        factors = [(symbol, sign * power) for symbol, power in symbols.items() if sign * power > 0]
        return " ".join(symbol if power == 1 else f"{symbol}{power}" for symbol, power in factors)

    above, below = product(1), product(-1)
    whole = above if not below else f"{above or '1'}/{below}"
    whole = _OTHER_SPELLINGS.get(whole, whole)
    return whole if whole in UNITS else ""


def same_kind(first: str, second: str) -> bool:
    """Return whether two SI units measure the same kind of quantity, so that their numbers are equal.

    Examples
    --------
    >>> same_kind("Hz", "1/s"), same_kind("Hz", "rad/s")
    (True, False)
    """
    return _SAME_KIND.get(first, first) == _SAME_KIND.get(second, second)
