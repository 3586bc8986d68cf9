"""TOML files of users: rig files, and files that name a model written elsewhere."""

import os
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deatwin.plant.errors import RigError, nearest
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


_NUMBER = r"[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_END = r"\s*(?:#.*)?"
_CURLY = "“”„‟«»‘’‚‛`´"
_KEY = re.compile(r"\s*([A-Za-z0-9_-]+)\s*=\s*(.*?)\s*")
_BARE = re.compile(r"\s*([A-Za-z0-9_-]+)\s+([^=\[\]#]+?)\s*(?:#.*)?")
_ODD_KEY = re.compile(r"\s*([^=:#\"']*[^=:#\"'\s])\s*([=:])\s*(.*?)\s*")
_TITLE = re.compile(r"\s*(?:([A-Za-z0-9_-]+)\s*:|[({<]\s*([A-Za-z0-9_-]+)\s*[)}>])" + _END)
_LOOK_ALIKE = str.maketrans("аеорсухіАЕОРСХВМНКТ", "aeopcyxiAEOPCXBMHKT")  # Cyrillic letters
_STRANGE = re.compile(r"[^\x00-\x7f]")
_SECTION = re.compile(r"\s*\[([A-Za-z0-9_-]+)\s*\]?" + _END)
_BACKSLASH = re.compile(r'"((?:[^"\\]|\\\\)*\\(?!u[0-9A-Fa-f]{4}|[\\"])[^"]*)"' + _END)
_SLIPS: tuple[tuple[re.Pattern[str], Callable[..., str]], ...] = (
    (
        re.compile(rf"([+-]?\d+),(\d+){_END}"),
        lambda whole, part: f"write a number with a decimal point, not a comma: {whole}.{part}",
    ),
    (re.compile(rf"([+-]?)(\.\d+){_END}"), lambda sign, part: f"a number must begin with a digit: write {sign}0{part}"),
    (re.compile(rf"([+-]?\d+)\.{_END}"), lambda whole: f"a number must end with a digit: write {whole}.0"),
    (
        re.compile(rf"({_NUMBER})\s*[A-Za-zµμ%°]+{_END}"),
        lambda number: f"leave the unit out, because the name of the key contains it: write {number}",
    ),
    (
        re.compile(rf"[{_CURLY}]+([^{_CURLY}\"']*)[{_CURLY}\"']*{_END}"),
        lambda word: f'quotes are straight: write "{word}"',
    ),
    (
        re.compile(r"(?!true\b|false\b|inf\b|nan\b)([^\W\d][^\"'#\[\]{}]*?)" + _END),
        lambda word: f'a text must be in quotes: write "{word}"',
    ),
    (
        _BACKSLASH,
        lambda path: (
            f"a backslash in double quotes begins an escape sequence: write '{path}', or {path.replace(chr(92), '/')}"
        ),
    ),
    (re.compile(r'"([^"#]*?)\s*(?:#[^"]*)?'), lambda word: f'the closing quote is missing: write "{word}"'),
    (re.compile(rf"({_NUMBER})\s*;.*"), lambda number: f"leave the semicolon out: write {number}"),
    (
        re.compile(rf'({_NUMBER}|"[^"]*")\s*(//|%|--).*'),
        lambda value, mark: f"a comment begins with #, not with {mark}: write {value}",
    ),
    (
        re.compile(rf"({_NUMBER})\s*(?:±|\+/?-).*"),
        lambda number: f"write one number, without its tolerance: {number}",
    ),
    (re.compile(rf"[−–]\s*(\d[^#]*?){_END}"), lambda number: f"a minus sign is a hyphen: write -{number}"),
    (
        re.compile(rf"([+-]?[1-9]\d{{0,2}}(?:[.' ]\d{{3}})+),(\d+){_END}"),
        lambda whole, part: (
            f"write a number with a decimal point and no other mark: {re.sub('[^0-9+-]', '', whole)}.{part}"
        ),
    ),
    (
        re.compile(rf"([+-]?\d+)\s*[x*×·]\s*10\^?([+-]?\d+){_END}"),
        lambda number, power: f"write a power of ten as {number}e{power}",
    ),
    (
        re.compile(rf"([+-]?)0+(\d+(?:\.\d+)?){_END}"),
        lambda sign, number: f"a number must not begin with 0: write {sign}{number}",
    ),
    (re.compile(rf"[-+\d.\s]+[*/^][-+*/^\d.\s]+{_END}"), lambda: "write a number, not a formula"),
    (re.compile(_END), lambda: "there is no value"),
)
"""Patterns of a wrong value, each with a hint made from its groups."""


def slip_of(text: str) -> str:
    """Return the first slip in a rig file: its line, its key, and what to write."""
    if text.lstrip().startswith("{"):
        return "it is JSON; write sections in brackets, and a line for each key, such as gain = 800.0"
    lines = list(enumerate(text.split("\n"), start=1))
    keys: dict[str, int] = {}
    sections: dict[str, int] = {}
    for number, line in lines:
        if section := _SECTION.fullmatch(line):
            if "]" not in line.split("#")[0]:
                return f"line {number}: a section must be in brackets: write [{clipped(section[1])}]"
            if section[1] in sections and not line.strip().startswith("[["):
                return f"line {number}: the section [{section[1]}] is already in line {sections[section[1]]}: keep one of the two"
            keys, sections[section[1]] = {}, number
        elif title := _TITLE.fullmatch(line):
            return f"line {number}: a section must be in brackets: write [{clipped(title[1] or title[2])}]"
        elif entry := _KEY.fullmatch(line):
            key, value = entry.groups()
            if hint := _hint_on(value):
                return f"line {number}, {clipped(key)}: {hint}"
            if key in keys:
                return f"line {number}, {clipped(key)}: the key is already in line {keys[key]}: keep one of the two"
            keys[key] = number
        elif meant := _entry_meant(line):
            return f"line {number}: write {meant}"
    for number, line in lines:
        bare_line = re.sub(r"\"[^\"]*\"|'[^']*'|#.*", "", line)
        if strange := _STRANGE.search(bare_line):
            return f"line {number}: the character U+{ord(strange[0]):04X} must not stand outside quotes; type the line anew"
    return ""


def _hint_on(value: str) -> str:
    """Return what to write instead of a wrong value; empty if nothing is known to be wrong."""
    tried = ((slip.fullmatch(value), say) for slip, say in _SLIPS)
    return next((say(*map(clipped, found.groups())) for found, say in tried if found), "")


def _entry_meant(line: str) -> str:
    """Return the entry that a line without a valid key and an equals sign probably means; empty if there is none."""
    if odd := _ODD_KEY.fullmatch(line):
        plain = odd[1].replace("µ", "u").replace("μ", "u").translate(_LOOK_ALIKE)
        key = re.sub(r"[^A-Za-z0-9-]+", "_", plain).strip("_")
        return f"{clipped(key)} = {clipped(odd[3])}" if odd[2] == ":" or key != odd[1] else ""
    bare = _BARE.fullmatch(line)
    return f"{clipped(bare[1])} = {clipped(bare[2])}" if bare else ""
