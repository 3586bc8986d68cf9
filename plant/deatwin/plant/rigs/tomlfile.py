"""TOML files of users: rig files, and files that name a model written elsewhere."""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.rigs.toml_hints import slip_of
from deatwin.plant.safe_read import RIG_BYTES, clipped, read_regular


@dataclass(frozen=True, kw_only=True)
class TomlFile:
    """A TOML file, parsed but not yet checked."""

    path: str
    text: str
    data: Mapping[str, Any]

    @classmethod
    def read(cls, path: str | os.PathLike[str], what: str = "rig file") -> "TomlFile":
        """Read a file; error texts call it `what`."""
        try:
            text = read_regular(path, RIG_BYTES, lambda fault: RigError(f"{path}: {fault}")).decode("utf-8-sig")
            text = text.replace("\r\n", "\n").replace("\r", "\n")
            data = tomllib.loads(text)
            if (
                '"""' not in text and _has_marks(data) and (slip := slip_of(text))
            ):  # a path such as "C:\new", in which \n ends a line
                raise RigError(f"{path}: {slip}")
            return cls(path=str(path), text=text, data=data)
        except OSError as error:
            # Stricter than usual, because all candidates have the same ending.
            beside = [entry.name for entry in Path(path).parent.glob("*.toml")]
            hint = nearest(Path(path).name, beside, likeness=0.8) if isinstance(error, FileNotFoundError) else ""
            raise RigError(f"{path}: the {what} cannot be read: {error.strerror}{hint}") from None
        except UnicodeDecodeError as error:
            raise RigError(f"{path}: not UTF-8 text at byte {error.start}; save the {what} as UTF-8") from None
        except RigError:
            raise
        except ValueError as error:  # TOMLDecodeError, or a whole number of thousands of digits
            other = "" if str(path).endswith(".toml") else f"; the name of a {what} ends in .toml"
            raise RigError(f"{path}: this is not valid TOML: {slip_of(text) or clipped(error, 200)}{other}") from None
        except RecursionError:
            raise RigError(f"{path}: not a {what}: lists are nested too deeply") from None


def _has_marks(value: object) -> bool:
    """Return whether a text contains a tab, the end of a line or the like."""
    if isinstance(value, Mapping | list):
        return any(map(_has_marks, value.values() if isinstance(value, Mapping) else value))
    return isinstance(value, str) and any(ord(letter) < ord(" ") for letter in value)
