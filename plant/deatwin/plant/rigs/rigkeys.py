"""Keys of a rig file: one table serves to read them, write them, and make their JSON Schema."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, log
from typing import Any

from deatwin.plant.material import MATERIALS
from deatwin.plant.published import UNKNOWN
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.safe_read import clipped


@dataclass(frozen=True, kw_only=True)
class NumberKey:
    """A key whose value is a number."""

    field: str
    lower: float  # Lower end of the range, included, in the file's unit
    upper: float  # Upper end, likewise
    per_si: float = 1.0  # File units in one SI unit
    whole: bool = False  # True if only whole numbers are allowed
    required: bool = True  # True if the key must be present
    usual: tuple[float, float] = (0.0, inf)  # Sizes without sign; any other is read with a warning
    slips: tuple[tuple[str, float, float], ...] = ()  # Other units, with factor and shift to the file's unit
    about: str = ""
    instead: str = ""  # Key of the section that may replace this one

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        return f"a {'whole ' if self.whole else ''}number from {self.lower:g} to {self.upper:g}"

    def fault(self, value: object) -> str:
        """Describe the fault of a value and what is allowed; empty if there is none."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return f"{_toml(value)} is {kind_of(value)}; it must be {self.allowed}"
        if not self.lower <= value <= self.upper:  # true for NaN, too
            return f"{_toml(value)} is out of range; it must be from {self.lower:g} to {self.upper:g}{self.slip(value)}"
        return f"{_toml(value)} is not whole; it must be {self.allowed}" if self.whole and value % 1 else ""

    def remark(self, value: float) -> str:
        """Describe an allowed value that such devices hardly have; empty for a usual one and for zero."""
        if not value or self._is_usual(value):
            return ""
        low, high = self.usual
        usual = f"{low:g} to {high:g}" if low and high < inf else f"{low:g} or more" if low else f"at most {high:g}"
        return f"{value:g} is unusual; most are {usual}{self.slip(value)}"

    def to_si(self, value: float) -> float:
        """Convert a value of the file to SI."""
        return value / self.per_si

    def _is_usual(self, value: float) -> bool:
        return self.usual[0] <= abs(value) <= self.usual[1]

    def slip(self, value: float) -> str:
        """Suggest a value in another unit if that would be usual, such as 0.5 for 0.0005 m in mm: the most usual one."""
        meant = {}
        for unit, factor, shift in self.slips if 0.0 < abs(value) < 1e12 else ():
            size = float(f"{value * factor + shift:.6g}")
            if self.lower <= size <= self.upper and self._is_usual(size):
                meant[unit] = size
        low, high = self.usual
        known = 0.0 < low and high < inf
        best = min(meant, key=lambda unit: abs(log(meant[unit] ** 2 / (low * high))) if known else 0.0, default="")
        return f"; if that is {best}, write {meant[best]:g}" if best else ""


@dataclass(frozen=True, kw_only=True)
class TextKey:
    """A key whose value is a text."""

    field: str
    choices: tuple[str, ...] = ()  # Allowed texts; any text if empty
    pattern: str = r"\S"  # Regular expression of the schema for allowed texts, if there are no choices
    required: bool = True  # True if the key must be present
    about: str = ""
    instead: str = ""  # Key of the section, or ``[section]``, that may replace this one

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        return " or ".join(f'"{choice}"' for choice in self.choices) or "text in quotes"

    def fault(self, value: object) -> str:
        """Describe the fault of a value and what is allowed; empty if there is none."""
        if not isinstance(value, str):
            return f"{_toml(value)} is {kind_of(value)}; it must be {self.allowed}"
        if self.choices and value not in self.choices:
            return f"{_toml(value)} is not known; it must be {self.allowed}"
        return "" if value.strip() else "the text is empty"

    def to_si(self, value: str) -> str:
        """Return the value of a file, which is the same in SI."""
        return value


Keys = Mapping[str, NumberKey | TextKey]
_UNITS: Mapping[str, tuple[float, tuple[tuple[str, float, float], ...]]] = {
    "mm": (1e3, (("in m", 1e3, 0.0), ("in µm", 1e-3, 0.0))),
    "um": (1e6, (("in mm", 1e3, 0.0), ("in nm", 1e-3, 0.0), ("in m", 1e6, 0.0))),
    "mm2": (1e6, (("in m²", 1e6, 0.0),)),
    "g": (1e3, (("in kg", 1e3, 0.0), ("in mg", 1e-3, 0.0))),
    "s": (1.0, (("in ms", 1e-3, 0.0),)),
    "V": (1.0, (("in mV", 1e-3, 0.0),)),
    "film volts a volt": (1.0, (("in kV a volt", 1e3, 0.0),)),
    "uA": (1e6, (("in A", 1e6, 0.0), ("in mA", 1e3, 0.0))),
    "Mohm": (1e-6, (("in ohm", 1e-6, 0.0), ("in kohm", 1e-3, 0.0), ("in Gohm", 1e3, 0.0))),
    "pF": (1e12, (("in F", 1e12, 0.0), ("in µF", 1e6, 0.0), ("in nF", 1e3, 0.0))),
    "N": (1.0, (("in mN", 1e-3, 0.0),)),
    "mN": (1e3, (("in N", 1e3, 0.0), ("in µN", 1e-3, 0.0))),
    "N/m": (1.0, (("in N/mm", 1e3, 0.0),)),
    "kPa": (1e-3, (("in Pa", 1e-3, 0.0), ("in bar", 1e2, 0.0), ("in MPa", 1e3, 0.0))),
    "stretch": (1.0, (("a strain", 1.0, 1.0), ("a strain in %", 0.01, 1.0))),
}
"""How many units make one in SI, and other units that may be meant, with factor and shift to this unit."""


def number(field: str, lower: float, upper: float, about: str, *, unit: str, **more: Any) -> NumberKey:
    """Make the key of a number in one of `_UNITS`."""
    per_si, slips = _UNITS[unit]
    return NumberKey(field=field, lower=lower, upper=upper, about=about, slips=slips, **{"per_si": per_si, **more})


def length(
    field: str, about: str, *, lower: float = 0.01, upper: float = 1e3, usual: Any = (0.5, 500.0), **more: Any
) -> NumberKey:
    """Make the key of a length in mm; a diameter that the rig stores as a radius has 2000 of them per SI unit."""
    return number(field, lower, upper, about, unit="mm", usual=usual, **more)


def mass(about: str, *, lower: float = 0.0, required: bool = False, usual: Any = (0.2, 1e3)) -> NumberKey:
    """Make the key of a mass in g."""
    return number("mass", lower, 1e3, about, unit="g", required=required, usual=usual)


def force(field: str, about: str, *, lower: float = -1e3) -> NumberKey:
    """Make the key of a force in N, which may be left out."""
    return number(field, lower, 1e3, about, unit="N", required=False, usual=(1e-3, 200.0))


def spring_rate(about: str, *, lower: float, required: bool = True) -> NumberKey:
    """Make the key of a stiffness in N/m."""
    return number("spring_rate", lower, 1e6, about, unit="N/m", required=required, usual=(2.0, 1e5))


def stretch(field: str, about: str, *, lower: float = 0.1, required: bool = True) -> NumberKey:
    """Make the key of a second stretch."""
    return number(field, lower, 10.0, about, unit="stretch", required=required)


HIGHEST_FILM_VOLTAGE = 30e3  # V; no amplifier for these actuators gives more
_CURRENTS = (2.0, 1e6)  # µA
_RESOLVED = (5e-3, 300.0)  # µm
_COMMANDS = "what the drive may give"
_EQUATIONS = (
    "rms error of the readings that simplified equations leave after a calibration; that of the kind if left out"
)
_ENERGIES = ("".join("[-_ ]" if c == "_" else f"[{c}{c.upper()}]" for c in name) for name in UNKNOWN)
MATERIAL = TextKey(
    field="material",
    pattern=rf"^(?:{'|'.join((*MATERIALS, *_ENERGIES))})$|\.toml$",
    about="a name in the table of materials, or a material file (.toml) beside this one",
    instead="[material]",
)
THICKNESS = length("thickness", "before stretching", lower=0.001, upper=10.0, usual=(0.005, 5.0))
PRESTRETCH = stretch("prestretch", "equal-biaxial: a stretch, so 350 % of strain is 4.5", lower=1.0)
_LIMITS: Keys = {
    f"{field}_{unit}": number(field, lower, upper, about, unit=unit, required=False, usual=usual)
    for field, unit, lower, upper, usual, about in (
        ("current_limit", "uA", 1e-3, 1e9, _CURRENTS, "largest current into the film"),
        (
            "sink_current",
            "uA",
            0.0,
            1e9,
            _CURRENTS,
            "largest current out of it: 0 for a converter that cannot sink; the limit above if left out",
        ),
        # 1 nF behind the largest one would charge in 10 s.
        ("series_resistance", "Mohm", 1e-6, 1e4, (1e-5, 1e4), "between drive and film"),
        ("bleed_resistance", "Mohm", 1e-3, 1e6, (2.0, 1e6), "across the film"),
        ("parallel_capacitance", "pF", 0.0, 1e9, (0.1, 1e7), "across the film"),
    )
}
DRIVE: Keys = {
    "gain": number(
        "gain", 1.0, 1e5, "film volts a command volt", unit="film volts a volt", usual=(20.0, 2e4), instead="input"
    ),
    "input": TextKey(
        field="input",
        choices=("film voltage",),
        required=False,
        about="instead of gain, where the recordings hold the voltage of the film itself",
    ),
    "start": TextKey(
        field="start",
        choices=("unknown",),
        required=False,
        about="instead of the two keys below, if the film's history before the first sample is unknown",
    ),
    "start_ramp_s": number(
        "start_ramp",
        0.0,
        86400.0,
        "before time 0 the first command was ramped up from 0 V in this time, 0 if the film rested at 0 V",
        unit="s",
        usual=(0.0, 900.0),
        instead="start",
    ),
    "start_hold_s": number(
        "start_hold", 0.0, 86400.0, "and held for this time, 0 if the film rested at 0 V", unit="s", instead="start"
    ),
    "command_min_V": number("command_min", -1e5, 1e5, _COMMANDS, unit="V", required=False),
    "command_max_V": number("command_max", -1e5, 1e5, _COMMANDS, unit="V", required=False),
    **_LIMITS,
}
AGAINST = "against the motion"
DIRECTIONS = {"along the motion": 1.0, AGAINST: -1.0}  # Sign of the motion in the reading, by the text in the file
SENSOR: Keys = {
    "sample_rate_Hz": NumberKey(
        field="sample_rate", lower=1e-3, upper=1e6, usual=(0.1, 1e5), about="of the recordings"
    ),
    "noise_um": number("noise", 0.0, 1e4, "rms", unit="um", usual=_RESOLVED),
    "resolution_um": number("resolution", 0.0, 1e4, "0 if left out", unit="um", required=False, usual=_RESOLVED),
    "model_error_um": number("model_error", 0.0, 1e4, _EQUATIONS, unit="um", required=False),
    "zero": TextKey(
        field="zero",
        choices=("displacement at zero volts", "arbitrary"),
        about="of the readings: near 0 without voltage, or anywhere",
    ),
    "direction": TextKey(
        field="direction",
        choices=tuple(DIRECTIONS),
        required=False,
        about="whether the readings grow with the motion that voltage causes, or fall; along the motion if left out",
    ),
    "reading": TextKey(
        field="reading",
        choices=tuple(taken.value for taken in ReadingTime),
        required=False,
        about="start of hold if the program reads the sensor before it sets the command of the row, or a logger samples both "
        "at once; end of hold if it reads just before the next command; or that the reading is the mean over the hold; end "
        "of hold if left out",
    ),
}
PULL: Keys = {
    f"stretch_{end}": number(f"command_{end}", 0.1, 20.0, "what the machine may give", unit="stretch", required=False)
    for end in ("min", "max")
}
LOAD_CELL: Keys = {
    "sample_rate_Hz": SENSOR["sample_rate_Hz"],
    "noise_mN": number("noise", 0.0, 1e6, "rms", unit="mN", usual=(0.01, 1e3)),
    "resolution_mN": number("resolution", 0.0, 1e6, "0 if left out", unit="mN", required=False, usual=(1e-3, 1e3)),
    "model_error_mN": number("model_error", 0.0, 1e6, _EQUATIONS, unit="mN", required=False),
}


def kind_of(value: object) -> str:
    """Return TOML's name for the type of a value."""
    kinds = {bool: "a truth value", int: "a number", float: "a number", str: "text", list: "a list", dict: "a table"}
    return kinds.get(type(value), "a date or time")


def _toml(value: object) -> str:
    """Write a value as in a TOML file, approximately, for an error text."""
    text = str(value)
    if isinstance(value, bool):
        return text.lower()
    return f'"{clipped(text)}"' if isinstance(value, str) else clipped(text)


def key_schema(key: NumberKey | TextKey) -> dict[str, Any]:
    """Return the schema of a key's value."""
    about = {"description": key.about} if key.about else {}
    if isinstance(key, NumberKey):
        return {"type": "integer" if key.whole else "number", "minimum": key.lower, "maximum": key.upper, **about}
    return {"type": "string", **({"enum": list(key.choices)} if key.choices else {"pattern": key.pattern}), **about}
