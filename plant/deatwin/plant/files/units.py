"""Units of file columns, and their conversion to SI and back.

Factors are definitions: the pound-force is 0.45359237 kg times 9.80665 m/s2, the inch 0.0254 m, a turn 2 pi rad. Only a
temperature is shifted to kelvin, not a difference, which its name tells (``dT``, ``temperature rise``) or its unit
(``delta_degC``). ``g`` is the gram, behind the name of an acceleration gravity; ``C`` is degrees behind the name of a
temperature and coulomb behind that of a charge, else unknown.
"""

import math
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Unit:
    """A unit of a file: ``SI value = (value + shift) * numerator / denominator``, exact where a product is not: 35 /
    1000 is the float nearest to 0.035, 35 * 1e-3 is not."""

    si: str  # SI unit of the same kind, or the unit wanted instead
    numerator: float = 1.0  # The factor is the quotient of numerator and denominator
    denominator: float = 1.0
    shift: float = 0.0  # Added before the factor is applied; used for degrees Celsius and Fahrenheit

    def to_si(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of any shape, given in this unit, in the unit `si`."""
        return (values + self.shift) * self.numerator / self.denominator

    def from_si(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values of any shape, given in the unit `si`, in this unit."""
        return values * self.denominator / self.numerator - self.shift

    @property
    def is_si(self) -> bool:
        """True if values in this unit equal those in the unit `si`."""
        return self.numerator == self.denominator and self.shift == 0.0

    def onto(self, wanted: "Unit", name: str) -> "Unit":
        """Return the unit that converts from this one to another of its kind."""
        numerator, denominator = self.numerator * wanted.denominator, self.denominator * wanted.numerator
        return Unit(name, numerator, denominator, self.shift - wanted.shift * (denominator / numerator))


_POWERS = {"p": -12, "n": -9, "u": -6, "m": -3, "c": -2, "h": 2, "k": 3, "M": 6, "G": 9, "T": 12}


def _scaled(
    si: str, prefixes: str, symbol: str = "", numerator: float = 1.0, denominator: float = 1.0
) -> dict[str, Unit]:
    """Return a unit and its versions with prefixes."""
    symbol = symbol or si
    found = {symbol: Unit(si, numerator, denominator)}
    for prefix in prefixes:
        power = 10.0 ** abs(_POWERS[prefix])
        above, below = (numerator, denominator * power) if _POWERS[prefix] < 0 else (numerator * power, denominator)
        found[prefix + symbol] = _reduced(si, above, below)
    return found


def _reduced(si: str, numerator: float, denominator: float) -> Unit:
    """Return a unit with its factor reduced to the smallest whole numbers, because larger ones would round again."""
    whole = float(numerator).is_integer() and float(denominator).is_integer()
    common = math.gcd(int(numerator), int(denominator)) if whole else 1
    return Unit(si, numerator / common, denominator / common)


_POUND_FORCE = 4.4482216152605  # N, exactly 0.45359237 * 9.80665
_GRAVITY = 9.80665
_SYMBOLS = {
    "": Unit(""),  # unknown: values are taken as they are
    **_scaled("s", "mun"),
    "min": Unit("s", 60),
    "h": Unit("s", 3600),
    "day": Unit("s", 86400),  # not d, because too many names end in it
    **_scaled("V", "munk"),
    **_scaled("A", "munpk"),
    **_scaled("ohm", "umkMGT"),
    **_scaled("F", "munp"),
    **_scaled("C", "munp"),  # without a prefix, C may be Celsius or coulomb
    "coulomb": Unit("C"),
    "farad": Unit("F"),  # after the name of a temperature, F means degrees Fahrenheit
    **_scaled("W", "munk"),
    **_scaled("J", "munk"),
    **_scaled("m", "cmunpk"),
    "dm": Unit("m", 1, 10),
    "inch": Unit("m", 254, 1e4),
    "ft": Unit("m", 3048, 1e4),
    "yd": Unit("m", 9144, 1e4),
    "mil": Unit("m", 254, 1e7),  # a thousandth of an inch
    "uinch": Unit("m", 254, 1e10),
    "angstrom": Unit("m", 1, 1e10),
    **_scaled("m3", "mu", "l", 1, 1e3),
    **_scaled("rad", "mu"),
    "deg": Unit("rad", math.pi, 180),
    "arcmin": Unit("rad", math.pi, 10800),
    "arcsec": Unit("rad", math.pi, 648000),
    "rev": Unit("rad", 2 * math.pi),
    **_scaled("Hz", "mkMG"),
    **_scaled("kg", "munk", "g", 1, 1e3),
    **_scaled("N", "mcunkM"),
    "daN": Unit("N", 10),
    **_scaled("N", "mk", "gf", _GRAVITY, 1e3),
    "lbf": Unit("N", _POUND_FORCE),
    "ozf": Unit("N", _POUND_FORCE, 16),
    "kip": Unit("N", 1e3 * _POUND_FORCE),
    "kp": Unit("N", _GRAVITY),
    "dyn": Unit("N", 1, 1e5),
    **_scaled("Pa", "muhkMG"),
    **_scaled("Pa", "muk", "bar", 1e5),
    "psi": Unit("Pa", _POUND_FORCE, 0.00064516),
    "ksi": Unit("Pa", 1e3 * _POUND_FORCE, 0.00064516),
    "atm": Unit("Pa", 101325),
    "Torr": Unit("Pa", 101325, 760),
    "mmHg": Unit("Pa", 133.322387415),  # conventional: 13.5951 g/cm3 under standard gravity
    "inHg": Unit("Pa", 25.4 * 133.322387415),
    "mmH2O": Unit("Pa", _GRAVITY),
    "cmH2O": Unit("Pa", 10 * _GRAVITY),
    "inH2O": Unit("Pa", 25.4 * _GRAVITY),
    **_scaled("K", "mu"),
    "°C": Unit("K", shift=273.15),
    "Δ°C": Unit("K"),
    "°F": Unit("K", 5, 9, shift=459.67),
    **_scaled("m/s2", "mu", "gn", _GRAVITY),
    "mph": Unit("m/s", 44704, 1e5),
    "rpm": Unit("rad/s", math.pi, 30),
    "%": Unit("1", 1, 1e2),
    "ppm": Unit("1", 1, 1e6),
}
_WITHIN = {"MV": _reduced("V", 1e6, 1)}
"""Symbols recognised within products and quotients only; alone, MV is more often a misspelt mV."""
_FACTOR = re.compile(r"([^\d-]+?)(-?\d)")


def _powers(text: str) -> Counter[str]:
    """Return the factors of a product or quotient such as ``N m`` or ``m/s2``, with their powers."""
    found: Counter[str] = Counter()
    for place, part in enumerate(text.split("/")):
        for factor in part.split():
            match = None if factor in _SYMBOLS else _FACTOR.fullmatch(factor)
            symbol, power = (match[1], int(match[2])) if match else (factor, 1)
            found[symbol] += -power if place else power
    del found["1"]
    return found


def _signature(powers: Mapping[str, int]) -> frozenset[tuple[str, int]]:
    return frozenset((symbol, power) for symbol, power in powers.items() if power)


_KINDS = {
    _signature(_powers(product)): product
    for product in (
        *("1", "1/s", "1/m", "1/K", "m2", "m3", "m/s", "m/s2", "m/s3", "m3/s", "rad/s", "rad/s2", "rad/s3"),
        *("N m", "N/m", "N/s", "N s/m", "N s", "Pa s", "Pa/s", "kg/s", "kg/m3", "kg m2", "K/s", "J/m3", "W/m2"),
        *("V/m", "V/s", "A/s", "A/m", "A/m2", "C/m2", "F/m", "ohm m", "V/N", "m/V", "N/V", "N/A", "C/N"),
    )
} | {_signature(_powers(product)): si for product, si in (("N/m2", "Pa"), ("A s", "C"), ("W s", "J"), ("V A", "W"))}
"""SI names of the products and quotients that count as units, by the powers of their factors."""


@lru_cache(maxsize=1024)
def _derived(name: str) -> Unit | None:
    """Return the unit of a product or quotient of known symbols, with any prefixes; None if it is invalid."""
    above, below, base = 1.0, 1.0, Counter[str]()
    powers = _powers(name)
    if not powers or name in _WITHIN:
        return None
    for symbol, power in powers.items():
        unit = _SYMBOLS.get(symbol) or _WITHIN.get(symbol)
        if unit is None or not symbol:
            return None
        up, down = (unit.numerator, unit.denominator) if power > 0 else (unit.denominator, unit.numerator)
        above, below = above * up ** abs(power), below * down ** abs(power)
        for factor, inner in _powers(unit.si).items():
            base[factor] += inner * power
    si = _KINDS.get(_signature(base))
    if si == "1" and len(powers) > 1 and _is_scale(name, above / below):
        return None
    return None if si is None else _reduced(si, above, below)


def _is_scale(quotient: str, factor: float) -> bool:
    """Return whether a quotient of voltages or currents is the scale of a monitor or of an amplifier, such as V/kV.

    The reading of a bridge, in mV/V, is none.
    """
    first, _, last = quotient.partition("/")
    return all(_SYMBOLS[part].si in ("V", "A") for part in (first, last) if part in _SYMBOLS) and (
        factor > 1.0 or last not in ("V", "A")
    )


class _Units(Mapping[str, Unit]):
    """Units by name: symbols, and products and quotients of them; only the usual ones are listed."""

    def __getitem__(self, name: str) -> Unit:
        unit = _SYMBOLS.get(name) or _derived(name)
        if unit is None:
            raise KeyError(name)
        return unit

    def __iter__(self) -> Iterator[str]:
        return iter((*_SYMBOLS, *_LISTED))

    def __len__(self) -> int:
        return len(_SYMBOLS) + len(_LISTED)


_LISTED = (
    *("m/s", "cm/s", "mm/s", "um/s", "km/s", "km/h", "m/min", "mm/min", "m/s2", "cm/s2", "mm/s2", "um/s2"),
    *("rad/s", "mrad/s", "urad/s", "deg/s", "rev/s", "deg/min", "deg/h", "rad/s2", "deg/s2", "1/s", "1/min"),
    *("N m", "mN m", "uN m", "nN m", "kN m", "MN m", "N cm", "N mm", "mN mm", "N/m", "mN/m", "uN/m", "kN/m", "N/mm"),
    *("V/m", "kV/m", "MV/m", "V/mm", "kV/mm", "V/um", "m3", "m3/s", "l/min", "ml/min"),
)
UNITS: Mapping[str, Unit] = _Units()
_SAME_KIND = {"Hz": "1/s"}
_PREFIXES = {
    "": "",
    "pico": "p",
    "nano": "n",
    "micro": "u",
    "mikro": "u",
    "milli": "m",
    "mili": "m",
    "centi": "c",
    "hecto": "h",
    "kilo": "k",
    "mega": "M",
    "giga": "G",
    "tera": "T",
    "厘": "c",
    "毫": "m",
    "微": "u",
    "纳": "n",
    "千": "k",
    "兆": "M",
    "ミリ": "m",
    "マイクロ": "u",
    "キロ": "k",
}
_WORDS = {
    "second": "s",
    "sekunde": "s",
    "sekunden": "s",
    "seconde": "s",
    "segundo": "s",
    "volt": "V",
    "metre": "m",
    "mètre": "m",
    "meter": "m",
    "ampere": "A",
    "amp": "A",
    "newton": "N",
    "kelvin": "K",
    "pascal": "Pa",
    "farad": "F",
    "coulomb": "C",
    "litre": "l",
    "liter": "l",
    "radian": "rad",
    "hertz": "Hz",
    "gram": "g",
    "bar": "bar",
    "watt": "W",
    "joule": "J",
    "ohm": "ohm",
    "秒": "s",
    "伏": "V",
    "伏特": "V",
    "安": "A",
    "安培": "A",
    "米": "m",
    "牛": "N",
    "牛顿": "N",
    "帕": "Pa",
    "克": "g",
    "赫兹": "Hz",
    "ボルト": "V",
    "アンペア": "A",
    "メートル": "m",
    "ニュートン": "N",
    "グラム": "g",
}
_CYRILLIC = {
    (prefix + word): short + unit
    for prefix, short in {
        "": "",
        "п": "p",
        "н": "n",
        "мк": "u",
        "м": "m",
        "с": "c",
        "к": "k",
        "М": "M",
        "Г": "G",
    }.items()
    for word, unit in {
        **{"с": "s", "сек": "s", "В": "V", "А": "A", "м": "m", "Н": "N", "Па": "Pa", "Гц": "Hz", "Ом": "ohm"},
        **{"Ф": "F", "г": "g", "Вт": "W", "Дж": "J", "бар": "bar"},
    }.items()
    if short + unit in _SYMBOLS
} | {"мин": "min", "ч": "h", "об/мин": "rpm", "град": "deg"}
_SPELLED_OUT = {
    "micron": "um",
    "minute": "min",
    "hour": "h",
    "hr": "h",
    "sek": "s",
    "minuten": "min",
    "stunden": "h",
    "day": "day",
    "celsius": "°C",
    "fahrenheit": "°F",
    "degree": "deg",
    "in": "inch",
    "inch": "inch",
    "inches": "inch",
    "foot": "ft",
    "feet": "ft",
    "yard": "yd",
    "thou": "mil",
    "ångström": "angstrom",
    "turn": "rev",
    "arcminute": "arcmin",
    "arcsecond": "arcsec",
    "kilopond": "kp",
    "dyne": "dyn",
    "revolution": "rev",
    "percent": "%",
    "millis": "ms",
    "micros": "us",
    "nanos": "ns",
    "nsec": "ns",
    "sec": "s",
    "msec": "ms",
    "usec": "us",
    # Capitals do not matter in units without a prefix.
    "deg": "deg",
    "rad": "rad",
    "rev": "rev",
    "rpm": "rpm",
    "psi": "psi",
    "psig": "psi",
    "psia": "psi",
    "ft": "ft",
    "mil": "mil",
    "lbf": "lbf",
    "hz": "Hz",
    "torr": "Torr",
    "microstrain": "ppm",
    "ustrain": "ppm",
} | {
    prefix + word: short + unit
    for prefix, short in _PREFIXES.items()
    for word, unit in _WORDS.items()
    if short + unit in _SYMBOLS
}
_SPELLED_OUT |= {"coulomb": "coulomb", "farad": "farad"}  # the symbols C and F alone are ambiguous
_OTHER_SPELLINGS = _CYRILLIC | {
    "deg C": "°C",
    "deg °C": "°C",
    "degC": "°C",
    "Δ C": "Δ°C",
    "Δ °C": "Δ°C",
    "delta C": "Δ°C",
    "delta °C": "Δ°C",
    "delta K": "K",
    "°K": "K",
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
    "pct": "%",
    "deg F": "°F",
    "deg °F": "°F",
    "degF": "°F",
    "L": "l",
    "mL": "ml",
    "uL": "ul",
    "uε": "ppm",
    "Å": "angstrom",
    "uin": "uinch",
    "g force": "gf",
    "kg force": "kgf",
    **{f"{length} {fluid}": length + fluid for length in ("mm", "cm") for fluid in ("Hg", "H2O")},
    **{f"inch {fluid}": f"in{fluid}" for fluid in ("Hg", "H2O")},
    **{
        f"{first}{second}": f"{first} {second}" for first in ("A", "mA", "uA", "W", "mW", "kW") for second in ("h", "s")
    },
    **{
        f"{prefix}N{length}": f"{prefix}N {length}"
        for prefix in ("", *"munkM")
        for length in ("m", "cm", "mm", "um", "s")
    },
}
_SIGNS = str.maketrans(
    {
        "μ": "u",
        "∆": "Δ",
        "Ω": "ohm",
        "·": " ",
        "⋅": " ",
        "∙": " ",
        "•": " ",
        "*": " ",
        "×": " ",
        "−": "-",
        "^": "",
        "{": "",
        "}": "",
        "(": " ",
        ")": " ",
        "_": " ",
    }
)


_TEN_TO = re.compile(
    r"(?:[x×*·] ?)?(?P<base>1[eE]|10 ?(?:\^|\*\*) ?[({]? ?|10(?=[-−]))(?P<power>[-+−]?[0-9]{1,2}) ?[)}]? ?(?:[x×*·] ?)?"
    r"(?P<unit>(?!x ?1)[^\W\d].*)"
)
"""Unit behind a power of ten, such as ``10^-3 m``, ``10⁻³ m`` or ``1e-3 m``."""
_RAISED = re.compile("10([⁺⁻]?[⁰¹²³⁴-⁹]+)")
_DIRECT = re.compile(r"(?<=[VA])(?:\s*(?:DC|dc)|\s+vs\b.*)$")  # Behind the unit of a direct voltage or current
_ABOVE = re.compile(r"([munphkMG]?(?:bar|Pa)|psi)\s*(?:[ag]|abs|gauge|\((?:[ag]|abs|gauge)\))")
"""Unit of a pressure above a vacuum or above that of the air: bara, mbar(g), kPa abs."""
FULL_WIDTH = str.maketrans("（）［］【】〔〕", "()[][][]")  # Brackets among Chinese and Japanese characters
_NO_WIDTH = re.compile("[\u200b-\u200d\u2060\ufeff]")  # Marks that web pages leave in a copied text
_LATEX_UNIT = re.compile(r"\\(?:si|unit)\s*\{([^{}]*)\}")
_LATEX_PREFIX = re.compile(r"\\(pico|nano|micro|milli|centi|hecto|kilo|mega|giga|tera)\s*\\?")
_LATEX_SIGNS = (
    (re.compile(r"\{?\\(?:text)?mu\}?\s*|\\micro\s+"), "µ"),
    (re.compile(r"\^\s*\{?\s*\\circ\s*\}?|\\degree\s*(?=C|\\?[cC]elsius)|\\textdegree\s*"), "°"),
    (re.compile(r"\\(?:mathrm|text|textrm|rm|ensuremath)\s*\{([^{}]*)\}"), r"\1"),
    (re.compile(r"\\[,;! ]|~"), " "),
    (re.compile(r"\\%"), "%"),
)


def without_latex(text: str) -> str:
    """Return a header or a unit without the commands of LaTeX, a unit of its package siunitx in brackets.

    >>> without_latex(r"$U$ / \\si{\\kilo\\volt}"), without_latex(r"x in \\unit{\\um}"), without_latex(r"x [$\\mu$m]")
    ('U (kilovolt)', 'x (um)', 'x [µm]')
    >>> without_latex(r"a [\\si{\\metre\\per\\second\\squared}]"), without_latex("price ($)")
    ('a [metre / second2]', 'price ($)')
    """
    if "\\" not in text and text.count("$") < 2:
        return text
    text = re.sub(r"\$([^$]*)\$", r"\1", _LATEX_UNIT.sub(_of_siunitx, text))
    for command, sign in _LATEX_SIGNS:
        text = command.sub(sign, text)
    text = re.sub(r"(?:\s+(?:in|en)\s+|\s*/\s*|\s*,\s*)(?=\([^()]*\)$)", " ", text)
    return re.sub(r"([(\[])\s*\(([^()]*)\)\s*(?=[)\]])", r"\1\2", text)


def _of_siunitx(found: re.Match[str]) -> str:
    """Return the unit in a command of siunitx in words, in brackets."""
    words = re.sub(r"\\(squared|cubed)", lambda power: "2" if power[1] == "squared" else "3", found[1])
    words = re.sub(r"\\degreeCelsius|\\celsius", "°C", re.sub(r"\\per(?![a-z])", " / ", words))
    words = re.sub(r"\\([A-Za-z]+)", r" \1", _LATEX_PREFIX.sub(r"\\\1", words))
    return f"({' '.join(words.replace('.', ' ').replace('~', ' ').split())})"


def find_unit(text: str) -> str:
    """Return the unit that a cell such as ``(mm)``, ``[µm]``, ``s``, ``N·m``, ``m s^-2`` or ``(Volts)`` names."""
    raised = _RAISED.sub(r"10^\1", without_latex(text.strip()))
    read = raised.replace("º", "°").replace("Â", "").replace("Î¼", "µ")  # Âµ and Î¼ were µ and μ
    bare = unicodedata.normalize("NFKC", _NO_WIDTH.sub("", read)).strip()  # full width, ㎜, U+00B5
    if in_brackets := bare[:1] + bare[-1:] in ("()", "[]"):
        bare = bare[1:-1].strip()
    bare = _DIRECT.sub("", bare)
    bare = above[1] if (above := _ABOVE.fullmatch(bare)) else bare.replace("deg. ", "deg ")
    if bare in _SYMBOLS:
        return bare
    if bare.startswith("_"):
        return ""  # in place of a sign that was lost, such as µ
    if bare.startswith("in ") and (unit := find_unit(bare[3:])) not in ("", "lbf", "ozf"):
        return unit  # in lbf may be a torque
    match = _TEN_TO.fullmatch(" ".join(bare.split()))
    if match and (in_brackets or match["base"][0:2] == "10"):  # without brackets, 1e-3 m is a reading
        return _with_power(int(match["power"].replace("−", "-")), find_unit(match["unit"]))
    if bare == "L":
        return ""  # L means left more often than litres
    plain = re.sub(r"(?<=[A-Za-z])[.-](?=[A-Za-z])", " ", bare.replace("**", "").translate(_SIGNS))
    over, *below = re.split(r"\s*/\s*|\s+per\s+", plain.strip().rstrip("."))
    if re.match(r"1\s", over):
        return ""  # a scale, such as 1 V/mm, by which the readings must be multiplied
    symbols: Counter[str] = Counter()
    for sign, factors in ((1, over.split()), *((-1, part.split()) for part in below)):
        for factor in factors:
            for symbol, power in _powers(_spelled(factor)).items():
                symbols[_spelled(symbol)] += sign * power
    return _known(symbols)


def _with_power(power: int, unit: str) -> str:
    """Return the unit that is a power of ten of another one; empty if there is none of that name."""
    prefix = next((letter for letter, own in _POWERS.items() if own == power), "")
    named = find_unit(prefix + unit) if prefix and unit else ""
    if not named:
        return ""
    # Some names have another meaning: m and in make a minute.
    scaled, plain = UNITS[named], UNITS[unit]
    ratio = scaled.numerator * plain.denominator / (scaled.denominator * plain.numerator)
    same = scaled.si == plain.si and scaled.shift == plain.shift == 0.0
    return named if same and math.isclose(ratio, 10.0**power, rel_tol=1e-12) else ""


def _spelled(symbol: str) -> str:
    """Return a symbol in deatwin's spelling."""
    symbol = re.sub("Ohms?$", "ohm", symbol)
    symbol = re.sub("(?<=^[munk])(?i:(v)olts?|(a)mps?)$", lambda match: match[0][0].upper(), symbol)
    word = symbol.lower()
    found = _SPELLED_OUT.get(word) or _SPELLED_OUT.get(word.removesuffix("s"))
    return found or _OTHER_SPELLINGS.get(symbol, symbol)


def _known(symbols: Counter[str]) -> str:
    """Return the name of a unit given as powers of symbols; empty if it is unknown."""

    def product(sign: int) -> str:
        factors = [(symbol, sign * power) for symbol, power in symbols.items() if sign * power > 0]
        return " ".join(symbol if power == 1 else f"{symbol}{power}" for symbol, power in factors)

    lengths = [one for one, power in symbols.items() if one in UNITS and UNITS[one].si == "m" and not power]
    if len(lengths) == len(symbols) == 1:
        return f"{lengths[0]}/{lengths[0]}"  # of a strain
    above, below = product(1), product(-1)
    whole = above if not below else f"{above or '1'}/{below}"
    whole = _OTHER_SPELLINGS.get(whole, whole)
    return whole if whole in UNITS else ""


def same_kind(first: str, second: str) -> bool:
    """Return whether two SI units measure the same kind of quantity, so that their numbers are equal.

    >>> same_kind("Hz", "1/s"), same_kind("Hz", "rad/s")
    (True, False)
    """
    return _SAME_KIND.get(first, first) == _SAME_KIND.get(second, second)
