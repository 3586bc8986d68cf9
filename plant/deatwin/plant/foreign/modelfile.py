"""Model files in TOML, which name an FMU or a Python function as a plant (docs/how-to/foreign-models.md)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.arguments import file_name, taking
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.errors import DeatwinError, RigError, nearest
from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.foreign.calls import Model
from deatwin.plant.foreign.fmu import KINDS, FmuModel, declared_units, parameter_of
from deatwin.plant.foreign.rig import ForeignRig
from deatwin.plant.imported import imported
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.rigs.tomlfile import TomlFile
from deatwin.plant.safe_read import clipped

KEYS: Mapping[str, tuple[str, ...]] = {
    "model": ("file", "function", "kind"),
    "input": ("name", "unit", "size", "rest"),
    "output": ("name", "unit", "size", "noise"),
    "time": ("sample_rate_Hz", "period_s", "reading"),
}
OF_PARAMETER = ("value", "lower", "upper", "unit", "logarithmic", "known", "varying")


@taking(path=file_name)
def read_model_file(path: str | os.PathLike[str]) -> Plant:
    """Return the plant that a model file describes: a model written elsewhere, with its input, output and parameters.

    Parameters
    ----------
    path : str or PathLike
        Model file, in TOML; the page "Models written elsewhere" explains its sections and keys.

    Raises
    ------
    RigError
        If the model file or the model itself cannot be read, or a key of the model file is missing, unknown or wrong.
    """
    return ModelFile.of(TomlFile.read(path, "model file")).read()


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """The content of a model file."""

    path: Path
    data: Mapping[str, Any]

    @classmethod
    def of(cls, file: TomlFile) -> ModelFile:
        """Make it from a file that was already read."""
        return cls(path=Path(file.path), data=file.data)

    @classmethod
    def beside(cls, fmu: Path) -> ModelFile:
        """Read the model file next to an FMU."""
        path = fmu.with_suffix(".toml")
        if not path.is_file():
            raise RigError(
                f"{fmu}: an FMU needs a file {path.name} in the same folder, which names input, output and parameters; "
                f"the page on models written elsewhere shows one"
            )
        return cls.of(TomlFile.read(path, "model file"))

    def read(self) -> Plant:
        """Make the plant; errors name the file."""
        try:
            return self._plant()
        except DeatwinError as error:
            said = str(error)
            raise RigError(said if said.startswith(str(self.path)) else f"{self.path}: {said}") from error

    def _plant(self) -> Plant:
        self._require_known()
        reading = self._reading()
        command, read = self._text("input", "name"), self._text("output", "name")
        channels = tuple((name, self._number("channels", name)) for name in self._section("channels", required=False))
        units = {self._text(s, "name"): self._text(s, "unit", "") for s in ("input", "output")}
        model: Model
        fmu = None
        if "file" in self._section("model"):
            fmu = model = FmuModel.of(
                self.path.parent / self._text("model", "file"),
                inputs=(command, *(name for name, _ in channels)),
                output=read,
                kind=self._text("model", "kind", "", tuple(KINDS)) or None,
                reading=reading,
                units={name: unit for name, unit in units.items() if unit},
            )
            shown = {name: fmu.si_unit(name) for name in units}
            units = dict(fmu.units)
        else:
            model = imported(self._text("model", "function"))
            units = {self._text(s, "name"): self._text(s, "unit") for s in ("input", "output")}
            shown = units
        of_command, of_reading = (_Converted(fmu is not None, units[name]) for name in (command, read))
        return Plant(
            rig=ForeignRig(
                model=model,
                parameters=tuple(self._parameter(name, fmu) for name in self._section("parameters", required=False)),
                varying=tuple(
                    name
                    for name in self._section("parameters", required=False)
                    if self._flag(f"parameters.{name}", "varying")
                ),
                sizes=Sizes(
                    motion=of_reading.width(self._above_zero("output", "size")),
                    motion_unit=shown[read],
                    command=of_command.width(self._above_zero("input", "size")),
                    command_unit=shown[command],
                    period=self._above_zero("time", "period_s"),
                ),
                sample_time=1 / self._above_zero("time", "sample_rate_Hz"),
                noise=of_reading.width(self._number("output", "noise")),
                reading=reading,
                input_name=command,
                input_unit=shown[command],
                output_name=read,
                output_unit=shown[read],
                rest_command=of_command.value(self._number("input", "rest", 0.0)),
                channels=channels,
            )
        )

    def _require_known(self) -> None:
        for name in self.data:
            if name not in (*KEYS, "parameters", "channels"):
                raise RigError(f"[{clipped(name)}] is no section of a model file{nearest(name, (*KEYS, 'parameters'))}")
        for section, keys in KEYS.items():
            for key in self._section(section):
                if key not in keys:
                    raise RigError(f"[{section}] {clipped(key)} is no key of a model file{nearest(key, keys)}")
        for name in self._section("parameters", required=False):
            for key in self._section(f"parameters.{name}"):
                if key not in OF_PARAMETER:
                    raise RigError(f"[parameters.{name}] {clipped(key)} is no key{nearest(key, OF_PARAMETER)}")
        if len({"file", "function"} & self._section("model").keys()) != 1:
            raise RigError("[model] needs either file, an FMU, or function, module:function")

    def _reading(self) -> ReadingTime:
        choices = tuple(one.value for one in ReadingTime)
        return ReadingTime(self._text("time", "reading", ReadingTime.END_OF_HOLD.value, choices))

    def _parameter(self, name: str, fmu: FmuModel | None) -> Parameter:
        at = f"parameters.{name}"
        start = lower = upper = None
        unit = "1"
        if fmu is not None:
            declared = parameter_of(fmu, name)
            start, lower, upper = (
                None if x is None else float(x) for x in (declared.start, declared.min, declared.max)
            )
            unit = declared_units(fmu.path, fmu.digest)[name] or "1"
            if self._flag(at, "varying") and declared.variability != "tunable":
                raise RigError(f"[{at}] varying: the FMU says that it is {declared.variability}, not tunable")
        logarithmic = self._flag(at, "logarithmic")
        return Parameter(
            name=name,
            value=self._number(at, "value", start),
            lower=self._number(at, "lower", lower),
            upper=self._number(at, "upper", upper),
            unit=self._text(at, "unit", unit),
            scale=Scale.LOGARITHMIC if logarithmic else Scale.LINEAR,
            known=self._flag(at, "known"),
            source=self.path.name,
        )

    def _section(self, name: str, *, required: bool = True) -> Mapping[str, Any]:
        found: Any = self.data
        for part in name.split(".", 1):
            found = found.get(part)
            if found is None and not required:
                return {}
            if not isinstance(found, Mapping):
                raise RigError(
                    f"the section [{clipped(name)}] is missing" if found is None else f"[{name}] is no table"
                )
        return found

    def _number(self, section: str, key: str, default: float | None = None) -> float:
        value = self._section(section).get(key, default)
        if value is None:
            raise RigError(f"[{section}] {key} is missing: give a number")
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < float("inf"):
            raise RigError(f"[{section}] {key} = {clipped(value)}; it must be a number")
        return float(value)

    def _above_zero(self, section: str, key: str) -> float:
        if not (value := self._number(section, key)) > 0:
            raise RigError(f"[{section}] {key} = {value:g}; it must be above 0")
        return value

    def _flag(self, section: str, key: str) -> bool:
        value = self._section(section).get(key, False)
        if not isinstance(value, bool):
            raise RigError(f"[{section}] {key} = {clipped(value)}; it must be true or false")
        return value

    def _text(self, section: str, key: str, default: str | None = None, choices: tuple[str, ...] = ()) -> str:
        value = self._section(section).get(key, default)
        if value is None:
            raise RigError(f"[{section}] {key} is missing: give text in quotes")
        if not isinstance(value, str) or (choices and value and value not in choices):
            allowed = " or ".join(f'"{c}"' for c in choices) or "text in quotes"
            raise RigError(f"[{section}] {key} = {clipped(value)}; it must be {allowed}")
        return value


@dataclass(frozen=True)
class _Converted:
    """Convert a file's numbers from an FMU variable's unit to SI; those of a function are unchanged."""

    converts: bool
    unit: str

    def width(self, value: float) -> float:
        unit = UNITS[find_unit(self.unit)]
        return value * unit.numerator / unit.denominator if self.converts else value

    def value(self, number: float) -> float:
        return float(UNITS[find_unit(self.unit)].to_si(np.array(number))) if self.converts else number
