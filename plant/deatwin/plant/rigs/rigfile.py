"""Rig files in TOML: what the experimenter knows of a rig. `deatwin.plant.rigs.rigkinds` has the keys of each kind."""

import logging
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.plant.arguments import file_name, taking
from deatwin.plant.errors import RigError
from deatwin.plant.readings import Reading
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.rigs.rigkeys import DIRECTIONS
from deatwin.plant.rigs.rigkinds import KINDS
from deatwin.plant.rigs.rigmaterial import read_material
from deatwin.plant.rigs.rigmistakes import READINGS, Mistake, format_errors, lines_of, mistakes_of, remarks_of
from deatwin.plant.rigs.rigreadings import readings_of
from deatwin.plant.rigs.tomlfile import TomlFile
from deatwin.plant.substance import Material
from deatwin.plant.supply import Supply

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class DriveSpec:
    """Gain in film volts per command volt, start procedure in s (unless unknown), and range of commands in V or None."""

    gain: float = 1.0
    start_ramp: float = 0.0
    start_hold: float = 0.0
    start_is_known: bool = True
    command_min: float | None = None
    command_max: float | None = None
    unit: str = "V"  # Unit of the commands
    supply: Supply | None = None

    @property
    def command_range(self) -> tuple[float, float] | None:
        """Lowest and highest command, V; None unless both are known."""
        low, high = self.command_min, self.command_max
        return None if low is None or high is None else (low, high)


@dataclass(frozen=True, kw_only=True)
class SensorSpec:
    """Sample rate in Hz, rms noise, resolution and model error in m, meaning of zero, direction, and time of reading."""

    sample_rate: float
    noise: float
    resolution: float = 0.0
    model_error: float | None = None
    zero_is_known: bool = True
    direction: str = next(iter(DIRECTIONS))
    reading: str = ReadingTime.END_OF_HOLD.value


@dataclass(frozen=True, kw_only=True)
class RigFile:
    """Knowledge of an experimenter about a rig, in SI units."""

    kind: str
    material: str | Material  # Name of a published material, or the material of the section [material]
    film: Mapping[str, Any]  # Values of the section [film], by the field of their keys
    load: Mapping[str, Any]  # Values of the section [load], likewise
    drive: DriveSpec
    sensor: SensorSpec
    stated: Mapping[str, Any]  # Sections, keys and values as the file has them
    source: str = ""  # File from which it was read
    readings: tuple[Reading, ...] = ()  # Readings besides the first

    @staticmethod
    def from_dict(data: Mapping[str, Any], source: str = "rig") -> "RigFile":
        """Read sections and keys of a rig file."""
        return _checked(data, source)

    @staticmethod
    def of(file: TomlFile) -> "RigFile":
        """Read a rig from a parsed file; the error lists all mistakes with their lines, a warning each unusual value."""
        data = _with_material(file.data, Path(file.path).parent)
        rig = _checked(data, file.path, file.text)
        _tell_unusual(data, file.path)
        return rig

    def to_dict(self) -> dict[str, Any]:
        """Return sections, keys and values of the rig file, in its units, for JSON."""
        return deepcopy(dict(self.stated))

    @property
    def shared(self) -> dict[str, Any]:
        """Return the fields that rigs of every kind take from a rig file, by name."""
        drive, sensor = self.drive, self.sensor
        return {
            "material": self.material,
            "gain": drive.gain,
            "start_ramp": drive.start_ramp,
            "start_hold": drive.start_hold,
            "start_is_known": drive.start_is_known,
            "zero_is_known": sensor.zero_is_known,
            "command_range": drive.command_range,
            "direction": DIRECTIONS[sensor.direction],
            "reading": ReadingTime(sensor.reading),
            "sample_time": 1 / sensor.sample_rate,
            "further": self.readings,
            "supply": drive.supply,
            "noise": float(np.hypot(sensor.noise, sensor.resolution / np.sqrt(12))),
            **({} if sensor.model_error is None else {"model_error": sensor.model_error}),
        }

    @property
    def widest(self) -> float:
        """Longest dimension of the film, m, which no reading of a position exceeds."""
        if KINDS[self.kind].units[1] != "m":
            return float("inf")
        known = {"frame_diameter": 1.0, "frame_radius": 2.0, "length": 10.0, "width": 10.0}
        sizes = [factor * self.film[name] for name, factor in known.items() if name in self.film]
        return max(sizes, default=float("inf"))


@taking(path=file_name)
def read_rig(path: str | Path) -> RigFile:
    """Read a rig file.

    Parameters
    ----------
    path : str or Path
        TOML file; the page "Your own rig file" explains its sections and keys.

    Returns
    -------
    RigFile
        Content of the rig file in SI units.

    Raises
    ------
    RigError
        If the file is missing or not TOML, or if a key or a value is wrong; the message lists all mistakes, with their
        lines.
    """
    return RigFile.of(TomlFile.read(path))


@taking(path=file_name)
def load_material(path: str | Path) -> Material:
    """Read a material from a file with a section ``[material]``.

    Parameters
    ----------
    path : str or Path
        TOML file from the command ``deatwin material``, or a rig file with a section ``[material]``.

    Returns
    -------
    Material
        The material, for the argument `material` of a rig.

    Raises
    ------
    RigError
        If the file is missing or not TOML, or if it has no section ``[material]`` or one with mistakes.
    """
    file = TomlFile.read(path, "material file")
    found = _material_of(file)
    _tell_unusual({"material": file.data["material"]}, file.path)
    return found


def _tell_unusual(data: Mapping[str, Any], source: str) -> None:
    for remark in remarks_of(data):
        logger.warning("%s, %s: %s", source, remark.where, remark.text)


def _material_of(file: TomlFile) -> Material:
    if "material" not in file.data:
        raise RigError(f"{file.path}: this is not a material file: it has no section [material]")
    found, mistakes = read_material(file.data["material"])
    if found is None:
        places = [Mistake(text=said, at=("material", *at)) for at, said in mistakes]
        raise RigError(format_errors(file.path, places, lines_of(file.text)))
    return found


def _with_material(data: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """Return a rig file that includes the section of its material file."""
    film = data.get("film")
    named = film.get("material") if isinstance(film, Mapping) else None
    if film is None or not isinstance(named, str) or not named.endswith(".toml") or "material" in data:
        return data
    file = TomlFile.read(folder / named, "material file")
    _material_of(file)
    rest = {key: value for key, value in film.items() if key != "material"}
    return {**data, "film": rest, "material": file.data["material"]}


def _checked(data: Mapping[str, Any], source: str, text: str = "") -> RigFile:
    """Make a rig from sections and keys; mistakes are listed with their lines."""
    if mistakes := mistakes_of(data):
        raise RigError(format_errors(source, mistakes, lines_of(text)))
    kind = KINDS[data.get("kind", "diaphragm")]
    values: dict[str, dict[str, Any]] = {
        section: {key.field: kind.absent[key.field] for key in keys.values() if key.field in kind.absent}
        | {keys[name].field: keys[name].to_si(value) for name, value in data.get(section, {}).items()}
        for section, keys in kind.sections.items()
    }
    film, load, drive, sensor = (values.get(section, {}) for section in ("film", "load", "drive", "sensor"))
    own, _ = read_material(data["material"]) if "material" in data else (None, [])
    drive.pop("input", None)
    limits = {field.name: drive.pop(field.name) for field in fields(Supply) if field.name in drive}
    return RigFile(
        kind=data.get("kind", "diaphragm"),
        material=own or film.pop("material"),
        film=film,
        load=load,
        drive=DriveSpec(
            **{n: v for n, v in drive.items() if n != "start"},
            start_is_known="start" not in drive,
            unit=kind.units[0],
            supply=Supply(**limits) if limits else None,
        ),
        sensor=SensorSpec(
            **{n: v for n, v in sensor.items() if n != "zero"}, zero_is_known=sensor.get("zero") != "arbitrary"
        ),
        stated=deepcopy(dict(data)),
        source=source,
        readings=readings_of(data.get(READINGS, {})),
    )
