"""Keys of a rig file: one table serves to read them, write them, and make their JSON Schema."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, log
from typing import Any

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


# Units in which a value may have been given by mistake, with factor and shift to the file's unit.
_MM = (("in m", 1e3, 0.0), ("in µm", 1e-3, 0.0))
_UM = (("in mm", 1e3, 0.0), ("in nm", 1e-3, 0.0), ("in m", 1e6, 0.0))
_G = (("in kg", 1e3, 0.0), ("in mg", 1e-3, 0.0))
_KV = (("in kV a volt", 1e3, 0.0),)
_MS = (("in ms", 1e-3, 0.0),)
_MV = (("in mV", 1e-3, 0.0),)
_UA = (("in A", 1e6, 0.0), ("in mA", 1e3, 0.0))
_MOHM = (("in ohm", 1e-6, 0.0), ("in kohm", 1e-3, 0.0), ("in Gohm", 1e3, 0.0))
_PF = (("in F", 1e12, 0.0), ("in µF", 1e6, 0.0), ("in nF", 1e3, 0.0))
_MN = (("in N", 1e3, 0.0), ("in µN", 1e-3, 0.0))
_N = (("in mN", 1e-3, 0.0),)
_STRETCH = (("a strain", 1.0, 1.0), ("a strain in %", 0.01, 1.0))

HIGHEST_FILM_VOLTAGE = 30e3  # V; no amplifier for these actuators gives more

_CURRENTS = (2.0, 1e6)  # µA
_RESOLVED = (5e-3, 300.0)  # µm
_EQUATIONS = (
    "rms error of the readings that simplified equations leave after a calibration; that of the kind if left out"
)
Keys = Mapping[str, NumberKey | TextKey]
MATERIAL = TextKey(
    field="material",
    about="a name in the table of materials, or a material file (.toml) beside this one",
    instead="[material]",
)
THICKNESS = NumberKey(
    field="thickness", lower=0.001, upper=10.0, per_si=1e3, usual=(0.005, 5.0), slips=_MM, about="before stretching"
)
PRESTRETCH = NumberKey(
    field="prestretch",
    lower=1.0,
    upper=10.0,
    slips=_STRETCH,
    about="equal-biaxial: a stretch, so 350 % of strain is 4.5",
)
DRIVE: Keys = {
    "gain": NumberKey(
        field="gain",
        lower=1.0,
        upper=1e5,
        usual=(20.0, 2e4),
        slips=_KV,
        about="film volts a command volt",
        instead="input",
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
    "start_ramp_s": NumberKey(
        field="start_ramp",
        lower=0.0,
        upper=86400.0,
        usual=(0.0, 900.0),
        slips=_MS,
        about="before time 0 the first command was ramped up from 0 V in this time, 0 if the film rested at 0 V",
        instead="start",
    ),
    "start_hold_s": NumberKey(
        field="start_hold",
        lower=0.0,
        upper=86400.0,
        slips=_MS,
        about="and held for this time, 0 if the film rested at 0 V",
        instead="start",
    ),
    "command_min_V": NumberKey(
        field="command_min", lower=-1e5, upper=1e5, required=False, slips=_MV, about="what the drive may give"
    ),
    "command_max_V": NumberKey(
        field="command_max", lower=-1e5, upper=1e5, required=False, slips=_MV, about="what the drive may give"
    ),
    "current_limit_uA": NumberKey(
        field="current_limit",
        lower=1e-3,
        upper=1e9,
        per_si=1e6,
        required=False,
        usual=_CURRENTS,
        slips=_UA,
        about="largest current into the film",
    ),
    "sink_current_uA": NumberKey(
        field="sink_current",
        lower=0.0,
        upper=1e9,
        per_si=1e6,
        required=False,
        usual=_CURRENTS,
        slips=_UA,
        about="largest current out of it: 0 for a converter that cannot sink; the limit above if left out",
    ),
    **{
        f"{field}_Mohm": NumberKey(
            field=field, lower=lower, upper=upper, per_si=1e-6, required=False, usual=usual, slips=_MOHM, about=about
        )
        for field, lower, upper, usual, about in (
            # 1 nF behind the largest one would charge in 10 s.
            ("series_resistance", 1e-6, 1e4, (1e-5, 1e4), "between drive and film"),
            ("bleed_resistance", 1e-3, 1e6, (2.0, 1e6), "across the film"),
        )
    },
    "parallel_capacitance_pF": NumberKey(
        field="parallel_capacitance",
        lower=0.0,
        upper=1e9,
        per_si=1e12,
        required=False,
        usual=(0.1, 1e7),
        slips=_PF,
        about="across the film",
    ),
}
AGAINST = "against the motion"
DIRECTIONS = {"along the motion": 1.0, AGAINST: -1.0}  # Sign of the motion in the reading, by the text in the file
SENSOR: Keys = {
    "sample_rate_Hz": NumberKey(
        field="sample_rate", lower=1e-3, upper=1e6, usual=(0.1, 1e5), about="of the recordings"
    ),
    "noise_um": NumberKey(field="noise", lower=0.0, upper=1e4, per_si=1e6, usual=_RESOLVED, slips=_UM, about="rms"),
    "resolution_um": NumberKey(
        field="resolution",
        lower=0.0,
        upper=1e4,
        per_si=1e6,
        required=False,
        usual=_RESOLVED,
        slips=_UM,
        about="0 if left out",
    ),
    "model_error_um": NumberKey(
        field="model_error", lower=0.0, upper=1e4, per_si=1e6, required=False, slips=_UM, about=_EQUATIONS
    ),
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
    name: NumberKey(
        field=field, lower=0.1, upper=20.0, required=False, slips=_STRETCH, about="what the machine may give"
    )
    for name, field in (("stretch_min", "command_min"), ("stretch_max", "command_max"))
}
LOAD_CELL: Keys = {
    "sample_rate_Hz": SENSOR["sample_rate_Hz"],
    "noise_mN": NumberKey(field="noise", lower=0.0, upper=1e6, per_si=1e3, usual=(0.01, 1e3), slips=_MN, about="rms"),
    "resolution_mN": NumberKey(
        field="resolution",
        lower=0.0,
        upper=1e6,
        per_si=1e3,
        required=False,
        usual=(1e-3, 1e3),
        slips=_MN,
        about="0 if left out",
    ),
    "model_error_mN": NumberKey(
        field="model_error", lower=0.0, upper=1e6, per_si=1e3, required=False, slips=_MN, about=_EQUATIONS
    ),
}


def length(
    field: str,
    about: str,
    *,
    lower: float = 0.01,
    upper: float = 1e3,
    per_si: float = 1e3,
    required: bool = True,
    usual: tuple[float, float] = (0.5, 500.0),
) -> NumberKey:
    """Make the key of a length in mm; a diameter that the rig stores as a radius has 2000 of them per SI unit."""
    return NumberKey(
        field=field, lower=lower, upper=upper, per_si=per_si, required=required, usual=usual, slips=_MM, about=about
    )


def mass(
    about: str, *, lower: float = 0.0, required: bool = False, usual: tuple[float, float] = (0.2, 1e3)
) -> NumberKey:
    """Make the key of a mass in g."""
    return NumberKey(
        field="mass", lower=lower, upper=1e3, per_si=1e3, required=required, usual=usual, slips=_G, about=about
    )


def force(field: str, about: str, *, lower: float = -1e3) -> NumberKey:
    """Make the key of a force in N, which may be left out."""
    return NumberKey(field=field, lower=lower, upper=1e3, required=False, usual=(1e-3, 200.0), slips=_N, about=about)


def spring_rate(about: str, *, lower: float, required: bool = True) -> NumberKey:
    """Make the key of a stiffness in N/m."""
    return NumberKey(
        field="spring_rate",
        lower=lower,
        upper=1e6,
        required=required,
        usual=(2.0, 1e5),
        slips=(("in N/mm", 1e3, 0.0),),
        about=about,
    )


def stretch(field: str, about: str, *, lower: float = 0.1, required: bool = True) -> NumberKey:
    """Make the key of a second stretch."""
    return NumberKey(field=field, lower=lower, upper=10.0, required=required, slips=_STRETCH, about=about)


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
    return {"type": "string", **({"enum": list(key.choices)} if key.choices else {"pattern": r"\S"}), **about}
