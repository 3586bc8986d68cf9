"""Rig files in TOML: what the experimenter knows of a rig.

| section | key | range | default |
|---|---|---|---|
| film | material | text | required |
| film | thickness_mm | 0.001 to 10, before stretching | required |
| film | prestretch | 1 to 10, equal-biaxial | required |
| film | frame_diameter_mm | 1 to 1000 | required |
| film | electrode_diameter_mm | 0.1 to 1000, below the frame's | required |
| film | ball | "bonded" or "sliding" | not known: the plant's own choice |
| load | mass_g | 0 to 1000 | required |
| load | contact_diameter_mm | 0.01 to 1000, below the electrode's | required |
| drive | gain | 1 to 100000, film volts a command volt | required |
| drive | start_ramp_s, start_hold_s | 0 to 86400 | required |
| drive | command_min_V, command_max_V | -1000 to 1000, min below max | not known |
| sensor | sample_rate_Hz | 0.001 to 1000000 | required |
| sensor | noise_um | 0 to 10000, rms | required |
| sensor | resolution_um | 0 to 10000 | 0 |
| sensor | zero | "displacement at zero volts" | required |
| readings.NAME | see `deatwin.plant.rigs.rigreadings`; NAME is current, capacitance or film_voltage | | none |
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.readings import Reading
from deatwin.plant.rigs.rigkeys import RIG_KEYS
from deatwin.plant.rigs.rigmistakes import READINGS, format_errors, lines_of, mistakes_of
from deatwin.plant.rigs.rigreadings import readings_of, sections_of
from deatwin.plant.rigs.toml_hints import slip_of
from deatwin.plant.safe_read import RIG_BYTES, clipped, read_regular


@dataclass(frozen=True, kw_only=True)
class FilmSpec:
    """Film: lengths in m, `thickness` before stretching; `ball` is None if unknown."""

    material: str
    thickness: float
    prestretch: float
    frame_diameter: float
    electrode_diameter: float
    ball: str | None = None


@dataclass(frozen=True, kw_only=True)
class LoadSpec:
    """Ball at the centre: mass in kg, diameter of the contact in m."""

    mass: float
    contact_diameter: float


@dataclass(frozen=True, kw_only=True)
class DriveSpec:
    """Drive: gain in film volts per command volt, start procedure in s, range of commands in V or None."""

    gain: float
    start_ramp: float
    start_hold: float
    command_min: float | None = None
    command_max: float | None = None


@dataclass(frozen=True, kw_only=True)
class SensorSpec:
    """Sensor: sample rate in Hz, rms noise and resolution in m, and the meaning of its zero."""

    sample_rate: float
    noise: float
    zero: str
    resolution: float = 0.0


@dataclass(frozen=True, kw_only=True)
class RigFile:
    """A rig as its experimenter knows it, in SI units."""

    film: FilmSpec
    load: LoadSpec
    drive: DriveSpec
    sensor: SensorSpec
    source: str = ""  # The file that it was read from
    readings: tuple[Reading, ...] = ()  # Beside the displacement

    @staticmethod
    def from_dict(data: Mapping[str, Any], source: str = "rig") -> "RigFile":
        """Make a rig from the sections and keys of a rig file."""
        return _checked(data, source)

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Return sections, keys and values of a rig file, in its units, ready for JSON."""
        return {
            section: {
                name: key.to_file(value)
                for name, key in keys.items()
                if (value := getattr(getattr(self, section), key.field)) is not None
            }
            for section, keys in RIG_KEYS.items()
        } | ({"readings": sections_of(self.readings)} if self.readings else {})


_SPECS: Mapping[str, type] = {"film": FilmSpec, "load": LoadSpec, "drive": DriveSpec, "sensor": SensorSpec}


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
        If the file is missing or not TOML, or a key or value is wrong; the text lists all mistakes with their lines.
    """
    try:
        content = read_regular(path, RIG_BYTES, lambda fault: RigError(f"{path}: {fault}"))
        text = content.decode("utf-8-sig")
        data = tomllib.loads(text)
    except OSError as error:
        # Stricter than usual: equal endings are no likeness.
        beside = [entry.name for entry in Path(path).parent.glob("*.toml")]
        hint = nearest(Path(path).name, beside, likeness=0.8) if isinstance(error, FileNotFoundError) else ""
        raise RigError(f"{path}: the rig file cannot be read: {error.strerror}{hint}") from None
    except UnicodeDecodeError as error:
        raise RigError(f"{path}: not UTF-8 text at byte {error.start}; save the rig file as UTF-8") from None
    except RigError:
        raise
    except ValueError as error:  # TOMLDecodeError, or a whole number of thousands of digits
        raise RigError(f"{path}: not TOML: {slip_of(text) or clipped(error, 200)}") from None
    except RecursionError:
        raise RigError(f"{path}: not a rig file: lists in lists, too deep") from None
    return _checked(data, str(path), text)


def _checked(data: Mapping[str, Any], source: str, text: str = "") -> RigFile:
    """Return the rig of sections and keys; several mistakes are listed with their lines in the file's text."""
    if mistakes := mistakes_of(data):
        raise RigError(format_errors(source, mistakes, lines_of(text) if len(mistakes) > 1 else {}))
    specified = {section: _specified(section, data[section]) for section in RIG_KEYS}
    return RigFile(**specified, source=source, readings=readings_of(data.get(READINGS, {})))


def _specified(section: str, values: Mapping[str, Any]) -> Any:
    """Return the specification that a section without mistakes describes."""
    keys = RIG_KEYS[section]
    return _SPECS[section](**{keys[name].field: keys[name].to_si(value) for name, value in values.items()})
